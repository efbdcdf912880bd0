import type { ServerMessage } from "./messages.gen";

/** Every tag of the union, once; the compiler refuses a missing or a foreign one. */
const TYPES: Readonly<Record<ServerMessage["type"], true>> = {
  drone_reported: true,
  capture_changed: true,
  capture_taken: true,
  plan_progressed: true,
  plan_found: true,
  seed_fitted: true,
  surface_seen: true,
  training_progressed: true,
  poses_refined: true,
  preview_rendered: true,
  metrics_measured: true,
  failsafe_fired: true,
  object_pointed_out: true,
  views_disagree: true,
  priorities_changed: true,
  no_go_changed: true,
  plan_view_changed: true,
  command_changed: true,
  noted: true,
  missed: true,
};

/**
 * Read a text message of the stream, or return null where this console does not know its type.
 *
 * Only the tag is checked: page and server are built from one schema and served together.
 *
 * @throws SyntaxError when the text is not JSON.
 */
export function parseMessage(text: string): ServerMessage | null {
  const value: unknown = JSON.parse(text);
  if (typeof value !== "object" || value === null || !("type" in value)) return null;
  const { type } = value;
  return typeof type === "string" && Object.hasOwn(TYPES, type) ? (value as ServerMessage) : null;
}
