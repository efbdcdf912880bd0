import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { isActive } from "../state/state";
import { en } from "../text/en";
import { CaptureForm } from "./CaptureForm";
import { CaptureControls, CaptureStatus } from "./CaptureStatus";
import { FindingsList } from "./FindingsList";
import { PhaseTimeline } from "./PhaseTimeline";

/** The capture at hand, and between captures the form for the next one. */
export function MissionPanel() {
  const capture = useConsole((state) => state.capture);
  const step = useConsole((state) => state.step);
  const entered = useConsole((state) => state.stepEntered);
  const findings = useConsole((state) => state.findings);
  return (
    <Panel
      title={en.mission.title}
      className="mission"
      aside={capture !== null && <code className="mission-id">{capture.id}</code>}
    >
      <CaptureStatus capture={capture} step={step} />
      <PhaseTimeline capture={capture} step={step} entered={entered} />
      <FindingsList findings={findings} run={capture?.run ?? null} />
      {capture !== null && isActive(capture) ? (
        <CaptureControls capture={capture} />
      ) : (
        <CaptureForm />
      )}
    </Panel>
  );
}
