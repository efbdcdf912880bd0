import { Asking } from "../design/Waiting";
import { words } from "../text/words";
import { TrainAnewSection } from "./TrainAnewSection";
import { TrainedField } from "./TrainedField";
import { useTrainings } from "./useTrainings";

/** Train anew on a capture's pictures, with other settings; the capture's own field stays. */
export function TrainAnew({ captureId }: { readonly captureId: string }) {
  const { value: trainings, error, asking, again } = useTrainings(captureId);
  return (
    <TrainAnewSection captureId={captureId} onStarted={again}>
      {trainings === null && asking && <Asking />}
      {error !== null && <p className="field-error">{words.library.failed(error)}</p>}
      {trainings !== null && trainings.length > 0 && (
        <ul className="fields">
          {trainings.map((training) => (
            <TrainedField key={training.id} training={training} onChanged={again} />
          ))}
        </ul>
      )}
    </TrainAnewSection>
  );
}
