import { useMemo } from "react";
import { getTrainingLog } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import type { QualitySeries } from "../state/series";
import { words } from "../text/words";
import { seriesFromLog } from "./course";
import { LossChart, PsnrChart } from "./PsnrChart";

/** While a training runs its log is read anew this often, seconds. */
const EVERY_S = 10;

/** How the training goes: quality and loss over its seconds. */
export function QualityPanel() {
  const series = useWholeSeries();
  return (
    <Panel title={words.field.quality} className="quality">
      <PsnrChart series={series} />
      <LossChart series={series} />
    </Panel>
  );
}

/** What this browser has seen; the training's own log where it has seen more. */
function useWholeSeries(): QualitySeries {
  const seen = useConsole((state) => state.findings.quality);
  const captureId = useConsole((state) => state.capture?.id ?? "");
  const training = useConsole((state) => state.findings.training);
  // Whoever comes when all is over is told of the result, and of no training.
  const judgedAt = useConsole((state) => state.findings.metrics?.at ?? "");
  const progress =
    training === null ? judgedAt : `${training.stage} ${Math.floor(training.seconds / EVERY_S)}`;
  const told = progress === "" ? "" : `${captureId} ${progress}`;
  const { value: log } = useAnswer(told, () => (told === "" ? Promise.resolve("") : getTrainingLog(captureId)));
  const logged = useMemo(() => seriesFromLog(log ?? ""), [log]);
  return told !== "" && logged.seconds.length > seen.seconds.length ? logged : seen;
}
