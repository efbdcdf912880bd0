import type { CodedTileHeader, TileHeader, TileMarks } from "./messages.gen";

/** One annotated picture as it came over the socket. */
export interface JpegTile {
  readonly kind: "jpeg";
  readonly header: TileHeader;
  readonly jpeg: Blob;
}

/** One picture as the drone sent it, after those that must be decoded before it, and what to draw on it. */
export interface CodedTile {
  readonly kind: "h264";
  readonly header: CodedTileHeader;
  readonly units: readonly Uint8Array<ArrayBuffer>[];
}

export type Tile = JpegTile | CodedTile;

/** A binary message that is not a tile; the text says what is wrong with it. */
export class TileError extends Error {
  override readonly name = "TileError";
}

const LENGTH_BYTES = 4;
/** A header is a few short fields and some outlines; anything longer is not ours. */
const LONGEST_HEADER_BYTES = 8192;

/**
 * Read a binary message: header length (4 bytes, big-endian), JSON header, JPEG or H.264.
 *
 * @throws TileError when the bytes are cut short or the header is not a tile header.
 */
export function parseTile(bytes: ArrayBuffer): Tile {
  if (bytes.byteLength < LENGTH_BYTES) {
    throw new TileError(`a tile of ${bytes.byteLength} bytes has no header length`);
  }
  const headerBytes = new DataView(bytes).getUint32(0, false);
  const start = LENGTH_BYTES + headerBytes;
  if (headerBytes > LONGEST_HEADER_BYTES || start > bytes.byteLength) {
    throw new TileError(`a header of ${headerBytes} bytes does not fit a tile of ${bytes.byteLength}`);
  }
  if (start === bytes.byteLength) {
    throw new TileError("a tile without a picture");
  }
  const header = parseHeader(new Uint8Array(bytes, LENGTH_BYTES, headerBytes));
  const data = new Uint8Array(bytes, start);
  if ("coding" in header) return { kind: "h264", header, units: unitsOf(data, header.sizes) };
  return { kind: "jpeg", header, jpeg: new Blob([data], { type: "image/jpeg" }) };
}

function unitsOf(
  data: Uint8Array<ArrayBuffer>,
  sizes: readonly number[],
): Uint8Array<ArrayBuffer>[] {
  const ends = sizes.map((_, k) => sizes.slice(0, k + 1).reduce((sum, size) => sum + size, 0));
  if (sizes.some((size) => size <= 0) || ends.at(-1) !== data.length) {
    throw new TileError(`pictures of ${sizes.join(" + ")} bytes in ${data.length}`);
  }
  return ends.map((end, k) => data.subarray(end - (sizes[k] ?? 0), end));
}

function parseHeader(bytes: Uint8Array): TileHeader | CodedTileHeader {
  let value: unknown;
  try {
    value = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes));
  } catch (error) {
    throw new TileError("a tile header that is not JSON", { cause: error });
  }
  if (typeof value !== "object" || value === null) {
    throw new TileError("a tile header that is not an object");
  }
  const { drone_id, sequence, age_s, damaged, coding, key, sizes, marks, note } = value as Record<
    keyof CodedTileHeader,
    unknown
  >;
  if (
    typeof drone_id !== "string" ||
    typeof sequence !== "number" ||
    typeof age_s !== "number" ||
    typeof damaged !== "boolean"
  ) {
    throw new TileError("a tile header with a missing or mistyped field");
  }
  const header = { drone_id, sequence, age_s, damaged };
  if (coding === undefined) return header;
  if (
    coding !== "h264" ||
    typeof key !== "boolean" ||
    !areNumbers(sizes) ||
    !(marks === null || areMarks(marks)) ||
    typeof note !== "string"
  ) {
    throw new TileError("a coded tile's header with a missing or mistyped field");
  }
  return { ...header, coding, key, sizes, marks, note };
}

function areMarks(value: unknown): value is TileMarks {
  if (typeof value !== "object" || value === null) return false;
  const { size, box, confidence, touches_edge, outlines, yaw_error_rad } = value as Record<
    keyof TileMarks,
    unknown
  >;
  return (
    areNumbers(size, 2) &&
    areNumbers(box, 4) &&
    typeof confidence === "number" &&
    typeof touches_edge === "boolean" &&
    Array.isArray(outlines) &&
    outlines.every((outline) => areNumbers(outline)) &&
    typeof yaw_error_rad === "number"
  );
}

function areNumbers(value: unknown, count?: number): value is number[] {
  return (
    Array.isArray(value) &&
    value.every((item) => typeof item === "number") &&
    (count === undefined || value.length === count)
  );
}
