import type { CaptureEntry } from "../api/library";
import { getReplay, type Replay } from "../api/replay";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { clock as clockText } from "../design/format";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { hashOfScreen } from "../shell/screens";
import { words } from "../text/words";
import { Making } from "./Making";
import { MomentList } from "./MomentList";
import { ReplayFilm } from "./ReplayFilm";
import { ReplayMap } from "./ReplayMap";
import { useReplayClock } from "./useReplayClock";

/** For drones that the fleet of today does not have. */
const COLOURS = ["#e69f00", "#56b4e9", "#009e73", "#cc79a7"];
const SPEEDS = [0.5, 1, 2, 4];

/** A capture's recording: all videos, the way of every drone and what happened, in step. */
export function ReplayPanel({ entry }: { readonly entry: CaptureEntry }) {
  const { value: replay, error, asking, again } = useAnswer(entry.id, () => getReplay(entry.id));
  const text = words.replay;
  const name = entry.name === "" ? entry.id : entry.name;
  return (
    <Panel
      title={text.title(name)}
      className="run replay-panel"
      aside={<a href={hashOfScreen("library", entry.id)}>{text.back}</a>}
    >
      {error !== null && !asking && (
        <p className="field-error" role="alert">
          {text.failed(error)}{" "}
          <button type="button" className="button button-small" onClick={again}>
            {words.library.again}
          </button>
        </p>
      )}
      {replay === null && asking && <Making captureId={entry.id} />}
      {replay !== null && <Shown replay={replay} />}
    </Panel>
  );
}

function Shown({ replay }: { readonly replay: Replay }) {
  const drones = useConsole((state) => state.drones);
  const clock = useReplayClock(replay.seconds);
  const text = words.replay;
  const faces = replay.drones.map((drone, index) => {
    const report = drones.get(drone.drone_id)?.report;
    return {
      drone,
      name: report?.name ?? drone.drone_id,
      colour: report?.colour ?? COLOURS[index % COLOURS.length] ?? "var(--muted)",
    };
  });
  return (
    <div className="replay-body" data-testid="replay">
      <div className="replay-views">
        <div className="replay-films">
          {faces.map(({ drone, name, colour }) => (
            <ReplayFilm key={drone.drone_id} drone={drone} name={name} colour={colour} clock={clock} />
          ))}
        </div>
        <ReplayMap replay={replay} faces={faces} atS={clock.atS} />
      </div>
      <div className="replay-controls">
        <button
          type="button"
          className="button"
          data-testid="replay-run"
          onClick={() => {
            clock.run(!clock.running);
          }}
        >
          <Icon name={clock.running ? "pause" : "play"} />
          {clock.running ? text.stand : text.run}
        </button>
        <input
          type="range"
          min={0}
          max={replay.seconds}
          step={0.1}
          value={clock.atS}
          aria-label={text.place}
          aria-valuetext={text.at(clockText(clock.atS), clockText(replay.seconds))}
          data-testid="replay-place"
          onChange={(event) => {
            clock.seek(Number(event.target.value));
          }}
        />
        <span className="replay-time">
          {clockText(clock.atS)} / {clockText(replay.seconds)}
        </span>
        <select
          className="select-small"
          aria-label={text.speed}
          value={clock.speed}
          onChange={(event) => {
            clock.setSpeed(Number(event.target.value));
          }}
        >
          {SPEEDS.map((speed) => (
            <option key={speed} value={speed}>
              {speed}×
            </option>
          ))}
        </select>
      </div>
      <MomentList moments={replay.moments} faces={faces} atS={clock.atS} onChoose={clock.seek} />
    </div>
  );
}
