/** Where the field is seen from, on a sphere about the object; the distance is a share of the pictures'. */
export interface FieldView {
  readonly azimuth_rad: number;
  readonly elevation_rad: number;
  readonly distance: number;
}

/** Below the floor there is nothing to see; straight from above a picture has no upright. */
const LOWEST_RAD = -0.3;
const HIGHEST_RAD = 1.5;
const NEAREST = 0.2;
const FARTHEST = 4;
/** A drag across the whole picture goes half way round, and from the floor to above. */
const TURN_RAD = Math.PI;
const RISE_RAD = Math.PI / 2;

/** Return the view after a drag by shares of the picture's width and height: what is grabbed comes along. */
export function dragged(view: FieldView, right: number, down: number): FieldView {
  return {
    ...view,
    azimuth_rad: view.azimuth_rad - TURN_RAD * right,
    elevation_rad: clamp(view.elevation_rad + RISE_RAD * down, LOWEST_RAD, HIGHEST_RAD),
  };
}

/** Return the view from `factor` times as far. */
export function moved(view: FieldView, factor: number): FieldView {
  return { ...view, distance: clamp(view.distance * factor, NEAREST, FARTHEST) };
}

/** Whether two views are the same, roundings of the way to the server and back aside. */
export function isSameView(a: FieldView, b: FieldView): boolean {
  const off = Math.max(
    Math.abs(a.azimuth_rad - b.azimuth_rad),
    Math.abs(a.elevation_rad - b.elevation_rad),
    Math.abs(a.distance - b.distance),
  );
  return off < 1e-6;
}

/** What a key does to the view, null where it does nothing. */
export function viewAfterKey(view: FieldView, key: string): FieldView | null {
  switch (key) {
    case "ArrowLeft":
      return dragged(view, 0.05, 0);
    case "ArrowRight":
      return dragged(view, -0.05, 0);
    case "ArrowUp":
      return dragged(view, 0, 0.05);
    case "ArrowDown":
      return dragged(view, 0, -0.05);
    case "+":
      return moved(view, 0.9);
    case "-":
      return moved(view, 1 / 0.9);
    default:
      return null;
  }
}

function clamp(value: number, least: number, most: number): number {
  return Math.min(most, Math.max(least, value));
}
