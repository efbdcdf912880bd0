import { describe, expect, it } from "vitest";
import type { WayPoint } from "../api/replay";
import { countUntil, filmCourse, wayUntil } from "./flightCourse";

describe("a replay's course", () => {
  it("counts what is not later, also between and beyond", () => {
    const times = [0, 1, 1, 4];
    expect([-1, 0, 0.5, 1, 3.9, 4, 9].map((atS) => countUntil(times, atS))).toEqual([0, 1, 1, 3, 3, 4, 4]);
    expect(countUntil([], 1)).toBe(0);
  });

  it("ends a way where the drone is", () => {
    const way: WayPoint[] = [0, 1, 2].map((at) => [at, at, 0, 0.5, 0]);
    expect(wayUntil(way, 1.5).at(-1)?.[1]).toBe(1);
    expect(wayUntil(way, -1)).toEqual([]);
  });
});

describe("a film's course", () => {
  const film = (currentS: number) => ({ beginsS: 2, lengthS: 10, currentS });

  it("runs on its own while it is about right", () => {
    expect(filmCourse(film(3.2), 5, true)).toEqual({ seekS: null, plays: true });
    expect(filmCourse(film(1), 5, true)).toEqual({ seekS: 3, plays: true });
  });

  it("stands exactly where the replay stands", () => {
    expect(filmCourse(film(3.2), 5, false)).toEqual({ seekS: 3, plays: false });
  });

  it("waits at its first picture and stays at its last one", () => {
    expect(filmCourse(film(0), 1, true)).toEqual({ seekS: null, plays: false });
    expect(filmCourse(film(4), 60, true)).toEqual({ seekS: 10, plays: false });
  });
});
