import { describe, expect, it } from "vitest";
import type { CaptureEntry } from "../api/library";
import type { Training } from "../api/trainings";
import { fieldKey, readFieldKey } from "./fieldKey";
import { differences, filesByFolder, flightSeconds, judgedAlike, markName, winner, type Field } from "./run";

const metrics = (psnr: number | null, flip: number | null) => ({ psnr_db: psnr, psnr_db_object: psnr, flip });
const entry = (psnr: number | null, flip: number | null, images = 24): Field => ({
  id: "run-1",
  name: "run-1",
  entry: { images, metrics: metrics(psnr, flip) } as CaptureEntry,
  training: null,
});
const anew = (psnr: number, objectOnly: boolean): Field => ({
  ...entry(10, 1),
  training: { seconds: 90, seed: 7, object_only: objectOnly, metrics: metrics(psnr, 0.1) } as Training,
});

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

describe("a mark", () => {
  it("is named by its capture, and its training where it is one", () => {
    const captures = [{ id: "run-1", name: "bin" }, { id: "run-2", name: "" }] as CaptureEntry[];
    expect(["run-1", "run-2", "run-3", "run-1~train-5"].map((key) => markName(key, captures))).toEqual([
      "bin",
      "run-2",
      "run-3",
      "bin, trained anew train-5",
    ]);
  });
});

describe("winner", () => {
  const of = (a: Field, b: Field, key: string) => {
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
    expect(of(entry(1, 1, 8), entry(1, 1), "images")).toBeNull();
  });

  it("calls no winner between a room and an object before white, but on the object", () => {
    expect(judgedAlike(entry(20, 0.2), anew(22, false))).toBe(true);
    expect(of(entry(20, 0.2), anew(22, false), "psnr")).toBe("b");
    expect(of(entry(20, 0.2), anew(30, true), "psnr")).toBeNull();
    expect(of(entry(20, 0.2), anew(30, true), "psnrObject")).toBe("b");
    expect(of(anew(22, true), anew(30, true), "psnr")).toBe("b");
  });
});

describe("a field trained anew", () => {
  it("is judged and set by itself, and flown with its capture", () => {
    const file = { seconds: { fly: 60 }, request: { train_seconds: 30, seed: 0 } };
    const rows = differences(entry(20, 0.2), anew(22, false), file, file);
    const told = Object.fromEntries(rows.map(({ key, a, b }) => [key, [a, b]]));
    expect(told).toMatchObject({ psnr: [20, 22], flight: [60, 60], training: [30, 90], seed: [0, 7] });
  });

  it("is named by its capture and its own run", () => {
    const key = fieldKey({ capture: "20260501-bin", id: "20260502-train.2" });
    expect(readFieldKey(key)).toEqual({ capture: "20260501-bin", training: "20260502-train.2" });
    expect(readFieldKey("20260501-bin")).toEqual({ capture: "20260501-bin", training: null });
  });
});
