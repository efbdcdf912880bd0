import { getCaptureFile, type Artifact, type CaptureEntry } from "../api/library";
import type { Training } from "../api/trainings";
import { useAnswer } from "../api/useAnswer";
import { FieldCard, settingWords, type Marking } from "../retrain/FieldCard";
import { TrainedField } from "../retrain/TrainedField";
import { words } from "../text/words";
import { CompareBar, type Marks } from "./CompareBar";
import { fieldKey } from "./fieldKey";

interface FieldListProps {
  readonly entry: CaptureEntry;
  readonly files: readonly Artifact[];
  readonly trainings: readonly Training[];
  readonly marks: Marks;
  readonly onChanged: () => void;
}

/** The fields of a capture: its own and those trained anew on its pictures. */
export function FieldList({ entry, files, trainings, marks, onChanged }: FieldListProps) {
  const text = words.library;
  const marking = (key: string): Marking => ({
    marked: marks.keys.includes(key),
    full: marks.keys.length >= 2,
    onMark: (mark) => {
      marks.onMark(key, mark);
    },
  });
  return (
    <section className="run-fields" aria-label={text.fields}>
      <h3>{text.fields}</h3>
      {trainings.length > 0 && <CompareBar marks={marks} testId="compare-fields" />}
      <ul className="fields">
        {entry.metrics !== null && (
          <OwnField entry={entry} files={files} marking={trainings.length > 0 ? marking(entry.id) : undefined} />
        )}
        {trainings.map((training) => (
          <TrainedField
            key={training.id}
            training={training}
            marking={marking(fieldKey(training))}
            onChanged={onChanged}
          />
        ))}
      </ul>
    </section>
  );
}

interface OwnFieldProps {
  readonly entry: CaptureEntry;
  readonly files: readonly Artifact[];
  readonly marking: Marking | undefined;
}

function OwnField({ entry, files, marking }: OwnFieldProps) {
  const { value: file } = useAnswer(entry.id, () => getCaptureFile(entry.id));
  return (
    <FieldCard
      runId={entry.id}
      title={words.library.ownField}
      files={files}
      settings={settingWords(file?.request?.train_seconds ?? null, file?.request?.seed ?? null, false)}
      metrics={entry.metrics}
      marking={marking}
      testId="own-field"
    />
  );
}
