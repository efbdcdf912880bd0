import { useState } from "react";
import { words } from "../text/words";
import { clock } from "./format";
import { secondsLeft, stillLeft, type Reached } from "./pace";
import { useNow } from "./useNow";

/** What comes within this is not worth a word. */
const QUIET_MS = 2000;

interface WaitingProps {
  /** What is waited for. */
  readonly what: string;
  /** After this it is given up, where that is known. */
  readonly mostMs?: number;
  /** True where it mostly comes at once: said only when it does not. */
  readonly quiet?: boolean;
}

/** Something that nobody can tell the end of: what it is, and how long it has taken since this was shown. */
export function Waiting({ what, mostMs, quiet = false }: WaitingProps) {
  const goneMs = useGone();
  if (quiet && goneMs < QUIET_MS) return null;
  return (
    <span className="waiting" data-testid="waiting">
      <span role="status">{what}</span> <Gone ms={goneMs} mostMs={mostMs} />
    </span>
  );
}

/** How long it has taken since this was shown. */
export function Elapsed() {
  return <Gone ms={useGone()} mostMs={undefined} />;
}

function Gone({ ms, mostMs }: { readonly ms: number; readonly mostMs: number | undefined }) {
  const gone = clock(ms / 1000);
  return (
    // A screen reader shall not say it again every second.
    <span className="waiting-time" aria-hidden="true">
      {mostMs === undefined ? gone : words.waiting.atMost(gone, clock(mostMs / 1000))}
    </span>
  );
}

/** Time left as a report told it, counted down; without another one, for how long. One key per report. */
export function Countdown({ leftS }: { readonly leftS: number | null }) {
  const still = stillLeft(leftS, useGone() / 1000);
  if (still === null) return null;
  return <span className="waiting-time">{stillText(still)}</span>;
}

function stillText({ kind, seconds }: NonNullable<ReturnType<typeof stillLeft>>): string {
  switch (kind) {
    case "left":
      return words.waiting.left(clock(seconds));
    case "due":
      return words.waiting.due;
    case "silent":
      return words.waiting.silent(seconds);
  }
}

/** Time left of work at the pace since it was first shown. One key per piece of work. */
export function TimeLeft(reached: Reached) {
  const [first] = useState(reached);
  const left = secondsLeft(first, reached);
  return left === null ? null : <span className="waiting-time">{words.waiting.left(clock(left))}</span>;
}

/** Milliseconds since the component was first shown. */
function useGone(): number {
  const [sinceMs] = useState(() => Date.now());
  return Math.max(0, useNow(1000) - sinceMs);
}

/** The console's answer, which mostly comes at once. */
export function Asking() {
  return <Waiting quiet what={words.waiting.console} />;
}
