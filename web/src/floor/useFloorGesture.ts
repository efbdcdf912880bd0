import { useEffect, useState } from "react";
import { areaBetween, isArea, moved, type FloorArea, type FloorPoint } from "./area";

/** What drawing on the floor means. */
export interface FloorDrawing {
  readonly onDrawn: (area: FloorArea) => void;
  readonly onMoved: (key: string, area: FloorArea) => void;
  readonly onChosen: (key: string | null) => void;
}

/** A rectangle on the floor that can be taken hold of. */
export interface MarkedArea {
  readonly key: string;
  readonly area: FloorArea;
  readonly label: string;
  readonly chosen?: boolean;
  /** Stays where it is. */
  readonly fixed?: boolean;
}

interface Gesture {
  readonly pointerId: number;
  readonly held: MarkedArea | null;
  readonly from: FloorPoint;
  readonly to: FloorPoint;
  /** Where on the screen it began, and whether it has gone farther than a finger trembles. */
  readonly at: FloorPoint;
  readonly far: boolean;
}

/** A shorter way on the screen is a click, pixels. */
const CLICK_PX = 8;

/**
 * Draw a rectangle by a drag over free floor, move one by a drag from inside it, choose by a click.
 *
 * Escape takes a drag back.
 */
export function useFloorGesture(
  areas: readonly MarkedArea[],
  drawing: FloorDrawing | undefined,
  world: (event: React.PointerEvent<SVGSVGElement>) => FloorPoint,
) {
  const [begun, setGesture] = useState<Gesture | null>(null);
  // Whoever stops drawing in the middle of a drag has drawn nothing.
  const gesture = drawing === undefined ? null : begun;
  const held = gesture?.held ?? null;
  const next =
    gesture?.far !== true
      ? null
      : held === null
        ? areaBetween(gesture.from, gesture.to)
        : moved(held.area, gesture.from, gesture.to);

  useEffect(() => {
    if (begun === null) return;
    const listen = (event: KeyboardEvent) => {
      if (event.key === "Escape") setGesture(null);
    };
    window.addEventListener("keydown", listen);
    return () => {
      window.removeEventListener("keydown", listen);
    };
  }, [begun]);

  const begin = (event: React.PointerEvent<SVGSVGElement>) => {
    if (gesture !== null || event.button !== 0) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    const from = world(event);
    // The one on top was drawn last.
    const under = areas.findLast(
      ({ area: [x0, y0, x1, y1] }) => from[0] >= x0 && from[0] <= x1 && from[1] >= y0 && from[1] <= y1,
    );
    const at = [event.clientX, event.clientY] as const;
    setGesture({ pointerId: event.pointerId, held: under ?? null, from, to: from, at, far: false });
  };
  const move = (event: React.PointerEvent<SVGSVGElement>) => {
    if (gesture?.pointerId !== event.pointerId) return;
    const [x, y] = gesture.at;
    const far = gesture.far || Math.hypot(event.clientX - x, event.clientY - y) > CLICK_PX;
    setGesture({ ...gesture, to: world(event), far });
  };
  const end = (event: React.PointerEvent<SVGSVGElement>) => {
    if (gesture?.pointerId !== event.pointerId) return;
    setGesture(null);
    drawing?.onChosen(held?.key ?? null);
    if (next === null) return;
    if (held === null) {
      if (isArea(next)) drawing?.onDrawn(next);
    } else if (held.fixed !== true) {
      drawing?.onMoved(held.key, next);
    }
  };
  const lose = (event: React.PointerEvent<SVGSVGElement>) => {
    if (gesture?.pointerId === event.pointerId) setGesture(null);
  };

  const shown = areas.map((each) =>
    next !== null && each.key === held?.key && each.fixed !== true ? { ...each, area: next } : each,
  );
  const drawn = next !== null && held === null && isArea(next) ? next : null;
  const handlers =
    drawing === undefined
      ? {}
      : {
          onPointerDown: begin,
          onPointerMove: move,
          onPointerUp: end,
          onPointerCancel: lose,
          onLostPointerCapture: lose,
        };
  return { shown, drawn, handlers };
}
