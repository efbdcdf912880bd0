import { describe, expect, it } from "vitest";
import { dragged, moved, viewAfterKey, type FieldView } from "./fieldView";

const VIEW: FieldView = { azimuth_rad: 1, elevation_rad: 0.2, distance: 1 };

describe("the view of the field", () => {
  it("brings along what is grabbed", () => {
    // Dragged to the right, the camera goes to the left: clockwise about the object.
    expect(dragged(VIEW, 0.5, 0).azimuth_rad).toBeCloseTo(1 - Math.PI / 2);
    expect(dragged(VIEW, 0, 0.2).elevation_rad).toBeGreaterThan(0.2);
  });

  it("never goes under the floor, over the top, through the object or out of sight", () => {
    expect(dragged(VIEW, 0, -9).elevation_rad).toBe(-0.3);
    expect(dragged(VIEW, 0, 9).elevation_rad).toBe(1.5);
    expect(moved(VIEW, 0.01).distance).toBe(0.2);
    expect(moved(VIEW, 100).distance).toBe(4);
  });

  it("follows arrows, plus and minus, and no other key", () => {
    expect(viewAfterKey(VIEW, "ArrowLeft")).toEqual(dragged(VIEW, 0.05, 0));
    expect(viewAfterKey(VIEW, "+")?.distance).toBeLessThan(1);
    expect(viewAfterKey(VIEW, "Tab")).toBeNull();
  });
});
