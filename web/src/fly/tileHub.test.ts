import { describe, expect, it, vi } from "vitest";
import { TileHub } from "./tileHub";

describe("TileHub", () => {
  it("knows the tiles out of sight, and tells of changes alone", () => {
    const hub = new TileHub();
    const changed = vi.fn();
    const leave = hub.subscribe(changed);
    hub.setInSight("a", true);
    expect(changed).not.toHaveBeenCalled();
    hub.setInSight("a", false);
    hub.setInSight("b", false);
    const both = hub.outOfSight();
    hub.setInSight("b", false);
    expect(hub.outOfSight()).toBe(both);
    expect([...both]).toEqual(["a", "b"]);
    hub.setInSight("a", true);
    expect([...hub.outOfSight()]).toEqual(["b"]);
    expect(changed).toHaveBeenCalledTimes(3);
    leave();
    hub.setInSight("b", true);
    expect(changed).toHaveBeenCalledTimes(3);
  });

  it("knows whose pictures are shown", () => {
    const hub = new TileHub();
    const changed = vi.fn();
    hub.subscribe(changed);
    const first = hub.attach("a", () => Promise.resolve());
    const watched = hub.watched();
    expect([...watched]).toEqual(["a"]);
    expect(hub.watched()).toBe(watched);
    const second = hub.attach("a", () => Promise.resolve());
    // A tile that was replaced takes nothing away from the one in its place.
    first();
    expect([...hub.watched()]).toEqual(["a"]);
    second();
    expect([...hub.watched()]).toEqual([]);
    expect(changed).toHaveBeenCalledTimes(3);
  });
});
