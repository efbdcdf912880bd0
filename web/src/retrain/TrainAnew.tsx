import { words } from "../text/words";
import { TrainedField } from "./TrainedField";
import { TrainingForm } from "./TrainingForm";
import { useTrainings } from "./useTrainings";

/** Train anew on a capture's pictures, with other settings; the capture's own field stays. */
export function TrainAnew({ captureId }: { readonly captureId: string }) {
  const { value: trainings, error, again } = useTrainings(captureId);
  const text = words.retrain;
  return (
    <section className="retrain" aria-label={text.title}>
      <h3>{text.title}</h3>
      <p className="hint">{text.hint}</p>
      <TrainingForm captureId={captureId} onStarted={again} />
      {error !== null && <p className="field-error">{words.library.failed(error)}</p>}
      {trainings !== null && trainings.length > 0 && (
        <ul className="fields">
          {trainings.map((training) => (
            <TrainedField key={training.id} training={training} onChanged={again} />
          ))}
        </ul>
      )}
    </section>
  );
}
