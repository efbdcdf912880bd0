import { useEffect, useRef, type RefObject } from "react";
import { useOperator } from "../context";
import { useNow } from "../design/useNow";
import type { Tile } from "../protocol/tile";

/** What a tile knows about the pictures it has shown. */
export interface TileStats {
  /** Age of the picture on the screen, seconds; null before the first. */
  readonly ageS: number | null;
  readonly shownPerS: number;
  readonly damaged: boolean;
}

const WINDOW_MS = 2000;
const LOOK_EVERY_MS = 250;

/**
 * Draw a drone's pictures into `canvas` and note the shown sequence on `frame`.
 *
 * Drawing goes past React; only the numbers are looked at four times a second.
 */
export function useTile(
  droneId: string,
  frame: RefObject<HTMLElement | null>,
  canvas: RefObject<HTMLCanvasElement | null>,
): TileStats {
  const { tiles } = useOperator();
  const nowMs = useNow(LOOK_EVERY_MS);
  const shown = useRef<{ takenMs: number; damaged: boolean; timesMs: number[] }>({
    takenMs: Number.NaN,
    damaged: false,
    timesMs: [],
  });
  useEffect(
    () =>
      tiles.attach(droneId, async (tile: Tile) => {
        const arrivedMs = Date.now();
        const picture = await createImageBitmap(tile.jpeg);
        if (canvas.current !== null) draw(canvas.current, picture);
        picture.close();
        frame.current?.setAttribute("data-sequence", String(tile.header.sequence));
        const times = shown.current.timesMs.filter((ms) => ms > arrivedMs - WINDOW_MS);
        shown.current = {
          takenMs: arrivedMs - 1000 * tile.header.age_s,
          damaged: tile.header.damaged,
          timesMs: [...times, arrivedMs],
        };
      }),
    [tiles, droneId, frame, canvas],
  );
  return statsAt(shown.current, nowMs);
}

function statsAt(
  shown: { takenMs: number; damaged: boolean; timesMs: readonly number[] },
  nowMs: number,
): TileStats {
  const recent = shown.timesMs.filter((ms) => ms > nowMs - WINDOW_MS);
  return {
    ageS: Number.isNaN(shown.takenMs) ? null : Math.max(0, (nowMs - shown.takenMs) / 1000),
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
