import { getArtifacts, getCaptureFile, type Artifact, type CaptureEntry } from "../api/library";
import { LONG_WORK_MS } from "../api/request";
import { useAnswer } from "../api/useAnswer";
import { useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { bytes, clock, decimal, moment, withUnit } from "../design/format";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { useUnderWay } from "../design/useUnderWay";
import { Asking, Waiting } from "../design/Waiting";
import { HeldOutView } from "../judge/HeldOutView";
import { keptRenderings } from "../judge/heldOut";
import { CaptureChip } from "../mission/CaptureStatus";
import { hashOfScreen } from "../shell/screens";
import { GoOnButton } from "../retrain/GoOnButton";
import { TrainAnewSection } from "../retrain/TrainAnewSection";
import { useTrainings } from "../retrain/useTrainings";
import { KnownLength } from "../scale/KnownLength";
import { canGoOn, isActiveState } from "../state/state";
import { words } from "../text/words";
import { modeWord } from "./CaptureCard";
import type { Marks } from "./CompareBar";
import { FieldList } from "./FieldList";
import { filesByFolder, flightSeconds } from "./run";
import { RunFilm } from "./RunFilm";
import { RunPicture } from "./RunPicture";

interface RunPanelProps {
  readonly entry: CaptureEntry;
  readonly marks: Marks;
  readonly onChanged: () => void;
}

/** One capture: its rendering, its figures, its fields, its files, and what can be done with it. */
export function RunPanel({ entry, marks, onChanged }: RunPanelProps) {
  const operator = useOperator();
  const [deleting, followDeletion] = useUnderWay();
  const { value: files, error, asking } = useAnswer(entry.id + entry.state, () => getArtifacts(entry.id));
  const trainings = useTrainings(entry.id);
  const anew = trainings.value ?? [];
  const text = words.library;
  const name = entry.name === "" ? entry.id : entry.name;
  return (
    <Panel title={name} className="run" aside={<CaptureChip state={entry.state} />}>
      <div className="run-body" data-testid="run" data-run={entry.id}>
        {files?.some((file) => file.path === "orbit.mp4") === true ? (
          <RunFilm key={entry.id} captureId={entry.id} alt={text.film(name)} />
        ) : (
          <RunPicture captureId={entry.id} files={["preview.jpg", "images/0000.jpg"]} alt={text.rendering(name)} />
        )}
        {files !== null && keptRenderings(files).length > 0 && (
          <section className="run-judged" aria-label={words.judge.title}>
            <h3>{words.judge.title}</h3>
            <HeldOutView captureId={entry.id} indices={keptRenderings(files)} scores={entry.metrics?.pictures} />
          </section>
        )}
        <RunFacts entry={entry} />
        {((files === null && asking) || (trainings.value === null && trainings.asking)) && <Asking />}
        {error !== null && <p className="field-error">{text.failed(error)}</p>}
        {files !== null && <Replay files={files} entry={entry} />}
        {trainings.error !== null && (
          <p className="field-error">
            {text.failed(trainings.error)}{" "}
            <button type="button" className="button button-small" onClick={trainings.again}>
              {text.again}
            </button>
          </p>
        )}
        {(entry.metrics !== null || anew.length > 0) && (
          <FieldList entry={entry} files={files ?? []} trainings={anew} marks={marks} onChanged={trainings.again} />
        )}
        {!isActiveState(entry.state) && entry.images > 0 && (
          <TrainAnewSection captureId={entry.id} onStarted={trainings.again} />
        )}
        {entry.state === "succeeded" && entry.images > 1 && (
          <KnownLength key={`scale-${entry.id}`} captureId={entry.id} pictures={entry.images} />
        )}
        {files !== null && <Files files={files} />}
        <div className="run-actions">
          <StarButton entry={entry} onChanged={onChanged} />
          {!isActiveState(entry.state) && (
            <>
              {canGoOn(entry) && <GoOnButton captureId={entry.id} onChanged={onChanged} />}
              <ConfirmButton
                className="button-danger"
                testId="delete-capture"
                // The question says how many fields go with it: known at all, and asked for anew.
                disabled={deleting || trainings.value === null || trainings.error !== null}
                onPress={trainings.again}
                ready={!trainings.asking}
                label={
                  <>
                    <Icon name="trash" />
                    {text.delete}
                  </>
                }
                confirm={
                  <>
                    <Icon name="trash" />
                    {anew.length === 0 ? text.deleteConfirm : text.deleteWithFields(anew.length)}
                  </>
                }
                onConfirm={() => {
                  const done = operator.deleteCapture(entry.id).then((deleted) => {
                    if (!deleted) return;
                    location.hash = hashOfScreen("library");
                    onChanged();
                  });
                  followDeletion(done);
                }}
              />
              {deleting && <Waiting what={text.deleting(files?.length ?? null)} mostMs={LONG_WORK_MS} />}
            </>
          )}
        </div>
      </div>
    </Panel>
  );
}

function StarButton({ entry, onChanged }: { readonly entry: CaptureEntry; readonly onChanged: () => void }) {
  const operator = useOperator();
  const [asking, follow] = useUnderWay();
  return (
    <button
      type="button"
      className="button"
      aria-pressed={entry.starred}
      data-testid="star-capture"
      title={words.library.starHint}
      disabled={asking}
      onClick={() => {
        const done = operator.starCapture(entry.id, !entry.starred).then((changed) => {
          if (changed) onChanged();
        });
        follow(done);
      }}
    >
      <Icon name="star" />
      {words.library.star}
    </button>
  );
}

function RunFacts({ entry }: { readonly entry: CaptureEntry }) {
  const { value: file } = useAnswer(entry.id, () => getCaptureFile(entry.id));
  const text = words.library;
  const { metrics } = entry;
  const flown = flightSeconds(file?.seconds);
  const rows: (readonly [string, string])[] = [
    [text.started, moment(entry.started_at)],
    [words.mission.form.mode, modeWord(entry.mode)],
    [words.mission.pictures, text.pictures(entry.images, entry.images_total)],
    [text.flight, flown === null ? words.none : clock(flown)],
    [words.field.psnr, dB(metrics?.psnr_db)],
    [words.field.psnrObject, dB(metrics?.psnr_db_object)],
    [words.field.ssim, decimal(metrics?.ssim, 3)],
    [words.field.flip, decimal(metrics?.flip, 3)],
    [words.mission.run, entry.run],
  ];
  return (
    <>
      <dl className="findings">
        {rows.map(([word, value]) => (
          <div key={word}>
            <dt>{word}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {metrics?.images_held_out !== undefined && metrics.images !== undefined && (
        <p className="hint">{words.field.measuredOn(metrics.images_held_out, metrics.images)}</p>
      )}
      {entry.error !== null && <p className="field-error">{entry.error}</p>}
    </>
  );
}

function dB(value: number | null | undefined): string {
  return withUnit(value ?? null, 2, "dB");
}

/** What the address of a capture's replay ends with. */
export const REPLAY = "replay";

/** A recording can be looked at here, and flown again: by the program, as everything goes through the same pipeline. */
function Replay({ files, entry }: { readonly files: readonly Artifact[]; readonly entry: CaptureEntry }) {
  if (!files.some((file) => file.path === "recording.mcap")) return null;
  return (
    <div className="replay">
      {!isActiveState(entry.state) && (
        <a
          className="button button-small button-primary"
          href={hashOfScreen("library", `${entry.id}/${REPLAY}`)}
          data-testid="open-replay"
        >
          <Icon name="play" />
          {words.replay.open}
        </a>
      )}
      <p>
        {words.library.replay} <code>dronerf replay {entry.run}/recording.mcap</code>
      </p>
    </div>
  );
}

function Files({ files }: { readonly files: readonly Artifact[] }) {
  const text = words.library;
  const total = files.reduce((sum, file) => sum + file.size_bytes, 0);
  return (
    <section className="files" aria-label={text.files}>
      <h3>{text.filesOf(files.length, bytes(total))}</h3>
      {filesByFolder(files).map(({ folder, files: inside }) => (
        <details key={folder} open={folder === ""}>
          <summary>{folder === "" ? text.runFolder : text.folder(folder, inside.length)}</summary>
          <ul>
            {inside.map((file) => (
              <li key={file.path}>
                <a href={file.url} download={file.path.split("/").at(-1)}>
                  <Icon name="download" />
                  {folder === "" ? file.path : file.path.slice(folder.length + 1)}
                </a>
                <span>{bytes(file.size_bytes)}</span>
              </li>
            ))}
          </ul>
        </details>
      ))}
    </section>
  );
}
