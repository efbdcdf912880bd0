import { useEffect, useRef, type RefObject } from "react";
import { useConsole, useOperator } from "../context";
import { age } from "../design/format";
import { Icon } from "../design/Icon";
import type { DroneState } from "../state/state";
import { TileTools } from "../pick/TileTools";
import { words } from "../text/words";
import { DroneCard } from "./DroneCard";
import { useTile } from "./useTile";

interface VideoTileProps {
  readonly drone: DroneState;
  /** `large` is the one enlarged tile, `small` one beside it, `even` one of equals. */
  readonly size: "even" | "large" | "small";
  readonly onToggle: () => void;
}

/** A picture older than this is greyed. */
const OLD_S = 1;
/** A picture older than this is no live video any more. */
const GONE_S = 3;

/** One drone: its live picture and, below it, how it is. */
export function VideoTile({ drone, size, onToggle }: VideoTileProps) {
  const { drone_id: droneId, name, colour } = drone.report;
  const frame = useRef<HTMLElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const { ageS, shownPerS, damaged } = useTile(droneId, { name, colour }, frame, canvas);
  useSight(droneId, canvas);
  const { video_wanted: wanted } = drone.report;
  const gone = ageS === null || ageS > GONE_S || !wanted;
  const old = !gone && ageS > OLD_S;
  const apart = useConsole((state) => state.disagreement?.drone_ids.includes(droneId) === true);
  return (
    <article
      ref={frame}
      className={`tile tile-${size} ${gone ? "is-gone" : old ? "is-old" : ""} ${apart ? "is-apart" : ""} ${drone.report.held ? "is-held" : ""}`}
      style={{ "--drone": colour } as React.CSSProperties}
      aria-label={words.fly.tile(name)}
      data-testid={`tile-${droneId}`}
    >
      <div className="tile-view">
        <button
          type="button"
          className="tile-picture"
          aria-label={size === "large" ? words.fly.unfocus : words.fly.focus(name)}
          aria-pressed={size === "large"}
          onClick={onToggle}
        >
          <canvas ref={canvas} width={640} height={480} role="img" aria-label={words.fly.video(name)} />
          {gone && (
            <span className={`tile-gone ${wanted ? "" : "is-calm"}`}>
              <strong>{wanted ? words.fly.noVideo : words.fly.videoOff}</strong>
              <span>
                {!wanted
                  ? words.fly.videoOffWhy
                  : ageS === null
                    ? words.fly.neverVideo
                    : words.fly.noVideoFor(age(ageS))}
              </span>
            </span>
          )}
          {!gone && (
            <span className="tile-stats">
              {damaged && (
                <span className="tile-damaged">
                  <Icon name="warning" />
                  {words.fly.damaged}
                </span>
              )}
              <span>{words.fly.fps(shownPerS.toFixed(0))}</span>
              <span className={old ? "is-late" : ""}>{age(ageS)}</span>
            </span>
          )}
          {size === "large" && (
            <span className="tile-shrink">
              <Icon name="shrink" />
            </span>
          )}
        </button>
        <TileTools drone={drone} live={!gone} />
      </div>
      <DroneCard drone={drone} brief={size === "small"} />
    </article>
  );
}

/** Say when the picture is scrolled out of sight: it need not be sent then. */
function useSight(droneId: string, canvas: RefObject<HTMLCanvasElement | null>): void {
  const { tiles } = useOperator();
  useEffect(() => {
    const element = canvas.current;
    if (element === null) return;
    const observer = new IntersectionObserver((entries) => {
      tiles.setInSight(droneId, entries.at(-1)?.isIntersecting ?? true);
    });
    observer.observe(element);
    return () => {
      observer.disconnect();
      tiles.setInSight(droneId, true);
    };
  }, [tiles, droneId, canvas]);
}
