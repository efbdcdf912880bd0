import { useEffect, useId, useState, type SubmitEvent } from "react";
import { CANCEL_MS, getTrainings, runOf, type Training as Job } from "../api/jobs";
import { artifactUrl } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { useOperator } from "../context";
import { clock, decimal, moment, withUnit } from "../design/format";
import { Icon } from "../design/Icon";
import { NumberField } from "../design/NumberField";
import { useUnderWay } from "../design/useUnderWay";
import { TimeLeft, Waiting } from "../design/Waiting";
import { words } from "../text/words";

const LEAST_S = 1;
const MOST_S = 86_400;
const MOST_SEED = 2 ** 32 - 1;
/** So often a training under way is asked after. */
const EVERY_MS = 2000;
/** What a training leaves in its run folder for people. */
const RESULTS = ["preview.jpg", "orbit.mp4", "mesh.glb", "metrics.json"] as const;

/** Train anew on a capture's pictures, with other settings; the capture's own field stays. */
export function TrainAnew({ captureId }: { readonly captureId: string }) {
  const { value: jobs, error, asking, again } = useAnswer(captureId, () => getTrainings(captureId));
  const busy = jobs?.some((job) => isUnfinished(job)) === true;
  // The next question waits for this answer, however long the line takes for it.
  useEffect(() => {
    if (!busy || asking) return;
    const timer = setTimeout(again, EVERY_MS);
    return () => {
      clearTimeout(timer);
    };
  }, [busy, asking, again]);
  const text = words.retrain;
  return (
    <section className="retrain" aria-label={text.title}>
      <h3>{text.title}</h3>
      <p className="hint">{text.hint}</p>
      <TrainingForm captureId={captureId} onStarted={again} />
      {error !== null && <p className="field-error">{words.library.failed(error)}</p>}
      {jobs !== null && jobs.length > 0 && (
        <ul className="trainings">
          {jobs.map((job) => (
            <Training key={job.id} job={job} onChanged={again} />
          ))}
        </ul>
      )}
    </section>
  );
}

interface TrainingFormProps {
  readonly captureId: string;
  readonly onStarted: () => void;
}

function TrainingForm({ captureId, onStarted }: TrainingFormProps) {
  const operator = useOperator();
  const id = useId();
  const [seconds, setSeconds] = useState("60");
  const [seed, setSeed] = useState("0");
  const [objectOnly, setObjectOnly] = useState(false);
  const [asking, setAsking] = useState(false);
  const text = words.retrain;
  const wish = {
    capture: captureId,
    seconds: numberIn(seconds),
    seed: numberIn(seed),
    object_only: objectOnly,
  };
  const secondsFit = wish.seconds >= LEAST_S && wish.seconds <= MOST_S;
  const seedFits = Number.isInteger(wish.seed) && wish.seed >= 0 && wish.seed <= MOST_SEED;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (!secondsFit || !seedFits || asking) return;
    setAsking(true);
    void operator
      .trainAnew(wish)
      .then(onStarted)
      .finally(() => {
        setAsking(false);
      });
  };
  return (
    <form className="form-row" noValidate onSubmit={submit}>
      <NumberField
        id={`${id}-seconds`}
        label={text.seconds}
        min={LEAST_S}
        max={MOST_S}
        value={seconds}
        valid={secondsFit}
        onChange={setSeconds}
      />
      <NumberField
        id={`${id}-seed`}
        label={text.seed}
        whole
        min={0}
        max={MOST_SEED}
        value={seed}
        valid={seedFits}
        onChange={setSeed}
      />
      <label className="retrain-only">
        <input
          type="checkbox"
          checked={objectOnly}
          onChange={(event) => {
            setObjectOnly(event.target.checked);
          }}
        />
        {text.objectOnly}
      </label>
      <button
        type="submit"
        className="button button-small"
        data-testid="train-anew"
        disabled={!secondsFit || !seedFits || asking}
      >
        <Icon name="play" />
        {text.start}
      </button>
      {!secondsFit && <p className="field-error">{text.secondsBounds(LEAST_S, MOST_S)}</p>}
      {!seedFits && <p className="field-error">{text.seedBounds(MOST_SEED)}</p>}
    </form>
  );
}

function Training({ job, onChanged }: { readonly job: Job; readonly onChanged: () => void }) {
  const operator = useOperator();
  const [cancelling, followCancel] = useUnderWay();
  const text = words.retrain;
  return (
    <li data-testid={`training-${job.state}`}>
      <span className="training-when">{moment(job.created_at)}</span>
      <strong>{text.state[job.state]}</strong>
      {job.state === "queued" && <span>{text.ahead(job.ahead)}</span>}
      {job.state === "running" && <Stage key={job.phase} job={job} />}
      {isUnfinished(job) && (
        <button
          type="button"
          className="button button-small button-quiet"
          disabled={cancelling}
          onClick={() => {
            followCancel(operator.cancelJob(job.id).then(onChanged));
          }}
        >
          <Icon name="abort" />
          {text.cancel}
        </button>
      )}
      {cancelling && <Waiting quiet what={text.cancelling} mostMs={CANCEL_MS} />}
      {job.error !== null && <span className="field-error">{job.error}</span>}
      {job.state === "succeeded" && <Result job={job} />}
    </li>
  );
}

/** How far the stage is that a training is at; the later ones are of other lengths. */
function Stage({ job }: { readonly job: Job }) {
  const text = words.retrain;
  const names: Readonly<Record<string, string>> = words.field.stage;
  // Nothing but the server's own clock goes into it: the browser's may be another.
  const [askedS, nowS] = [job.created_at, job.updated_at].map((at) => Date.parse(at) / 1000) as [number, number];
  if (job.phase === "") return <Waiting quiet what={text.begins} />;
  return (
    <>
      <span>{names[job.phase] ?? job.phase}</span>
      {/* Of a stage that does not tell its length there is no share. */}
      <progress aria-label={text.progress} value={job.progress > 0 ? job.progress : undefined} max={1} />
      <TimeLeft share={job.progress} atS={nowS} />
      <span>{text.since(clock(nowS - askedS))}</span>
    </>
  );
}

function Result({ job }: { readonly job: Job }) {
  const { psnr_db, psnr_db_object, ssim } = job.result ?? {};
  return (
    <>
      <span>
        {words.field.psnr} {withUnit(psnr_db ?? null, 2, "dB")}, {words.field.psnrObject}{" "}
        {withUnit(psnr_db_object ?? null, 2, "dB")}, {words.field.ssim} {decimal(ssim, 3)}
      </span>
      <span className="training-files">
        {RESULTS.map((file) => (
          <a key={file} href={artifactUrl(runOf(job), file)} target="_blank" rel="noreferrer">
            {file}
          </a>
        ))}
      </span>
    </>
  );
}

function isUnfinished(job: Job): boolean {
  return job.state === "queued" || job.state === "running";
}

/** An empty field is no zero. */
function numberIn(text: string): number {
  return text.trim() === "" ? NaN : Number(text);
}
