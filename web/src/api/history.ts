import type { DroneReport } from "../protocol/messages.gen";
import { call } from "./call";

/** What the drones reported before this page was opened. @throws RequestError when it is not answered. */
export async function getHistory(): Promise<readonly DroneReport[]> {
  return call("GET /drones/history");
}
