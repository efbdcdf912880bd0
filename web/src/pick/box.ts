/** Left, top, right, bottom as shares 0 to 1 of a picture. */
export type ShareBox = readonly [left: number, top: number, right: number, bottom: number];

/** A place in a picture as shares 0 to 1, from its top left corner. */
export interface SharePoint {
  readonly x: number;
  readonly y: number;
}

/** The part of an element's rectangle that matters here. */
interface Area {
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
}

/** What a gesture meant: the object lies at a point, or fills a box. */
export type Place =
  | { readonly kind: "point"; readonly point: SharePoint }
  | { readonly kind: "box"; readonly box: ShareBox };

/** A press that moved less than this many pixels is a click; fingers are not steady. */
const CLICK_PX = 8;
/** Sides below this share are no box: the server refuses them too. */
const SMALLEST = 0.02;
/** Keys move the box by this much, and with Shift its far corner. */
const STEP = 0.02;

/** Where the keyboard's box begins: the middle of the picture. */
export const MIDDLE: ShareBox = [0.35, 0.3, 0.65, 0.7];

/** Return the place of a pointer in a picture shown in `area`, held inside it. */
export function shareAt(clientX: number, clientY: number, area: Area): SharePoint {
  return {
    x: within((clientX - area.left) / area.width),
    y: within((clientY - area.top) / area.height),
  };
}

/** Return the box between two corners, whichever way it was drawn. */
export function boxBetween(a: SharePoint, b: SharePoint): ShareBox {
  return [Math.min(a.x, b.x), Math.min(a.y, b.y), Math.max(a.x, b.x), Math.max(a.y, b.y)];
}

/** True where both sides are long enough to mean a box. */
export function isBox([left, top, right, bottom]: ShareBox): boolean {
  return right - left >= SMALLEST && bottom - top >= SMALLEST;
}

/** Return what a press from `a` to `b` meant; null where it was neither a click nor a box. */
export function placeOf(a: SharePoint, b: SharePoint, area: Area): Place | null {
  const movedPx = Math.hypot((b.x - a.x) * area.width, (b.y - a.y) * area.height);
  if (movedPx < CLICK_PX) return { kind: "point", point: b };
  const box = boxBetween(a, b);
  return isBox(box) ? { kind: "box", box } : null;
}

/** Return the box after an arrow key: moved, or with `resize` its far corner; null for other keys. */
export function nudged(box: ShareBox, key: string, resize: boolean): ShareBox | null {
  const step = STEPS.get(key);
  if (step === undefined) return null;
  const [left, top, right, bottom] = box;
  if (resize) {
    return [
      left,
      top,
      clamped(right + step.x, left + STEP, 1),
      clamped(bottom + step.y, top + STEP, 1),
    ];
  }
  const x = clamped(step.x, -left, 1 - right);
  const y = clamped(step.y, -top, 1 - bottom);
  return [left + x, top + y, right + x, bottom + y];
}

const STEPS: ReadonlyMap<string, SharePoint> = new Map([
  ["ArrowLeft", { x: -STEP, y: 0 }],
  ["ArrowRight", { x: STEP, y: 0 }],
  ["ArrowUp", { x: 0, y: -STEP }],
  ["ArrowDown", { x: 0, y: STEP }],
]);

function within(share: number): number {
  return clamped(share, 0, 1);
}

function clamped(value: number, least: number, most: number): number {
  return Math.min(Math.max(value, least), most);
}
