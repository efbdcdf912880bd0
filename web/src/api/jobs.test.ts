import { expect, it } from "vitest";
import { trainingsOf, type Job } from "./jobs";

const job = (id: string, capture: string | null, run: string, state: Job["state"]) =>
  ({ id, capture, run: `runs/${run}`, state }) as Job;

it("tells the trainings anew on a capture, and how many come before each", () => {
  const jobs = [
    job("6", "b", "anew-6", "queued"),
    job("5", "a", "anew-5", "queued"),
    job("4", "b", "anew-4", "queued"),
    job("3", "a", "anew-3", "running"),
    job("2", "a", "a", "running"),
    job("1", "a", "anew-1", "succeeded"),
    job("0", null, "b", "running"),
  ];
  expect(trainingsOf("a", jobs).map(({ id, ahead }) => [id, ahead])).toEqual([
    ["5", 2],
    ["3", 0],
    ["1", 0],
  ]);
  expect(trainingsOf("b", jobs).map(({ id, ahead }) => [id, ahead])).toEqual([
    ["6", 3],
    ["4", 1],
  ]);
});
