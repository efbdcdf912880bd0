import type { CommandRequest } from "../protocol/rest.gen";
import { call } from "./call";

export type DroneCommand = CommandRequest["command"];

/**
 * Give one drone a command.
 *
 * @throws RequestError when it is refused or not answered.
 */
export async function commandDrone(droneId: string, command: DroneCommand): Promise<void> {
  await call("POST /drones/{drone_id}/commands", { path: { drone_id: droneId }, body: { command } });
}
