import { CANCEL_MS } from "../api/jobs";
import { isUnfinished, type Training } from "../api/trainings";
import { useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { bytes, clock, moment } from "../design/format";
import { Icon, type IconName } from "../design/Icon";
import { useUnderWay } from "../design/useUnderWay";
import { TimeLeft, Waiting } from "../design/Waiting";
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
      {training.state === "running" && training.job !== null && <Stage key={training.phase} training={training} />}
      <span className="capture-line">
        <span className={`chip chip-${face.tone}`}>
          <Icon name={face.icon} />
          {text.state[training.state]}
        </span>
        {training.state === "queued" && <span>{text.ahead(training.ahead)}</span>}
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

/** How far the stage is that a training is at; the later ones are of other lengths. */
function Stage({ training }: { readonly training: Training }) {
  const text = words.retrain;
  const names: Readonly<Record<string, string>> = words.field.stage;
  const { phase, progress } = training;
  if (phase === "") return <Waiting quiet what={text.begins} />;
  // Nothing but the server's own clock goes into it: the browser's may be another.
  const [askedS, nowS] = [training.created_at, training.updated_at].map((at) => Date.parse(at) / 1000) as [
    number,
    number,
  ];
  return (
    <span className="capture-line">
      <span>{names[phase] ?? phase}</span>
      {/* Of a stage that does not tell its length there is no share. */}
      <progress aria-label={text.progress} value={progress > 0 ? progress : undefined} max={1} />
      <TimeLeft share={progress} atS={nowS} />
      <span>{text.since(clock(nowS - askedS))}</span>
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
  const [underWay, follow] = useUnderWay();
  const { job, files } = training;
  const text = words.library;
  if (job !== null) {
    return (
      <>
        <button
          type="button"
          className="button button-small button-quiet"
          disabled={underWay}
          onClick={() => {
            follow(operator.cancelJob(job).then(onChanged));
          }}
        >
          <Icon name="abort" />
          {words.retrain.cancel}
        </button>
        {underWay && <Waiting quiet what={words.retrain.cancelling} mostMs={CANCEL_MS} />}
      </>
    );
  }
  if (isUnfinished(training) || files.length === 0) return null;
  return (
    <ConfirmButton
      className="button-small button-danger"
      testId="delete-training"
      disabled={underWay}
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
        const deletion = operator.deleteTraining(training.capture, training.id).then((done) => {
          if (done) onDeleted();
        });
        follow(deletion);
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
