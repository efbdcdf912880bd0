import type { Place, ShareBox } from "../pick/box";
import { request } from "./request";

/**
 * Say where the object is in a drone's newest picture.
 *
 * @throws RequestError when it is refused or not answered.
 */
export async function pickObject(droneId: string, place: Place): Promise<void> {
  const where = place.kind === "box" ? { box: place.box } : { point: [place.point.x, place.point.y] };
  await request("PUT", objectPath(droneId), where);
}

/** @throws RequestError when it is refused or not answered. */
export async function searchObject(droneId: string): Promise<void> {
  await request("DELETE", objectPath(droneId));
}

/** @throws RequestError when it is refused or not answered. */
export async function addPriority(droneId: string, box: ShareBox): Promise<void> {
  await request("POST", "/plans/priorities", { drone_id: droneId, box });
}

/** @throws RequestError when it is refused or not answered. */
export async function dropPriority(partId: string): Promise<void> {
  await request("DELETE", `/plans/priorities/${encodeURIComponent(partId)}`);
}

function objectPath(droneId: string): string {
  return `/drones/${encodeURIComponent(droneId)}/object`;
}
