import { createElement } from "react";
import { renderToStaticMarkup } from "react-dom/server";
import { describe, expect, it } from "vitest";
import type { Check } from "../api/safety";
import { CheckRow } from "./CheckRow";
import { groups, overridesFrom, readiness } from "./readiness";

function check(key: string, changes: Partial<Check> = {}): Check {
  const [item = key, droneId = null] = key.split(".").reverse();
  return {
    key,
    item,
    drone_id: droneId,
    passed: true,
    found: "as it should be",
    remedy: "",
    final: false,
    ...changes,
  };
}

const DISK = check("disk");
const FAILED = { passed: false, found: "leans 14 degrees", remedy: "Set it down level." };
const FLEET = [check("a.link"), check("a.level"), check("b.link"), check("b.level"), check("c.link"), DISK];

function fleetWith(...failed: readonly Check[]): readonly Check[] {
  return FLEET.map((each) => failed.find((other) => other.key === each.key) ?? each);
}

describe("groups", () => {
  it("goes drone by drone with the console last", () => {
    expect(groups([DISK, ...FLEET.slice(0, 5)]).map((group) => group.droneId)).toEqual(["a", "b", "c", null]);
  });
});

describe("readiness", () => {
  it("is clear when everything passed", () => {
    expect(readiness(FLEET, null, {})).toEqual({ crew: ["a", "b", "c"], ready: ["a", "b", "c"], blockers: [] });
  });

  it("is blocked by a failed item until somebody says why it is safe", () => {
    const checks = fleetWith(check("b.level", FAILED));
    expect(readiness(checks, null, {}).blockers.map((each) => each.key)).toEqual(["b.level"]);
    expect(readiness(checks, null, { "b.level": "  " }).blockers).toHaveLength(1);
    expect(readiness(checks, null, { "b.level": "ok" }).blockers).toHaveLength(1);
    expect(readiness(checks, null, { "a.level": "a ramp" }).blockers).toHaveLength(1);
    expect(readiness(checks, null, { "b.level": "x".repeat(301) }).blockers).toHaveLength(1);
    expect(readiness(checks, null, { "b.level": "a ramp" }).blockers).toEqual([]);
  });

  it("lets no reason pass a final item", () => {
    const checks = fleetWith(check("b.link", { ...FAILED, final: true }));
    expect(readiness(checks, null, { "b.link": "a good reason" }).blockers).toHaveLength(1);
  });

  it("flies with the others when fewer are wanted", () => {
    const checks = fleetWith(check("b.link", { ...FAILED, final: true }));
    const judged = readiness(checks, 2, {});
    expect(judged.crew).toEqual(["a", "c"]);
    expect(judged.blockers).toEqual([]);
  });

  it("is blocked by the console whoever flies", () => {
    const checks = fleetWith(check("disk", FAILED));
    expect(readiness(checks, 1, {}).blockers.map((each) => each.key)).toEqual(["disk"]);
  });
});

describe("overridesFrom", () => {
  it("sends complete reasons for items that need one", () => {
    const checks = fleetWith(
      check("a.level", FAILED),
      check("b.level", FAILED),
      check("b.link", { ...FAILED, final: true }),
    );
    const reasons = { "a.level": " a ramp ", "b.level": "x", "b.link": "no way", "c.link": "passed", old: "gone now" };
    expect(overridesFrom(checks, reasons)).toEqual({ "a.level": "a ramp" });
  });
});

describe("CheckRow", () => {
  const render = (one: Check, reason?: string) =>
    renderToStaticMarkup(createElement(CheckRow, { check: one, reason, onReason: () => undefined }));

  it("says in a word, not in colour alone, how an item stands", () => {
    expect(render(check("a.level"))).toContain("OK");
    const failed = render(check("a.level", FAILED));
    expect(failed).toContain("Not OK");
    expect(failed).toContain("leans 14 degrees");
    expect(failed).toContain("Set it down level.");
    expect(failed).toContain("Fly anyway");
  });

  it("offers no override for a passed or a final item", () => {
    expect(render(check("a.level"))).not.toContain("Fly anyway");
    const final = render(check("a.link", { ...FAILED, final: true }));
    expect(final).not.toContain("Fly anyway");
    expect(final).toContain("Cannot be overridden");
  });

  it("asks for a reason and counts it only when it is one", () => {
    const empty = render(check("a.level", FAILED), "");
    expect(empty).toContain('aria-invalid="true"');
    expect(empty).toContain('data-state="failed"');
    const good = render(check("a.level", FAILED), "a ramp");
    expect(good).toContain('aria-invalid="false"');
    expect(good).toContain('data-state="overridden"');
  });

  it("shows an item it has no word for by its own name", () => {
    expect(render(check("a.prop_guards"))).toContain("prop guards");
  });
});
