import type { TileHeader } from "./messages.gen";

/** One annotated picture as it came over the socket. */
export interface Tile {
  readonly header: TileHeader;
  readonly jpeg: Blob;
}

/** A binary message that is not a tile; the text says what is wrong with it. */
export class TileError extends Error {
  override readonly name = "TileError";
}

const LENGTH_BYTES = 4;
/** A header is a few short fields; anything longer is not ours. */
const LONGEST_HEADER_BYTES = 4096;

/**
 * Read a binary message: header length (4 bytes, big-endian), JSON header, JPEG.
 *
 * @throws TileError when the bytes are cut short or the header is not a tile header.
 */
export function parseTile(bytes: ArrayBuffer): Tile {
  if (bytes.byteLength < LENGTH_BYTES) {
    throw new TileError(`a tile of ${bytes.byteLength} bytes has no header length`);
  }
  const headerBytes = new DataView(bytes).getUint32(0, false);
  const jpegStart = LENGTH_BYTES + headerBytes;
  if (headerBytes > LONGEST_HEADER_BYTES || jpegStart > bytes.byteLength) {
    throw new TileError(`a header of ${headerBytes} bytes does not fit a tile of ${bytes.byteLength}`);
  }
  if (jpegStart === bytes.byteLength) {
    throw new TileError("a tile without a picture");
  }
  const header = parseHeader(new Uint8Array(bytes, LENGTH_BYTES, headerBytes));
  return { header, jpeg: new Blob([new Uint8Array(bytes, jpegStart)], { type: "image/jpeg" }) };
}

function parseHeader(bytes: Uint8Array): TileHeader {
  let value: unknown;
  try {
    value = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes));
  } catch (error) {
    throw new TileError("a tile header that is not JSON", { cause: error });
  }
  if (typeof value !== "object" || value === null) {
    throw new TileError("a tile header that is not an object");
  }
  const { drone_id, sequence, age_s, damaged } = value as Record<keyof TileHeader, unknown>;
  if (
    typeof drone_id !== "string" ||
    typeof sequence !== "number" ||
    typeof age_s !== "number" ||
    typeof damaged !== "boolean"
  ) {
    throw new TileError("a tile header with a missing or mistyped field");
  }
  return { drone_id, sequence, age_s, damaged };
}
