import { expect, it } from "vitest";
import type { PlanProgress } from "../protocol/messages.gen";
import { searchOf } from "./search";

const report = (second: number, iteration: number): PlanProgress => ({
  type: "plan_progressed",
  at: new Date(Date.UTC(2026, 0, 1, 12, 0, second)).toISOString(),
  iteration,
  iterations: 1000,
  temperature: 1,
  fitness: 0.5,
});

it("tells how far a search is, and when it ends if it goes on like this", () => {
  expect(searchOf([])).toBeNull();
  expect(searchOf([report(3, 100)])).toEqual({ share: 0.1, leftS: null });
  expect(searchOf([report(3, 100), report(4, 150), report(7, 300)])).toEqual({ share: 0.3, leftS: 14 });
  expect(searchOf([report(3, 100), report(20, 1000)])).toEqual({ share: 1, leftS: 0 });
});

it("makes nothing of a search without moves", () => {
  expect(searchOf([{ ...report(3, 0), iterations: 0 }])).toEqual({ share: 0, leftS: null });
});
