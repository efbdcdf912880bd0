import { describe, expect, it } from "vitest";
import { takesText } from "./holdKey";

describe("takesText", () => {
  it.each([
    [{ tagName: "INPUT", type: "text" }, true],
    [{ tagName: "INPUT", type: "search" }, true],
    [{ tagName: "TEXTAREA" }, true],
    [{ tagName: "DIV", isContentEditable: true }, true],
    [{ tagName: "INPUT", type: "number" }, false],
    [{ tagName: "INPUT", type: "checkbox" }, false],
    [{ tagName: "BUTTON", type: "button" }, false],
    [{ tagName: "SELECT" }, false],
    [{ tagName: "BODY", isContentEditable: false }, false],
    [null, false],
  ])("%j: %s", (target, expected) => {
    expect(takesText(target)).toBe(expected);
  });
});
