/** How much of some work was done at a moment, whichever clock told it. */
export interface Reached {
  readonly share: number;
  readonly atS: number;
}

/** What was watched for a shorter time tells no pace. */
const LEAST_S = 1;

/** Seconds that the rest takes at the pace between two moments; null where there was none yet. */
export function secondsLeft(from: Reached, to: Reached): number | null {
  if (to.share >= 1) return 0;
  const [done, seconds] = [to.share - from.share, to.atS - from.atS];
  return seconds < LEAST_S || done <= 0 ? null : ((1 - to.share) * seconds) / done;
}

/** Without news for longer than this, seconds, what was told of the time left counts no more. */
const SILENT_S = 5;
/** What nothing was heard of for so long has ended without a word. */
const FORGOTTEN_S = 60;

/** What is still true of a time left that was told `goneS` seconds ago. */
export function stillLeft(
  leftS: number | null,
  goneS: number,
): { readonly kind: "left" | "due" | "silent"; readonly seconds: number } | null {
  if (goneS > FORGOTTEN_S) return null;
  if (goneS > SILENT_S) return { kind: "silent", seconds: Math.floor(goneS) };
  if (leftS === null) return null;
  const seconds = Math.max(0, leftS - goneS);
  return { kind: seconds < 0.5 ? "due" : "left", seconds };
}
