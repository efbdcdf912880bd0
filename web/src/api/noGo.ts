import type { FloorArea } from "../room/area";
import { request } from "./request";

const PATH = "/plans/no-go";

/** Let no drone enter a column of the room. @throws RequestError */
export async function addNoGo(area: FloorArea): Promise<void> {
  await request("POST", PATH, { area });
}

/** @throws RequestError when it is refused or not answered. */
export async function changeNoGo(id: string, area: FloorArea): Promise<void> {
  await request("PUT", `${PATH}/${encodeURIComponent(id)}`, { area });
}

/** @throws RequestError when it is refused or not answered. */
export async function dropNoGo(id: string): Promise<void> {
  await request("DELETE", `${PATH}/${encodeURIComponent(id)}`);
}
