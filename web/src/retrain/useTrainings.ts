import { useEffect } from "react";
import { getTrainings, isUnfinished, type Training } from "../api/trainings";
import { useAnswer, type Answer } from "../api/useAnswer";

/** So often a training under way is asked after. */
const EVERY_MS = 2000;

/** The fields trained anew on a capture, asked for again while one of them is under way. */
export function useTrainings(captureId: string): Answer<readonly Training[]> {
  const answer = useAnswer(captureId, () => getTrainings(captureId));
  const { value, asking, again } = answer;
  const busy = value?.some(isUnfinished) === true;
  // The next question waits for this answer, however long the line takes for it.
  useEffect(() => {
    if (!busy || asking) return;
    const timer = setTimeout(again, EVERY_MS);
    return () => {
      clearTimeout(timer);
    };
  }, [busy, asking, again]);
  return answer;
}
