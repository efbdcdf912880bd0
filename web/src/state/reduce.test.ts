import { describe, expect, it } from "vitest";
import type {
  CaptureReport,
  DroneReport,
  FailsafeReport,
  PictureReport,
  TrainingReport,
} from "../protocol/messages.gen";
import { reduce } from "./reduce";
import { droneReport } from "./fixtures";
import { canGoOn, canPause, fliesByItself, INITIAL_STATE, isTraining, type ConsoleState, type Message } from "./state";

const T0 = 1_000_000;

function drone(droneId: string, changes: Partial<DroneReport> = {}): DroneReport {
  return droneReport({ drone_id: droneId, name: droneId.toUpperCase(), ...changes });
}

function capture(id: string, changes: Partial<CaptureReport> = {}): CaptureReport {
  return {
    type: "capture_changed",
    at: "2026-01-01T10:00:00Z",
    id,
    state: "running",
    phase: "preflight",
    progress: 0,
    eta_s: null,
    run: `runs/${id}`,
    error: null,
    mode: "optimized",
    round_index: 0,
    rounds: 6,
    images: 0,
    images_total: 24,
    commanded: 0,
    entered: {},
    ...changes,
  };
}

function picture(index: number, thumbnail = "data:,"): PictureReport {
  return { type: "capture_taken", at: "", index, round_index: 0, drone_id: "a", thumbnail, sharpness: null, damaged_before: 0 };
}

function training(stage: string, seconds: number, changes: Partial<TrainingReport> = {}): TrainingReport {
  return {
    type: "training_progressed",
    at: `${stage} ${seconds}`,
    stage,
    step: 1,
    seconds,
    seconds_total: 60,
    loss: null,
    psnr_db: 20,
    held_out_psnr_db: null,
    held_out_ssim: null,
    samples_per_s: 1e6,
    images: 24,
    ...changes,
  };
}

function failsafe(droneId: string, changes: Partial<FailsafeReport> = {}): FailsafeReport {
  return {
    type: "failsafe_fired",
    at: "2026-01-01T10:00:00Z",
    drone_id: droneId,
    event: "video_age_s",
    threshold: 4,
    action: "hold",
    value: 4.2,
    text: "no picture for 4.2 s",
    ...changes,
  };
}

const LOST = { type: "stream_lost", retryInMs: 250 } as const;

function after(messages: readonly Message[], from: ConsoleState = INITIAL_STATE): ConsoleState {
  return messages.reduce((state, message) => reduce(state, message, T0), from);
}

describe("reduce: connection", () => {
  it("counts openings and remembers when the line was lost first", () => {
    let state = after([{ type: "stream_opened" }]);
    expect([state.connection.kind, state.epoch]).toEqual(["open", 1]);
    state = reduce(state, LOST, T0 + 5);
    state = reduce(state, { ...LOST, retryInMs: 500 }, T0 + 900);
    expect(state.connection).toEqual({ kind: "lost", sinceMs: T0 + 5, retryMs: T0 + 1400 });
    expect(after([{ type: "stream_opened" }], state).epoch).toBe(2);
  });

  it("stays signed out while the stream keeps trying", () => {
    const state = after([{ type: "signed_out" }, LOST]);
    expect(state.connection.kind).toBe("signed_out");
  });

  it("keeps the drones on the page over a reconnection", () => {
    const state = after([drone("a"), LOST, { type: "stream_opened" }]);
    expect([...state.drones.keys()]).toEqual(["a"]);
  });
});

describe("reduce: drones", () => {
  it("keeps the newest report of each in the order of their first", () => {
    const state = after([drone("b"), drone("a"), drone("b", { battery_pct: 12 })]);
    expect([...state.drones.keys()]).toEqual(["b", "a"]);
    expect(state.drones.get("b")?.report.battery_pct).toBe(12);
    expect(state.drones.get("b")?.receivedMs).toBe(T0);
  });

  it("shows an accepted hold at once, and believes the next report", () => {
    const held = after([drone("a"), drone("b"), { type: "hold_accepted", droneId: null }]);
    expect([...held.drones.values()].map((each) => each.report.held)).toEqual([true, true]);
    expect(after([drone("a")], held).drones.get("a")?.report.held).toBe(false);
    const one = after([drone("a"), drone("b"), { type: "hold_accepted", droneId: "b" }]);
    expect([...one.drones.values()].map((each) => each.report.held)).toEqual([false, true]);
  });

  it("changes nothing in place", () => {
    const before = after([drone("a")]);
    const drones = before.drones;
    after([drone("b"), capture("1"), picture(0)], before);
    expect(before.drones).toBe(drones);
    expect(drones.size).toBe(1);
    expect(before.findings.pictures).toEqual([]);
  });
});

describe("reduce: what a drone is doing", () => {
  it("remembers since when, and that it does not know of the time before", () => {
    const first = after([drone("a", { activity: "holding" })]);
    expect(first.drones.get("a")?.activitySince).toBe("");
    const later = after([drone("a", { activity: "landing", at: "t1" })], first);
    expect(later.drones.get("a")?.activitySince).toBe("t1");
    const same = after([drone("a", { activity: "landing", at: "t2" })], later);
    expect(same.drones.get("a")?.activitySince).toBe("t1");
  });
});

describe("reduce: failsafes", () => {
  it("keeps the newest fifty, and one that is repeated once", () => {
    const many = Array.from({ length: 60 }, (_, index) => failsafe("a", { at: `t${index}` }));
    const { failsafes } = after([...many, failsafe("a", { at: "t59" })]);
    expect(failsafes).toHaveLength(50);
    expect(failsafes[0]?.at).toBe("t10");
    expect(failsafes.at(-1)?.at).toBe("t59");
  });

  it("tells the rows and the drones of one moment apart", () => {
    const { failsafes } = after([
      failsafe("a"),
      failsafe("b"),
      failsafe("a", { action: "land", threshold: 20 }),
      failsafe("a", { event: "state_age_s" }),
    ]);
    expect(failsafes).toHaveLength(4);
  });

  it("outlives a reconnection", () => {
    const state = after([failsafe("a"), { type: "stream_opened" }, failsafe("a"), drone("a")]);
    expect(state.failsafes).toHaveLength(1);
  });
});

describe("reduce: command", () => {
  it("begins and ends when it is taken and released, not with the connection", () => {
    const taken = after([{ type: "command_taken" }]);
    expect(taken.inCommand).toBe(true);
    expect(after([{ type: "command_taken" }], taken)).toBe(taken);
    expect(after([LOST, { type: "stream_opened" }], taken).inCommand).toBe(true);
    expect(after([{ type: "command_released" }], taken).inCommand).toBe(false);
  });
});

describe("fliesByItself", () => {
  it.each([
    ["preflight", "running", true],
    ["capture", "paused", true],
    ["land", "running", true],
    ["grounded", "paused", false],
    ["train", "running", false],
    ["capture", "aborted", false],
  ] as const)("%s, %s: %s", (phase, state, expected) => {
    expect(fliesByItself(capture("1", { phase, state }))).toBe(expected);
  });
});

describe("canPause", () => {
  it.each([
    ["take_off", "running", false],
    ["centre", "running", true],
    ["capture", "running", true],
    ["capture", "paused", false],
    ["land", "running", false],
    ["train", "running", false],
    ["fly", "aborted", false],
  ] as const)("%s, %s: %s", (phase, state, expected) => {
    expect(canPause(capture("1", { phase, state }))).toBe(expected);
  });
});

describe("isTraining", () => {
  it.each([
    ["capture", "running", false],
    ["land", "running", false],
    ["train", "running", true],
    ["train", "failed", false],
    ["done", "succeeded", false],
  ] as const)("%s, %s: %s", (phase, state, expected) => {
    expect(isTraining(capture("1", { phase, state }))).toBe(expected);
  });
});

describe("canGoOn", () => {
  it.each([
    ["interrupted", 24, true],
    ["aborted", 3, true],
    ["failed", 24, true],
    ["aborted", 0, false],
    ["succeeded", 24, false],
    ["running", 24, false],
  ] as const)("%s with %i pictures: %s", (state, images, expected) => {
    expect(canGoOn({ state, images })).toBe(expected);
  });
});

describe("reduce: capture", () => {
  it("drops the findings of the last capture when another one begins", () => {
    const state = after([capture("1"), picture(0), capture("1", { state: "succeeded", phase: "done" })]);
    expect(state.findings.pictures).toHaveLength(1);
    const next = after([capture("2", { at: "2026-01-01T11:00:00Z" })], state);
    expect(next.capture?.id).toBe("2");
    expect(next.findings.pictures).toEqual([]);
    expect(next.step).toBe("preflight");
  });

  it("is not distracted by news of an older one", () => {
    const state = after([
      capture("2", { state: "succeeded", at: "2026-01-01T11:00:00Z" }),
      picture(0),
      capture("1", { state: "interrupted", at: "2026-01-01T10:00:00Z" }),
    ]);
    expect(state.capture?.id).toBe("2");
    expect(state.findings.pictures).toHaveLength(1);
  });

  it("keeps pictures in order of taking, each once", () => {
    const { pictures } = after([picture(2), picture(0), picture(2, "data:,again"), picture(1)]).findings;
    expect(pictures.map((each) => each.index)).toEqual([0, 1, 2]);
    expect(pictures[2]?.thumbnail).toBe("data:,again");
  });

  it("moves along the course and never back", () => {
    const phases = ["preflight", "take_off", "centre", "seed", "plan", "fly", "tune", "capture", "fly"];
    const state = after(phases.map((phase) => capture("1", { phase })));
    expect(state.step).toBe("rounds");
    expect(after([capture("1", { phase: "land" }), capture("1", { phase: "seed" })], state).step).toBe("land");
  });

  it("keeps the step where a capture ended early", () => {
    const state = after([capture("1", { phase: "seed" }), capture("1", { phase: "ended", state: "failed" })]);
    expect(state.step).toBe("seed");
  });

  it("knows from the report when the steps began, also where it comes late", () => {
    const entered = { plan: "10:01", fly: "10:02", tune: "10:03", capture: "10:04" };
    const late = after([
      { type: "stream_opened" },
      capture("1", { phase: "capture", at: "10:20", entered }),
      drone("a"),
    ]);
    expect(late.stepEntered).toEqual({ plan: "10:01", rounds: "10:02" });
    const next = { ...entered, land: "10:30" };
    const landing = after([capture("1", { phase: "land", at: "10:31", entered: next })], late);
    expect(landing.stepEntered).toEqual({ plan: "10:01", rounds: "10:02", land: "10:30" });
    const another = after([capture("2", { at: "11:00", entered: { preflight: "10:59" } })], landing);
    expect(another.stepEntered).toEqual({ preflight: "10:59" });
  });

  it("tells refining from training by the training's stage", () => {
    let state = after([capture("1", { phase: "fly" }), training("live", 3), capture("1", { phase: "train" })]);
    expect(state.step).toBe("refine");
    state = after([training("refine", 1)], state);
    expect(state.step).toBe("refine");
    state = after([training("train", 1)], state);
    expect(state.step).toBe("train");
    expect(state.stepEntered.train).toBe("train 1");
  });
});

describe("reduce: what the server repeats after a reconnection", () => {
  const repeated: Message[] = [
    capture("1", { state: "succeeded", at: "2026-01-01T09:00:00Z" }),
    picture(0),
    picture(1),
    capture("2", { phase: "train", at: "2026-01-01T10:30:00Z" }),
    training("train", 9),
  ];

  it("belongs to the newest capture, in whatever order it comes", () => {
    const state = after([{ type: "stream_opened" }, ...repeated, drone("a")]);
    expect(state.capture?.id).toBe("2");
    expect(state.findings.pictures).toHaveLength(2);
    expect(state.arriving).toBeNull();
  });

  it("tells how long the line was gone and what happened meanwhile", () => {
    const note = (text: string): Message => ({
      type: "noted",
      at: `2026-01-01T10:00:0${text.length}Z`,
      level: "info",
      text,
      drone_id: null,
    });
    const before = after([capture("2", { phase: "train" }), picture(0), note("a")]);
    const lost = reduce(before, LOST, T0);
    const opened = reduce(lost, { type: "stream_opened" }, T0 + 12_000);
    const told = [note("a"), note("bb"), note("ccc"), ...repeated, drone("a")];
    const state = told.reduce((last, message) => reduce(last, message, T0 + 12_100), opened);
    expect(state.log.at(-1)?.text).toBe(
      "Back after 12 s; missed and made up for: 2 events, 1 pictures",
    );
  });

  it("tells nothing of the sort on the page's first line", () => {
    const state = after([{ type: "stream_opened" }, ...repeated, drone("a")]);
    expect(state.log).toEqual([]);
  });

  it("is not shown in part", () => {
    const before = after([capture("2", { phase: "train" }), picture(0), training("train", 5)]);
    const state = after([{ type: "stream_opened" }, ...repeated.slice(0, 1)], before);
    expect(state.capture?.id).toBe("2");
    expect(state.findings.pictures).toHaveLength(1);
  });

  it("keeps the curve that only this browser remembers", () => {
    const before = after([capture("2", { phase: "train" }), training("train", 5), training("train", 6)]);
    const state = after([{ type: "stream_opened" }, ...repeated, drone("a")], before);
    expect(state.findings.quality.seconds).toEqual([5, 6, 9]);
    const again = after([{ type: "stream_opened" }, ...repeated, drone("a")], state);
    expect(again.findings.quality.seconds).toEqual([5, 6, 9]);
  });

  it("replaces all when another capture was made meanwhile", () => {
    const before = after([capture("1"), picture(0), picture(1), picture(2), training("train", 5)]);
    const other = capture("2", { state: "succeeded", at: "2026-01-01T12:00:00Z" });
    const state = after([{ type: "stream_opened" }, other, picture(0), drone("a")], before);
    expect(state.findings.pictures).toHaveLength(1);
    expect(state.findings.quality.seconds).toEqual([]);
  });

  it("does not wait for a fleet that never reports", () => {
    let state = after([{ type: "stream_opened" }, capture("1")]);
    expect(state.capture).toBeNull();
    state = reduce(state, capture("1", { phase: "seed" }), T0 + 2001);
    expect(state.step).toBe("seed");
  });
});

describe("reduce: log and alarms", () => {
  const note = (text: string, at = "t"): Message => ({
    type: "noted",
    at,
    level: "info",
    text,
    drone_id: null,
  });

  it("holds the newest lines, numbered, and a repeated one once", () => {
    const many = Array.from({ length: 510 }, (_, index) => note(`line ${index}`));
    const { log } = after([...many, note("line 509")]);
    expect(log).toHaveLength(500);
    expect(log[0]?.text).toBe("line 10");
    expect(log.at(-1)?.text).toBe("line 509");
    expect(new Set(log.map((line) => line.id)).size).toBe(500);
  });

  it("keeps a pick until it is taken back, and another tile's apart from it", () => {
    const pick = (droneId: string, box: readonly number[] | null): Message => ({
      type: "object_pointed_out",
      at: "1",
      drone_id: droneId,
      box,
    });
    const state = after([pick("a", [0, 0, 1, 1]), pick("b", [0, 0, 0.5, 1]), pick("a", null)]);
    expect([...state.picks.keys()]).toEqual(["b"]);
    expect(after([{ type: "stream_opened" }], state).picks.size).toBe(0);
  });

  it("knows who disagrees until all agree again", () => {
    const apart = (...ids: string[]): Message => ({
      type: "views_disagree",
      at: "1",
      drone_ids: ids,
      reason: "looks elsewhere",
    });
    const state = after([apart("a"), apart("a", "c")]);
    expect(state.disagreement?.drone_ids).toEqual(["a", "c"]);
    expect(after([apart()], state).disagreement).toBeNull();
    expect(after([{ type: "stream_opened" }], state).disagreement).toBeNull();
  });

  it("takes the parts of priority as they stand", () => {
    const part = { id: "p", drone_id: "a", drawn: [0, 0, 1, 1], weight: 4, centre: null, size: null };
    const state = after([{ type: "priorities_changed", at: "1", parts: [part] }]);
    expect(state.priorities).toEqual([part]);
    expect(after([{ type: "priorities_changed", at: "2", parts: [] }], state).priorities).toEqual([]);
  });

  it("takes the no-go volumes as they stand", () => {
    const volume = { id: "no-go-1", area: [0, 0, 1, 1], configured: false };
    const state = after([{ type: "no_go_changed", at: "1", volumes: [volume] }]);
    expect(state.noGo).toEqual([volume]);
    expect(after([{ type: "stream_opened" }], state).noGo).toEqual([]);
  });

  it("says how much was missed", () => {
    const { log } = after([{ type: "missed", events: 17 }]);
    expect(log[0]?.level).toBe("warning");
    expect(log[0]?.text).toContain("17");
  });

  it("keeps alarms until dismissed, the same one once, and logs each", () => {
    const alarm = (text: string, at: string): Message => ({
      type: "alarm_raised",
      at,
      text,
    });
    let state = after([alarm("x", "1"), alarm("x", "2"), alarm("y", "3")]);
    expect(state.alarms.map((each) => each.text)).toEqual(["x", "y"]);
    expect(state.log).toHaveLength(3);
    const [first] = state.alarms;
    state = after([{ type: "alarm_dismissed", id: first?.id ?? -1 }], state);
    expect(state.alarms.map((each) => each.text)).toEqual(["y"]);
  });
});
