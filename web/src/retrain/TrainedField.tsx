import { isUnfinished, type Training } from "../api/trainings";
import { useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { bytes, moment } from "../design/format";
import { Icon, type IconName } from "../design/Icon";
import { words } from "../text/words";
import { FieldCard, settingWords, type Marking } from "./FieldCard";

const FACE: Readonly<Record<Training["state"], { icon: IconName; tone: string }>> = {
  queued: { icon: "clock", tone: "calm" },
  running: { icon: "play", tone: "good" },
  succeeded: { icon: "check", tone: "good" },
  failed: { icon: "error", tone: "bad" },
  cancelled: { icon: "abort", tone: "busy" },
  interrupted: { icon: "warning", tone: "busy" },
};

interface TrainedFieldProps {
  readonly training: Training;
  readonly marking?: Marking;
  readonly onChanged: () => void;
}

/** A field trained anew: how far it is, what came of it, and what can be done with it. */
export function TrainedField({ training, marking, onChanged }: TrainedFieldProps) {
  const face = FACE[training.state];
  const text = words.retrain;
  const title = text.trained(moment(training.created_at));
  return (
    <FieldCard
      runId={training.id}
      title={title}
      files={training.files}
      settings={settingWords(training.seconds, training.seed, training.object_only)}
      metrics={training.metrics}
      marking={training.metrics === null ? undefined : marking}
      testId={`training-${training.state}`}
    >
      {training.error !== null && <span className="field-error">{training.error}</span>}
      {training.state === "running" && <Progress training={training} />}
      <span className="capture-line">
        <span className={`chip chip-${face.tone}`}>
          <Icon name={face.icon} />
          {text.state[training.state]}
        </span>
        <Actions
          training={training}
          title={title}
          onChanged={onChanged}
          onDeleted={() => {
            marking?.onMark(false);
            onChanged();
          }}
        />
      </span>
      {training.files.length > 0 && <AllFiles training={training} />}
    </FieldCard>
  );
}

function Progress({ training }: { readonly training: Training }) {
  const stages: Readonly<Record<string, string>> = words.field.stage;
  return (
    <span className="capture-line">
      <span>{stages[training.phase] ?? training.phase}</span>
      <progress aria-label={words.retrain.progress} value={training.progress} max={1} />
    </span>
  );
}

interface ActionsProps {
  readonly training: Training;
  readonly title: string;
  readonly onChanged: () => void;
  readonly onDeleted: () => void;
}

function Actions({ training, title, onChanged, onDeleted }: ActionsProps) {
  const operator = useOperator();
  const { job, files } = training;
  const text = words.library;
  if (job !== null) {
    return (
      <button
        type="button"
        className="button button-small button-quiet"
        onClick={() => {
          void operator.cancelJob(job).then(onChanged);
        }}
      >
        <Icon name="abort" />
        {words.retrain.cancel}
      </button>
    );
  }
  if (isUnfinished(training) || files.length === 0) return null;
  return (
    <ConfirmButton
      className="button-small button-danger"
      testId="delete-training"
      label={
        <>
          <Icon name="trash" />
          {text.delete}
          <span className="sr-only"> {title}</span>
        </>
      }
      confirm={
        <>
          <Icon name="trash" />
          {text.deleteConfirm}
        </>
      }
      onConfirm={() => {
        void operator.deleteTraining(training.capture, training.id).then((done) => {
          if (done) onDeleted();
        });
      }}
    />
  );
}

function AllFiles({ training }: { readonly training: Training }) {
  const { files, size_bytes } = training;
  return (
    <details className="files">
      <summary>{words.library.filesOf(files.length, bytes(size_bytes))}</summary>
      <ul>
        {files.map((file) => (
          <li key={file.path}>
            <a href={file.url} download={file.path.split("/").at(-1)}>
              <Icon name="download" />
              {file.path}
            </a>
            <span>{bytes(file.size_bytes)}</span>
          </li>
        ))}
      </ul>
    </details>
  );
}
