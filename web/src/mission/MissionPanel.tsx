import type { CaptureRequest } from "../api/captures";
import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { isActive, isGrounded } from "../state/state";
import { words } from "../text/words";
import { CaptureForm } from "./CaptureForm";
import { CaptureControls, CaptureStatus } from "./CaptureStatus";
import { FindingsList } from "./FindingsList";
import { GroundedCard } from "./GroundedCard";
import { PhaseTimeline } from "./PhaseTimeline";

interface MissionPanelProps {
  /** Called with what the operator wants to capture; nothing flies yet. */
  readonly onPrepare: (request: CaptureRequest) => void;
}

/** The capture at hand, and between captures the form for the next one. */
export function MissionPanel({ onPrepare }: MissionPanelProps) {
  const capture = useConsole((state) => state.capture);
  const step = useConsole((state) => state.step);
  const entered = useConsole((state) => state.stepEntered);
  const findings = useConsole((state) => state.findings);
  return (
    <Panel
      title={words.mission.title}
      className="mission"
      aside={capture !== null && <code className="mission-id">{capture.id}</code>}
    >
      <CaptureStatus capture={capture} step={step} />
      {capture !== null && isGrounded(capture) && <GroundedCard capture={capture} />}
      <PhaseTimeline capture={capture} step={step} entered={entered} />
      <FindingsList findings={findings} run={capture?.run ?? null} />
      {capture !== null && isActive(capture) ? (
        <CaptureControls capture={capture} />
      ) : (
        <CaptureForm onPrepare={onPrepare} />
      )}
    </Panel>
  );
}
