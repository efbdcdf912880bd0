import { secondsLeft } from "../design/pace";
import type { PlanProgress } from "../protocol/messages.gen";

/** How far a search for a plan is, 0 to 1, and how long it still takes at its pace. */
interface Search {
  readonly share: number;
  readonly leftS: number | null;
}

/** How far the search is that these reports are of; null before the first one. */
export function searchOf(course: readonly PlanProgress[]): Search | null {
  const [first, last] = [course[0], course.at(-1)];
  if (first === undefined || last === undefined) return null;
  const now = reached(last);
  return { share: now.share, leftS: secondsLeft(reached(first), now) };
}

/** Moves take the same time, hot or cold. */
function reached({ at, iteration, iterations }: PlanProgress) {
  return { share: iterations > 0 ? Math.min(1, iteration / iterations) : 0, atS: Date.parse(at) / 1000 };
}
