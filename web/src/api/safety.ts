import { request } from "./request";

/** One item of the preflight checklist. */
export interface Check {
  /** The name an override has to use. */
  readonly key: string;
  readonly item: string;
  /** Null for the console itself. */
  readonly drone_id: string | null;
  readonly passed: boolean;
  readonly found: string;
  readonly remedy: string;
  /** True when no operator may override it. */
  readonly final: boolean;
}

/** One row of the failsafe table. */
export interface FailsafeRow {
  readonly event: string;
  readonly threshold: number;
  readonly direction: "at_least" | "at_most";
  readonly unit: string;
  readonly action: string;
  readonly description: string;
}

/** A checklist older than this is no checklist. */
const PATIENCE_MS = 4000;

/** @throws RequestError when it is not answered. */
export async function getPreflight(): Promise<readonly Check[]> {
  return (await request("GET", "/preflight", undefined, PATIENCE_MS)) as readonly Check[];
}

/** @throws RequestError when it is not answered. */
export async function getFailsafes(): Promise<readonly FailsafeRow[]> {
  return (await request("GET", "/failsafes")) as readonly FailsafeRow[];
}
