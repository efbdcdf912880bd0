import type { CodedTileHeader, TileMarks } from "../protocol/messages.gen";
import { words } from "../text/words";

/** A canvas that is not laid out is taken for one so wide. */
const WIDTH_PX = 640;
const INK = "rgb(24 24 24)";

/**
 * Draw into a picture what was seen in it, as the server does in its JPEGs: outline, box, centroid,
 * the way from the picture's centre to it, and whose picture it is.
 */
export function drawMarks(
  canvas: CanvasRenderingContext2D,
  { marks, note }: Pick<CodedTileHeader, "marks" | "note">,
  name: string,
  colour: string,
): void {
  const { width, height } = canvas.canvas;
  // Lines and letters are as large on the page, however large the tile is.
  const unit = width / (canvas.canvas.clientWidth || WIDTH_PX);
  canvas.lineJoin = "round";
  canvas.font = `${13 * unit}px system-ui, sans-serif`;
  canvas.textBaseline = "middle";
  const centre = { x: width / 2, y: height / 2 };
  drawLines(canvas, [
    [centre.x - 7 * unit, centre.y, centre.x + 7 * unit, centre.y],
    [centre.x, centre.y - 7 * unit, centre.x, centre.y + 7 * unit],
  ], "white", unit);
  if (marks !== null) drawSeen(canvas, marks, colour, unit, centre);
  // The tile's tools lie over the upper edge, its numbers over the right corner below.
  label(canvas, name, 8 * unit, height - 28 * unit, colour, unit);
  if (marks === null) label(canvas, words.fly.marks.nothing, 8 * unit, 34 * unit, "white", unit);
  if (note !== "") label(canvas, note, 8 * unit, 60 * unit, "white", unit);
}

function drawSeen(
  canvas: CanvasRenderingContext2D,
  marks: TileMarks,
  colour: string,
  unit: number,
  centre: { readonly x: number; readonly y: number },
): void {
  const scale = canvas.canvas.width / (marks.size[0] ?? 1);
  const placed = (px: number) => (px + 0.5) * scale;
  for (const [wide, ink] of [
    [3, INK],
    [1.2, colour],
  ] as const) {
    canvas.beginPath();
    for (const outline of marks.outlines) {
      for (let k = 0; k + 1 < outline.length; k += 2) {
        const x = placed(outline[k] ?? 0);
        const y = placed(outline[k + 1] ?? 0);
        if (k === 0) canvas.moveTo(x, y);
        else canvas.lineTo(x, y);
      }
      canvas.closePath();
    }
    canvas.lineWidth = wide * unit;
    canvas.strokeStyle = ink;
    canvas.stroke();
  }
  const [left = 0, top = 0, right = 0, bottom = 0] = marks.box.map(placed);
  canvas.lineWidth = 2 * unit;
  canvas.strokeStyle = colour;
  canvas.strokeRect(left, top, right - left, bottom - top);
  const middle = { x: (left + right) / 2, y: (top + bottom) / 2 };
  drawLines(canvas, [[centre.x, centre.y, middle.x, middle.y]], "white", unit);
  canvas.beginPath();
  canvas.arc(middle.x, middle.y, 4 * unit, 0, 2 * Math.PI);
  canvas.fillStyle = colour;
  canvas.fill();
  // Never under the tile's tools.
  label(canvas, seenText(marks), left, Math.max(top - 24 * unit, 34 * unit), colour, unit);
}

/** How sure it is, how far and which way to turn to face it (equation 4), and whether it is cut. */
function seenText(marks: TileMarks): string {
  const text = words.fly.marks;
  const degrees = Math.round((Math.abs(marks.yaw_error_rad) * 180) / Math.PI);
  const turn = degrees === 0 ? text.facing : marks.yaw_error_rad > 0 ? text.left(degrees) : text.right(degrees);
  const parts = [text.object(Math.round(100 * marks.confidence)), turn];
  if (marks.touches_edge) parts.push(text.cutOff);
  return parts.join(", ");
}

function drawLines(
  canvas: CanvasRenderingContext2D,
  lines: readonly (readonly [number, number, number, number])[],
  ink: string,
  unit: number,
): void {
  canvas.beginPath();
  for (const [x0, y0, x1, y1] of lines) {
    canvas.moveTo(x0, y0);
    canvas.lineTo(x1, y1);
  }
  canvas.lineWidth = unit;
  canvas.strokeStyle = ink;
  canvas.stroke();
}

/** Write on a dark plate, kept within the picture. */
function label(
  canvas: CanvasRenderingContext2D,
  text: string,
  x: number,
  y: number,
  colour: string,
  unit: number,
): void {
  const width = canvas.measureText(text).width + 8 * unit;
  const height = 20 * unit;
  const left = Math.max(0, Math.min(x, canvas.canvas.width - width));
  const top = Math.max(0, Math.min(y, canvas.canvas.height - height));
  canvas.fillStyle = INK;
  canvas.fillRect(left, top, width, height);
  canvas.fillStyle = colour;
  canvas.fillText(text, left + 4 * unit, top + height / 2);
}
