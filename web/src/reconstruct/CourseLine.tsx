import { useConsole } from "../context";
import { clock } from "../design/format";
import { CaptureChip, CaptureProgress, phaseWord } from "../mission/CaptureStatus";
import { isActive } from "../state/state";
import { words } from "../text/words";

/** What the capture is doing, how far it is and how long it will take. */
export function CourseLine() {
  const capture = useConsole((state) => state.capture);
  const step = useConsole((state) => state.step);
  if (capture === null) return null;
  const left = isActive(capture) && capture.eta_s !== null ? clock(capture.eta_s) : null;
  return (
    <div className="course" data-testid="course">
      <p>
        <strong>{phaseWord(capture, step)}</strong>
        <span>{left === null ? "" : words.waiting.left(left)}</span>
        <CaptureChip state={capture.state} />
      </p>
      <CaptureProgress capture={capture} />
    </div>
  );
}
