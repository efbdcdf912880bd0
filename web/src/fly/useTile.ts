import { useEffect, useState, type RefObject } from "react";
import { useOperator } from "../context";
import type { Tile } from "../protocol/tile";
import { CodedVideo } from "../video/codedVideo";
import { drawMarks } from "../video/drawMarks";

/** What a tile knows about the pictures it has shown. */
export interface TileStats {
  /** Age of the picture on the screen, seconds; null before the first. */
  readonly ageS: number | null;
  readonly shownPerS: number;
  readonly damaged: boolean;
}

/** When pictures were shown, milliseconds of the browser's clock. */
interface Shown {
  readonly takenMs: number | null;
  readonly damaged: boolean;
  readonly timesMs: readonly number[];
}

const NOTHING_SHOWN: Shown = { takenMs: null, damaged: false, timesMs: [] };
const WINDOW_MS = 2000;
const LOOK_EVERY_MS = 250;
/** A picture at most so many behind the newest has merely been overtaken. */
const LATE_PICTURES = 60;

/**
 * Draw a drone's pictures into `canvas` and note the shown sequence on `frame`, and how it came.
 *
 * Drawing goes past React; only the numbers are looked at, four times a second.
 */
export function useTile(
  droneId: string,
  face: { readonly name: string; readonly colour: string },
  frame: RefObject<HTMLElement | null>,
  canvas: RefObject<HTMLCanvasElement | null>,
): TileStats {
  const operator = useOperator();
  const { tiles } = operator;
  const { name, colour } = face;
  const [stats, setStats] = useState(() => statsAt(NOTHING_SHOWN, 0));
  useEffect(() => {
    let shown = NOTHING_SHOWN;
    let newest = -1;
    const video = new CodedVideo(() => {
      operator.showPicturesOnly();
    });
    const detach = tiles.attach(droneId, async (tile: Tile) => {
      const { header } = tile;
      const arrivedMs = Date.now();
      const picture = tile.kind === "jpeg" ? await createImageBitmap(tile.jpeg) : await video.decode(tile);
      // Two decoders are at work: what came first may be ready last. A drone that was away counts anew.
      const late = header.sequence < newest && newest - header.sequence < LATE_PICTURES;
      try {
        if (canvas.current !== null && !late) {
          draw(canvas.current, picture);
          const drawing = canvas.current.getContext("2d");
          if (tile.kind === "h264" && drawing !== null) drawMarks(drawing, tile.header, name, colour);
        }
      } finally {
        // A decoder has few to give away.
        picture.close();
      }
      if (late) return;
      newest = header.sequence;
      frame.current?.setAttribute("data-sequence", String(header.sequence));
      frame.current?.setAttribute("data-coding", tile.kind);
      shown = {
        takenMs: arrivedMs - 1000 * header.age_s,
        damaged: header.damaged,
        timesMs: [...shown.timesMs.filter((ms) => ms > arrivedMs - WINDOW_MS), arrivedMs],
      };
    });
    const timer = setInterval(() => {
      // Out of sight no pictures are sent: coming back, the tile must not cry for want of them.
      if (!tiles.outOfSight().has(droneId)) setStats(statsAt(shown, Date.now()));
    }, LOOK_EVERY_MS);
    return () => {
      detach();
      video.close();
      clearInterval(timer);
    };
  }, [operator, tiles, droneId, name, colour, frame, canvas]);
  return stats;
}

function statsAt(shown: Shown, nowMs: number): TileStats {
  const recent = shown.timesMs.filter((ms) => ms > nowMs - WINDOW_MS);
  return {
    ageS: shown.takenMs === null ? null : Math.max(0, (nowMs - shown.takenMs) / 1000),
    shownPerS: recent.length / (WINDOW_MS / 1000),
    damaged: shown.damaged,
  };
}

function draw(canvas: HTMLCanvasElement, picture: ImageBitmap | VideoFrame): void {
  const [width, height] =
    picture instanceof ImageBitmap ? [picture.width, picture.height] : [picture.displayWidth, picture.displayHeight];
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  canvas.getContext("2d")?.drawImage(picture, 0, 0);
}
