import type { PathOf } from "./call";
import { request, RequestError } from "./request";

export type Stop = "hold" | "land" | "cut_motors";

const PATH: Readonly<Record<Stop, PathOf<"POST">>> = {
  hold: "/fleet/hold",
  land: "/fleet/land",
  cut_motors: "/fleet/cut-motors",
};

export const STOP_ATTEMPTS = 3;
/** A stop that is not answered by then is sent again. */
const STOP_TIMEOUT_MS = 1500;
const PAUSE_MS = 150;

/**
 * Stop the whole fleet. A plain request that needs neither the websocket nor a mission; every stop
 * may be repeated without harm, so it is sent up to three times.
 *
 * @throws RequestError the last one, when none of the attempts was accepted.
 */
export async function stopFleet(
  stop: Stop,
  send: typeof request = request,
  pause: (ms: number) => Promise<void> = wait,
): Promise<void> {
  let last: unknown;
  for (let attempt = 1; attempt <= STOP_ATTEMPTS; attempt++) {
    try {
      await send("POST", PATH[stop], undefined, STOP_TIMEOUT_MS);
      return;
    } catch (error) {
      if (!(error instanceof RequestError)) throw error;
      last = error;
    }
    if (attempt < STOP_ATTEMPTS) await pause(PAUSE_MS);
  }
  throw last;
}

function wait(ms: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, ms));
}
