import { describe, expect, it } from "vitest";
import { parseTile, TileError, type JpegTile } from "./tile";

const HEADER = { drone_id: "drone-1", sequence: 70_001, age_s: 0.125, damaged: false };
const JPEG = Uint8Array.from([0xff, 0xd8, 1, 2, 3, 0xff, 0xd9]);

function message(headerText: string, jpeg: Uint8Array = JPEG, length?: number): ArrayBuffer {
  const header = new TextEncoder().encode(headerText);
  const bytes = new Uint8Array(4 + header.length + jpeg.length);
  new DataView(bytes.buffer).setUint32(0, length ?? header.length);
  bytes.set(header, 4);
  bytes.set(jpeg, 4 + header.length);
  return bytes.buffer;
}

describe("parseTile", () => {
  it("reads header and picture, byte for byte", async () => {
    const tile = parseTile(message(JSON.stringify(HEADER))) as JpegTile;
    expect(tile.kind).toBe("jpeg");
    expect(tile.header).toEqual(HEADER);
    expect(tile.jpeg.type).toBe("image/jpeg");
    expect(new Uint8Array(await tile.jpeg.arrayBuffer())).toEqual(JPEG);
  });

  it("counts the header in bytes, not in letters", () => {
    const tile = parseTile(message(JSON.stringify({ ...HEADER, drone_id: "drône-é" }))) as JpegTile;
    expect(tile.header.drone_id).toBe("drône-é");
    expect(tile.jpeg.size).toBe(JPEG.length);
  });

  const MARKS = {
    size: [960, 720],
    box: [1.5, 2, 30, 40],
    confidence: 0.9,
    touches_edge: false,
    outlines: [[1, 2, 3, 4, 5, 6]],
    yaw_error_rad: -0.1,
  };
  const CODED = { ...HEADER, coding: "h264", key: true, sizes: [JPEG.length], marks: MARKS, note: "" };

  it("reads a picture as the drone sent it, and what to draw on it", () => {
    for (const header of [CODED, { ...CODED, key: false, marks: null, note: "odd" }]) {
      const tile = parseTile(message(JSON.stringify(header)));
      expect(tile).toEqual({ kind: "h264", header, units: [JPEG] });
    }
    const two = parseTile(message(JSON.stringify({ ...CODED, sizes: [3, JPEG.length - 3] })));
    expect(two).toMatchObject({ units: [JPEG.slice(0, 3), JPEG.slice(3)] });
  });

  it.each([
    ["another coding", { ...CODED, coding: "vp9" }],
    ["no key", { ...CODED, key: undefined }],
    ["no note", { ...CODED, note: null }],
    ["sizes that do not fit", { ...CODED, sizes: [JPEG.length + 1] }],
    ["no sizes", { ...CODED, sizes: [] }],
    ["half a box", { ...CODED, marks: { ...MARKS, box: [1, 2, 3] } }],
    ["outlines of words", { ...CODED, marks: { ...MARKS, outlines: [["a"]] } }],
    ["no marks", { ...CODED, marks: undefined }],
  ])("refuses a coded tile with %s", (_, header) => {
    expect(() => parseTile(message(JSON.stringify(header)))).toThrow(TileError);
  });

  it("reads the length as big-endian", () => {
    const bytes = message(JSON.stringify(HEADER));
    const view = new DataView(bytes);
    view.setUint32(0, view.getUint32(0), true);
    expect(() => parseTile(bytes)).toThrow(TileError);
  });

  it.each([
    ["nothing", new ArrayBuffer(0)],
    ["half a length", new ArrayBuffer(3)],
    ["a header cut short", message(JSON.stringify(HEADER)).slice(0, 20)],
    ["a length beyond the end", message(JSON.stringify(HEADER), JPEG, 5000)],
    ["no picture", message(JSON.stringify(HEADER), new Uint8Array())],
    ["a header that is not JSON", message("{drone")],
    ["a header that is no object", message("17")],
    ["a header without sequence", message('{"drone_id":"a","age_s":0,"damaged":false}')],
    ["a sequence that is text", message(JSON.stringify({ ...HEADER, sequence: "7" }))],
  ])("refuses %s", (_, bytes) => {
    expect(() => parseTile(bytes)).toThrow(TileError);
  });

  it("refuses a header that is not UTF-8", () => {
    const bytes = message(JSON.stringify(HEADER));
    new Uint8Array(bytes)[16] = 0xff;
    expect(() => parseTile(bytes)).toThrow(TileError);
  });
});
