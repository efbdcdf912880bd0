import { request } from "./request";

export type DroneCommand = "takeoff" | "land" | "hold" | "rearm" | "cut_motors";

/**
 * Give one drone a command.
 *
 * @throws RequestError when it is refused or not answered.
 */
export async function commandDrone(droneId: string, command: DroneCommand): Promise<void> {
  await request("POST", `/drones/${encodeURIComponent(droneId)}/commands`, { command });
}
