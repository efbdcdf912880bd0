import type { CheckView, FailsafeView } from "../protocol/rest.gen";
import { call } from "./call";

/** One item of the preflight checklist. */
export type Check = CheckView;

/** One row of the failsafe table. */
export type FailsafeRow = FailsafeView;

/** A checklist older than this is no checklist. */
const PATIENCE_MS = 4000;

/** @throws RequestError when it is not answered. */
export async function getPreflight(): Promise<readonly Check[]> {
  return call("GET /preflight", { timeoutMs: PATIENCE_MS });
}

/** @throws RequestError when it is not answered. */
export async function getFailsafes(): Promise<readonly FailsafeRow[]> {
  return call("GET /failsafes");
}
