import { useMemo } from "react";
import { getArtifacts, getTrainingLog, TRAINING_LOG } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { isActive } from "../state/state";
import { courseFromLog, NO_COURSE, type Course } from "./trainingCourse";

/** While a training runs its log is read anew this often, seconds. */
const EVERY_S = 10;

/** What this browser has heard of the training; the training's own log where that knows more. */
export function useCourse(): Course {
  const { quality: seen, training } = useConsole((state) => state.findings);
  const captureId = useConsole((state) => state.capture?.id ?? "");
  const over = useConsole((state) =>
    state.capture === null || isActive(state.capture) ? "" : state.capture.state,
  );
  // Whoever comes when all is over is told of the result at most, and of no training.
  const judgedAt = useConsole((state) => state.findings.metrics?.at ?? "");
  const progress =
    training === null ? judgedAt || over : `${training.stage} ${Math.floor(training.seconds / EVERY_S)}`;
  const told = progress === "" ? "" : `${captureId} ${progress}`;
  const { value: log } = useAnswer(told, async () => {
    if (told === "") return null;
    const trained = training !== null || judgedAt !== "" || (await hasLog(captureId));
    return { captureId, text: trained ? await getTrainingLog(captureId) : "" };
  });
  const logged = useMemo(() => (log === null ? NO_COURSE : courseFromLog(log.text)), [log]);
  // The last answer stands until the next one, which may be another capture's.
  const known = told !== "" && log?.captureId === captureId ? logged : NO_COURSE;
  return {
    series: known.series.seconds.length > seen.seconds.length ? known.series : seen,
    last: training ?? known.last,
  };
}

/** Whether a capture that is over ever trained: one without pictures did not. */
async function hasLog(captureId: string): Promise<boolean> {
  const files = await getArtifacts(captureId);
  return files.some((file) => file.path === TRAINING_LOG);
}
