import { useConsole } from "../context";
import { AbortButton } from "../mission/CaptureStatus";
import { GoOnButton } from "../retrain/GoOnButton";
import { TrainAnew } from "../retrain/TrainAnew";
import { canGoOn, isActive, isTraining } from "../state/state";

/** What can be done about the training of the capture at hand: stop it, go on with it, train anew. */
export function TrainingControls() {
  const capture = useConsole((state) => state.capture);
  if (capture === null) return null;
  // Abort lands the drones while they fly: that has its place where they are seen.
  if (isActive(capture)) {
    return isTraining(capture) ? (
      <div className="field-actions">
        <AbortButton capture={capture} />
      </div>
    ) : null;
  }
  if (capture.images === 0) return null;
  return (
    <div className="field-actions">
      {canGoOn(capture) && <GoOnButton captureId={capture.id} />}
      <TrainAnew key={capture.id} captureId={capture.id} />
    </div>
  );
}
