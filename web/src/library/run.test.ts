import { describe, expect, it } from "vitest";
import type { CaptureEntry } from "../api/library";
import { differences, filesByFolder, flightSeconds, winner } from "./run";

const entry = (psnr: number | null, flip: number | null) =>
  ({ images: 24, metrics: { psnr_db: psnr, flip } }) as CaptureEntry;

describe("a run", () => {
  it("lists its own files before those of its folders", () => {
    const files = ["images/0000.jpg", "capture.json", "jobs/a/b.json", "images/0001.jpg"].map((path) => ({
      capture_id: "a",
      path,
      size_bytes: 1,
      modified_at: "",
      url: "",
    }));
    expect(filesByFolder(files).map((each) => [each.folder, each.files.length])).toEqual([
      ["", 1],
      ["images", 2],
      ["jobs", 1],
    ]);
    expect(filesByFolder([])).toEqual([]);
  });

  it("flies until it trains, and waiting on the ground is no flight", () => {
    expect(flightSeconds({ fly: 60, land: 4.5, train: 100, grounded: 300 })).toBe(64.5);
    expect(flightSeconds({ train: 3 })).toBeNull();
    expect(flightSeconds(undefined)).toBeNull();
  });
});

describe("winner", () => {
  const of = (a: CaptureEntry, b: CaptureEntry, key: string) => {
    const row = differences(a, b, null, null).find((each) => each.key === key);
    return row === undefined ? undefined : winner(row);
  };

  it("knows which way is better", () => {
    expect(of(entry(22, 0.3), entry(20, 0.2), "psnr")).toBe("a");
    expect(of(entry(22, 0.3), entry(20, 0.2), "flip")).toBe("b");
  });

  it("calls no winner where nothing can be seen of it, nothing was measured or nothing is better", () => {
    expect(of(entry(22.001, 0), entry(22.002, 0), "psnr")).toBeNull();
    expect(of(entry(22, 0), entry(null, 0), "psnr")).toBeNull();
    expect(of({ ...entry(1, 1), images: 8 }, entry(1, 1), "images")).toBeNull();
  });
});
