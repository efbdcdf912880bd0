import { useEffect, useState, type RefObject } from "react";
import { useOperator } from "../context";
import type { Tile } from "../protocol/tile";

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

/**
 * Draw a drone's pictures into `canvas` and note the shown sequence on `frame`.
 *
 * Drawing goes past React; only the numbers are looked at, four times a second.
 */
export function useTile(
  droneId: string,
  frame: RefObject<HTMLElement | null>,
  canvas: RefObject<HTMLCanvasElement | null>,
): TileStats {
  const { tiles } = useOperator();
  const [stats, setStats] = useState(() => statsAt(NOTHING_SHOWN, 0));
  useEffect(() => {
    let shown = NOTHING_SHOWN;
    const detach = tiles.attach(droneId, async ({ header, jpeg }: Tile) => {
      const arrivedMs = Date.now();
      const picture = await createImageBitmap(jpeg);
      if (canvas.current !== null) draw(canvas.current, picture);
      picture.close();
      frame.current?.setAttribute("data-sequence", String(header.sequence));
      shown = {
        takenMs: arrivedMs - 1000 * header.age_s,
        damaged: header.damaged,
        timesMs: [...shown.timesMs.filter((ms) => ms > arrivedMs - WINDOW_MS), arrivedMs],
      };
    });
    const timer = setInterval(() => {
      setStats(statsAt(shown, Date.now()));
    }, LOOK_EVERY_MS);
    return () => {
      detach();
      clearInterval(timer);
    };
  }, [tiles, droneId, frame, canvas]);
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

function draw(canvas: HTMLCanvasElement, picture: ImageBitmap): void {
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  canvas.getContext("2d")?.drawImage(picture, 0, 0);
}
