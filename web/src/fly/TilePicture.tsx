import { useRef, type ReactNode, type RefObject } from "react";
import { age } from "../design/format";
import { Icon } from "../design/Icon";
import type { DroneReport } from "../protocol/messages.gen";
import { words } from "../text/words";
import { useSight } from "./useSight";
import { useTile, type TileStats } from "./useTile";

/** A picture older than this is greyed. */
const OLD_S = 1;
/** A picture older than this is no live video any more. */
const GONE_S = 3;

/** A drone's live picture, as it is drawn and as it stands. */
interface LiveTile {
  readonly canvas: RefObject<HTMLCanvasElement | null>;
  readonly stats: TileStats;
  readonly wanted: boolean;
  readonly gone: boolean;
  readonly old: boolean;
}

/** Show a drone's pictures in a tile; `frame` is told which one is shown. */
export function useLiveTile(report: DroneReport, frame: RefObject<HTMLElement | null>): LiveTile {
  const { drone_id: droneId, name, colour, video_wanted: wanted } = report;
  const canvas = useRef<HTMLCanvasElement>(null);
  const stats = useTile(droneId, { name, colour }, frame, canvas);
  useSight(droneId, canvas);
  const gone = stats.ageS === null || stats.ageS > GONE_S || !wanted;
  return { canvas, stats, wanted, gone, old: !gone && stats.ageS > OLD_S };
}

interface TilePictureProps {
  readonly name: string;
  readonly tile: LiveTile;
  readonly children?: ReactNode;
}

/** The picture itself, and on it how fresh it is. */
export function TilePicture({ name, tile: { canvas, stats, wanted, gone, old }, children }: TilePictureProps) {
  const { ageS, shownPerS, damaged } = stats;
  return (
    <>
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
      {children}
    </>
  );
}
