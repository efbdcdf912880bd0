import { expect, it } from "vitest";
import { keptRenderings, renderingFile } from "./heldOut";

it("finds the renderings among a run's files, in order", () => {
  const paths = ["held_out/0016.jpg", "images/0001.jpg", renderingFile(0), "held_out/0008.jpg.part"];
  const files = paths.map((path) => ({ capture_id: "a", path, size_bytes: 1, modified_at: "", url: "" }));
  expect(keptRenderings(files)).toEqual([0, 16]);
});
