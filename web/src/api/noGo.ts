import type { FloorArea } from "../floor/area";
import { call } from "./call";

/** Let no drone enter a column of the room. @throws RequestError */
export async function addNoGo(area: FloorArea): Promise<void> {
  await call("POST /plans/no-go", { body: { area } });
}

/** @throws RequestError when it is refused or not answered. */
export async function changeNoGo(id: string, area: FloorArea): Promise<void> {
  await call("PUT /plans/no-go/{volume_id}", { path: { volume_id: id }, body: { area } });
}

/** @throws RequestError when it is refused or not answered. */
export async function dropNoGo(id: string): Promise<void> {
  await call("DELETE /plans/no-go/{volume_id}", { path: { volume_id: id } });
}
