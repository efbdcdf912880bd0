import { describe, expect, it } from "vitest";
import { pathBelow } from "./base";

describe("pathBelow", () => {
  it("is empty where nothing stands before the console", () => {
    expect(pathBelow("http://127.0.0.1:8000/")).toBe("");
    expect(pathBelow("http://127.0.0.1:8000/?lang=de#/fly")).toBe("");
  });

  it("is the path that a proxy puts before it", () => {
    expect(pathBelow("https://lab.example/drones/#/library/run-1")).toBe("/drones");
    expect(pathBelow("https://lab.example/a/b/index.html")).toBe("/a/b");
  });
});
