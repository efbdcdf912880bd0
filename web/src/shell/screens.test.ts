import { describe, expect, it } from "vitest";
import { hashOfScreen, screenOfHash, SCREENS } from "./screens";

describe("screenOfHash", () => {
  it.each(["", "#", "#/", "#/nowhere", "#/constructor"])("%j is where one flies", (hash) => {
    expect(screenOfHash(hash)).toEqual({ screen: "fly", rest: "" });
  });

  it.each(SCREENS)("finds back to %s", (screen) => {
    expect(screenOfHash(hashOfScreen(screen))).toEqual({ screen, rest: "" });
    expect(screenOfHash(hashOfScreen(screen, "a b/c"))).toEqual({ screen, rest: "a b/c" });
  });
});
