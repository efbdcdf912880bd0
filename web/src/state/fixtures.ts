/** What tests of several modules need: one report of a drone that flies and is well. */

import type { DroneReport } from "../protocol/messages.gen";

/** A drone's report; `changes` says what is different about it. */
export function droneReport(changes: Partial<DroneReport> = {}): DroneReport {
  return {
    type: "drone_reported",
    at: "2026-01-01T10:00:00Z",
    drone_id: "a",
    name: "A",
    colour: "#112233",
    activity: "flying",
    held: false,
    battery_pct: 80,
    temperature_c: 60,
    height_m: 1,
    speed_m_s: 0,
    state_age_s: 0.1,
    video_age_s: 0.1,
    video_fps: 15,
    position_sigma_m: 0.05,
    video_wanted: true,
    link_age_s: 0.2,
    object_age_s: 0.1,
    velocity_age_s: 0,
    ...changes,
  };
}
