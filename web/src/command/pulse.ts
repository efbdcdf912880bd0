/** A running beat; `stop` ends it. */
export interface Pulse {
  stop(): void;
}

/** Starts a beat that calls `beat` every two seconds until it is stopped. */
export type StartPulse = (beat: () => void) => Pulse;

const EVERY_MS = 2000;

/**
 * Beat from a worker's timer, which goes on while the tab is hidden.
 *
 * Only the tick comes from the worker: what it leads to happens on the page, so a page that hangs
 * falls silent. Where no worker can be had the page's own timer must do.
 */
export const startWorkerPulse: StartPulse = (beat) => {
  let timer: ReturnType<typeof setInterval> | undefined;
  const ownTimer = () => {
    timer ??= setInterval(beat, EVERY_MS);
  };
  let worker: Worker | null = null;
  try {
    worker = new Worker(new URL("./pulse.worker.ts", import.meta.url), { type: "module" });
    worker.onmessage = beat;
    worker.onerror = ownTimer;
  } catch {
    ownTimer();
  }
  return {
    stop: () => {
      worker?.terminate();
      clearInterval(timer);
    },
  };
};
