import type { DroneReport } from "../protocol/messages.gen";
import { request } from "./request";

/** What the drones reported before this page was opened. @throws RequestError when it is not answered. */
export async function getHistory(): Promise<readonly DroneReport[]> {
  return (await request("GET", "/drones/history")) as readonly DroneReport[];
}
