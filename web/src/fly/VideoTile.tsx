import { useRef } from "react";
import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import type { DroneState } from "../state/state";
import { TileTools } from "../pick/TileTools";
import { words } from "../text/words";
import { DroneCard } from "./DroneCard";
import { TilePicture, useLiveTile } from "./TilePicture";

interface VideoTileProps {
  readonly drone: DroneState;
  /** `large` is the one enlarged tile, `small` one beside it, `even` one of equals. */
  readonly size: "even" | "large" | "small";
  readonly onToggle: () => void;
}

/** One drone: its live picture and, below it, how it is. */
export function VideoTile({ drone, size, onToggle }: VideoTileProps) {
  const { drone_id: droneId, name, colour } = drone.report;
  const frame = useRef<HTMLElement>(null);
  const tile = useLiveTile(drone.report, frame);
  const apart = useConsole((state) => state.disagreement?.drone_ids.includes(droneId) === true);
  return (
    <article
      ref={frame}
      className={`tile tile-${size} ${tile.gone ? "is-gone" : tile.old ? "is-old" : ""} ${apart ? "is-apart" : ""} ${drone.report.held ? "is-held" : ""}`}
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
          <TilePicture name={name} tile={tile}>
            {size === "large" && (
              <span className="tile-shrink">
                <Icon name="shrink" />
              </span>
            )}
          </TilePicture>
        </button>
        <TileTools drone={drone} live={!tile.gone} />
      </div>
      <DroneCard drone={drone} brief={size === "small"} />
    </article>
  );
}
