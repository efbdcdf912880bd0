/** A rectangle of the floor: lower x, lower y, upper x, upper y, world metres. */
export type FloorArea = readonly [number, number, number, number];
export type FloorPoint = readonly [number, number];

/** What is drawn keeps to a grid of so many to the metre. */
const PER_METRE = 20;
/** Nothing that stands in a room is narrower; the server refuses it, too. */
const LEAST_M = 0.05;

function snapped(metres: number): number {
  return Math.round(metres * PER_METRE) / PER_METRE;
}

/** The rectangle between two corners, whichever way it was drawn. */
export function areaBetween([x0, y0]: FloorPoint, [x1, y1]: FloorPoint): FloorArea {
  return [
    snapped(Math.min(x0, x1)),
    snapped(Math.min(y0, y1)),
    snapped(Math.max(x0, x1)),
    snapped(Math.max(y0, y1)),
  ];
}

/** The rectangle, moved along with what was dragged; its size stays. */
export function moved([x0, y0, x1, y1]: FloorArea, from: FloorPoint, to: FloorPoint): FloorArea {
  const [dx, dy] = [snapped(to[0] - from[0]), snapped(to[1] - from[1])];
  return [tidy(x0 + dx), tidy(y0 + dy), tidy(x1 + dx), tidy(y1 + dy)];
}

export function isArea([x0, y0, x1, y1]: FloorArea): boolean {
  return tidy(x1 - x0) >= LEAST_M && tidy(y1 - y0) >= LEAST_M;
}

/** Sums of tenths without their rounding. */
function tidy(metres: number): number {
  return Math.round(metres * 1000) / 1000;
}
