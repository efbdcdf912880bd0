import { afterEach, describe, expect, it, vi } from "vitest";
import { changeCapture } from "./captures";
import { deleteCapture } from "./library";
import { getReplay } from "./replay";
import { request } from "./request";
import { scaleCapture } from "./scale";

afterEach(() => {
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

function answering(body: string, status: number): void {
  vi.stubGlobal("fetch", () =>
    Promise.resolve(new Response(body, { status, headers: { "Content-Type": "application/problem+json" } })),
  );
}

describe("request", () => {
  it("tells the reason of a refusal alone", async () => {
    answering(JSON.stringify({ title: "Conflict", status: 409, detail: "drone-1 held; re-arm first" }), 409);
    await expect(request("GET", "/x")).rejects.toThrow(/^drone-1 held; re-arm first$/);
  });

  it("does not pass the phrase of a status for a reason", async () => {
    answering(JSON.stringify({ title: "Conflict", status: 409 }), 409);
    await expect(request("GET", "/x")).rejects.toThrow(/without a reason \(status 409\)/);
  });

  it("says what it means that nobody answers, and what to do", async () => {
    vi.stubGlobal("fetch", () => Promise.reject(new TypeError("Failed to fetch")));
    await expect(request("GET", "/x")).rejects.toThrow(/cannot be reached.*failsafes go on.*reconnects/);
  });

  it("says of a late answer that it may have been carried out all the same", async () => {
    vi.stubGlobal("fetch", () => Promise.reject(new DOMException("late", "TimeoutError")));
    await expect(request("GET", "/x")).rejects.toThrow(/within 10 s.*may still do it/);
  });
});

describe("long work", () => {
  const wish = { length_m: 1, ends: [[], []] } as const;

  it.each([
    ["a replay", () => getReplay("a"), 300_000],
    ["a scale", () => scaleCapture("a", wish), 300_000],
    ["a deletion", () => deleteCapture("a"), 300_000],
    ["an abort", () => changeCapture("a", "abort"), 30_000],
    ["a pause", () => changeCapture("a", "pause"), 10_000],
  ] as const)("%s is given its time", async (_, ask, ms) => {
    answering("{}", 200);
    const timeout = vi.spyOn(AbortSignal, "timeout");
    await ask();
    expect(timeout).toHaveBeenCalledWith(ms);
  });
});
