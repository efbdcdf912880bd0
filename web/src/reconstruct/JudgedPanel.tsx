import { getArtifacts } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { HeldOutView } from "../judge/HeldOutView";
import { keptRenderings } from "../judge/heldOut";
import { words } from "../text/words";

/** The held-out pictures against their renderings, once the field was judged on them. */
export function JudgedPanel() {
  const captureId = useConsole((state) => state.capture?.id ?? "");
  const at = useConsole((state) => state.findings.metrics?.at ?? "");
  const judged = at === "" ? "" : `${captureId} ${at}`;
  const { value: files } = useAnswer(judged, () =>
    judged === "" ? Promise.resolve([]) : getArtifacts(captureId),
  );
  const indices = keptRenderings(files ?? []);
  if (judged === "" || indices.length === 0) return null;
  return (
    <Panel title={words.judge.title} className="judged">
      <HeldOutView key={captureId} captureId={captureId} indices={indices} scores={undefined} />
    </Panel>
  );
}
