import type { Place, ShareBox } from "../pick/box";
import type { PointedBox, PointedPoint } from "../protocol/rest.gen";
import { call } from "./call";

/**
 * Say where the object is in a drone's newest picture.
 *
 * @throws RequestError when it is refused or not answered.
 */
export async function pickObject(droneId: string, place: Place): Promise<void> {
  const where: PointedBox | PointedPoint =
    place.kind === "box" ? { box: place.box } : { point: [place.point.x, place.point.y] };
  await call("PUT /drones/{drone_id}/object", { path: { drone_id: droneId }, body: where });
}

/** @throws RequestError when it is refused or not answered. */
export async function searchObject(droneId: string): Promise<void> {
  await call("DELETE /drones/{drone_id}/object", { path: { drone_id: droneId } });
}

/** @throws RequestError when it is refused or not answered. */
export async function addPriority(droneId: string, box: ShareBox): Promise<void> {
  await call("POST /plans/priorities", { body: { drone_id: droneId, box } });
}

/** @throws RequestError when it is refused or not answered. */
export async function dropPriority(partId: string): Promise<void> {
  await call("DELETE /plans/priorities/{part_id}", { path: { part_id: partId } });
}
