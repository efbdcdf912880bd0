import { useEffect, useRef, type RefObject } from "react";
import {
  applyCalibration,
  boardUrl,
  cancelCalibration,
  finishCalibration,
  startCalibration,
  type Calibration,
} from "../api/calibration";
import type { StartPlace } from "../api/setup";
import { useConsole } from "../context";
import { clock } from "../design/format";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { Asking } from "../design/Waiting";
import { TilePicture, useLiveTile } from "../fly/TilePicture";
import type { DroneReport } from "../protocol/messages.gen";
import { words } from "../text/words";
import { canGoOn, coverageShare, goesOn, wantsRest } from "./calibrating";
import { CalibrationResult } from "./CalibrationResult";
import { CoverageGrid } from "./CoverageGrid";
import { useCalibration, type CalibrationDesk } from "./useCalibration";

interface CalibrationPanelProps {
  readonly place: StartPlace;
  readonly onClose: () => void;
  /** The camera that flies is another one now. */
  readonly onUsed: () => void;
}

/** Calibrate one drone's camera: how, the board, what the camera sees, how far it is, the result. */
export function CalibrationPanel({ place, onClose, onUsed }: CalibrationPanelProps) {
  const report = useConsole((state) => state.drones.get(place.drone_id)?.report);
  const desk = useCalibration(place.drone_id);
  const top = useRef<HTMLDivElement>(null);
  useArrival(top);
  const { calibration, error, refusal } = desk;
  const text = words.setup.calibrating;
  const idle = calibration?.state === "idle";
  const picture = report !== undefined && calibration?.state !== "solved" && (
    <LivePicture key="picture" report={report} />
  );
  // Read before the first view; from then on what the camera sees comes first.
  const how = (
    <>
      <ol className="steps">
        {text.steps.map((step) => (
          <li key={step}>{step}</li>
        ))}
      </ol>
      <BoardSheet droneId={place.drone_id} />
    </>
  );
  return (
    <Panel
      title={text.title(place.name)}
      className="calibrating"
      aside={
        <button type="button" className="button button-small button-quiet" onClick={onClose}>
          <Icon name="close" />
          {text.close}
        </button>
      }
    >
      <div ref={top} className="calibrating-body" tabIndex={-1} data-testid="calibrating" data-state={calibration?.state}>
        {calibration === null && error === null && <Asking />}
        {error !== null && <p className="field-error">{text.stale(error)}</p>}
        {idle && how}
        {!idle && picture}
        {calibration !== null && (
          <>
            <Course calibration={calibration} />
            {calibration.state === "solved" && calibration.result !== null && (
              <CalibrationResult
                calibration={calibration}
                camera={calibration.result}
                asking={desk.asking}
                onUse={() => {
                  void desk.ask(applyCalibration).then((done) => {
                    if (done) onUsed();
                  });
                }}
              />
            )}
            {refusal !== null && (
              <p className="field-error" role="alert">
                {text.failed(refusal)}
              </p>
            )}
            <Buttons calibration={calibration} desk={desk} />
            {desk.asking && <Asking />}
          </>
        )}
        {idle ? picture : how}
      </div>
    </Panel>
  );
}

/** Bring the panel that was just opened into sight, and let the keyboard go on in it. */
function useArrival(top: RefObject<HTMLDivElement | null>): void {
  useEffect(() => {
    top.current?.focus({ preventScroll: true });
    top.current?.parentElement?.scrollIntoView({ block: "start" });
  }, [top]);
}

function LivePicture({ report }: { readonly report: DroneReport }) {
  const frame = useRef<HTMLElement>(null);
  const tile = useLiveTile(report, frame);
  return (
    <figure
      ref={frame}
      className={`tile ${tile.gone ? "is-gone" : tile.old ? "is-old" : ""}`}
      style={{ "--drone": report.colour } as React.CSSProperties}
      data-testid="calibration-picture"
    >
      <div className="tile-picture is-only-seen">
        <TilePicture name={report.name} tile={tile} />
      </div>
    </figure>
  );
}

/** What to do next and how far it is; why it is over. */
function Course({ calibration }: { readonly calibration: Calibration }) {
  const text = words.setup.calibrating;
  const { state, hint, views, views_wanted: wanted, tilted, tilted_wanted: tiltsWanted } = calibration;
  if (state === "idle") return null;
  const [sideways, upDown] = tilted;
  return (
    <>
      <p className={`calibration-hint is-${state}`} role="status" data-testid="calibration-hint">
        {state === "collecting" && (hint === null ? text.noPicture : text.hint[hint])}
        {state === "solving" && text.solving}
        {state === "refused" && (calibration.lack === null ? calibration.reason : text.lack[calibration.lack])}
        {state === "ended" && (calibration.ending === null ? calibration.reason : text.ending[calibration.ending])}
      </p>
      {state === "solving" && <progress className="calibration-progress" aria-label={text.solving} />}
      {state === "collecting" && (
        <progress className="calibration-progress" aria-label={text.views} value={views} max={wanted} />
      )}
      {state !== "solved" && (
        <div className="calibration-course">
          <dl className="calibration-facts">
            <div>
              <dt>{text.views}</dt>
              <dd data-testid="calibration-views">{text.viewsOf(views, wanted)}</dd>
            </div>
            <div>
              <dt>{text.coverage}</dt>
              <dd>{text.percent(Math.round(100 * coverageShare(calibration.coverage)))}</dd>
            </div>
            <div>
              <dt>{text.sideways}</dt>
              <dd>{text.tiltsOf(sideways, tiltsWanted)}</dd>
            </div>
            <div>
              <dt>{text.upDown}</dt>
              <dd>{text.tiltsOf(upDown, tiltsWanted)}</dd>
            </div>
            <div>
              <dt>{text.spent}</dt>
              <dd>{clock(calibration.spent_s)}</dd>
            </div>
          </dl>
          <CoverageGrid coverage={calibration.coverage} />
        </div>
      )}
      {wantsRest(calibration) && (
        <p className="calibration-rest">
          <Icon name="warning" /> {text.rest}
        </p>
      )}
    </>
  );
}

function Buttons({ calibration, desk }: { readonly calibration: Calibration; readonly desk: CalibrationDesk }) {
  const text = words.setup.calibrating;
  const { asking, ask } = desk;
  const begin = (goOn: boolean) => {
    void ask((droneId) => startCalibration(droneId, goOn));
  };
  if (goesOn(calibration)) {
    return (
      <>
        <div className="calibration-buttons">
          <button
            type="button"
            className="button"
            data-testid="calibration-finish"
            disabled={asking || calibration.state === "solving"}
            onClick={() => {
              void ask(finishCalibration);
            }}
          >
            <Icon name="check" />
            {text.finish}
          </button>
          <button
            type="button"
            className="button"
            data-testid="calibration-cancel"
            disabled={asking}
            onClick={() => {
              void ask(cancelCalibration);
            }}
          >
            <Icon name="close" />
            {text.cancel}
          </button>
        </div>
        <p className="hint">{text.finishDoes(calibration.views_least)}</p>
      </>
    );
  }
  const first = calibration.state === "idle";
  return (
    <div className="calibration-buttons">
      {canGoOn(calibration) && (
        <button
          type="button"
          className="button"
          data-testid="calibration-go-on"
          disabled={asking}
          onClick={() => {
            begin(true);
          }}
        >
          <Icon name="add" />
          {text.goOn}
        </button>
      )}
      <button
        type="button"
        className={`button ${first ? "button-primary" : ""}`}
        data-testid="calibration-start"
        disabled={asking}
        onClick={() => {
          begin(false);
        }}
      >
        <Icon name={first ? "play" : "rearm"} />
        {first ? text.start : text.anew}
      </button>
    </div>
  );
}

function BoardSheet({ droneId }: { readonly droneId: string }) {
  const text = words.setup.calibrating;
  return (
    <figure className="board-sheet">
      <img src={boardUrl(droneId, "png")} alt={text.board} width={276} height={208} />
      <figcaption>
        <p className="hint">{text.board}</p>
        <div className="calibration-buttons">
          <a className="button button-small" href={boardUrl(droneId, "pdf")} target="_blank" rel="noreferrer">
            <Icon name="picture" />
            {text.pdf}
          </a>
          <a className="button button-small" href={boardUrl(droneId, "png")} download="dronerf-board.png">
            <Icon name="download" />
            {text.png}
          </a>
        </div>
      </figcaption>
    </figure>
  );
}
