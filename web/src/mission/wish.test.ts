import { describe, expect, it } from "vitest";
import { FIRST_WISH, requestFromWish, wishErrors } from "./wish";

describe("wishErrors", () => {
  it("finds nothing wrong with the defaults", () => {
    expect(wishErrors(FIRST_WISH)).toEqual({});
  });

  it.each(["", "3", "2.5", "1e9", "many"])("refuses %j pictures", (pictures) => {
    expect(Object.keys(wishErrors({ ...FIRST_WISH, pictures }))).toEqual(["pictures"]);
  });

  it.each(["", " ", "0.5", "-1", "abc", "1e6"])("refuses %j seconds of training", (trainSeconds) => {
    expect(Object.keys(wishErrors({ ...FIRST_WISH, trainSeconds }))).toEqual(["trainSeconds"]);
  });

  it("takes pictures only where no seconds are wanted", () => {
    expect(wishErrors({ ...FIRST_WISH, trainSeconds: "0" })).toEqual({});
  });

  it("refuses a name that is too long", () => {
    expect(Object.keys(wishErrors({ ...FIRST_WISH, name: "x".repeat(81) }))).toEqual(["name"]);
  });
});

describe("requestFromWish", () => {
  it("leaves out the number of drones when all shall fly", () => {
    expect(requestFromWish({ ...FIRST_WISH, name: " bin " })).toEqual({
      mode: "optimized",
      pictures: 24,
      train_seconds: 60,
      name: "bin",
    });
    expect(requestFromWish({ ...FIRST_WISH, drones: "3" }).drones).toBe(3);
  });
});
