import { describe, expect, it } from "vitest";
import type { MetricsReport, PosesReport, TrainingReport } from "../protocol/messages.gen";
import { blurredPictures, pictureState } from "./pictureState";

const training = (stage: string, images = 24) => ({ stage, images }) as TrainingReport;
const poses = { unrefined: [3] } as unknown as PosesReport;

describe("pictureState", () => {
  it("knows nothing before anything was told", () => {
    expect(pictureState(0, null, null, null)).toEqual({ heldOut: false, pose: "waiting", used: false });
  });

  it("holds every eighth picture out of the judged training", () => {
    const held = [...Array(24).keys()].filter((i) => pictureState(i, poses, training("train"), null).heldOut);
    expect(held).toEqual([0, 8, 16]);
    expect(pictureState(8, poses, training("train"), null).used).toBe(false);
    expect(pictureState(9, poses, training("train"), null).used).toBe(true);
  });

  it("uses all of them for the model that is delivered", () => {
    expect(pictureState(8, poses, training("deliver"), {} as MetricsReport)).toEqual({
      heldOut: true,
      pose: "refined",
      used: true,
    });
  });

  it("names those whose pose is the flight's", () => {
    expect(pictureState(3, poses, training("train"), null).pose).toBe("flight");
  });

  it("uses no picture that training has not got yet", () => {
    expect(pictureState(5, null, training("live", 5), null).used).toBe(false);
    expect(pictureState(4, null, training("live", 5), null).used).toBe(true);
  });
});

describe("blurredPictures", () => {
  const taken = (drone_id: string, ...sharpness: (number | null)[]) =>
    sharpness.map((value, index) => ({ index: drone_id === "a" ? index : 10 + index, drone_id, sharpness: value }));

  it("names what is far less sharp than the drone's other pictures", () => {
    const blurred = blurredPictures([...taken("a", 500, 480, 390, 200), ...taken("b", 210, 200, 220, 90)]);
    expect([...blurred]).toEqual([3, 13]);
  });

  it("judges nothing by one or two pictures, nor any that was not measured", () => {
    expect(blurredPictures(taken("a", 500, 100)).size).toBe(0);
    expect(blurredPictures(taken("a", 500, 500, 500, null)).size).toBe(0);
    expect(blurredPictures(taken("a", null, null, null)).size).toBe(0);
  });
});
