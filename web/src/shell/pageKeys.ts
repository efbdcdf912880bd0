import { takesText, type KeyTarget } from "../fly/holdKey";
import { SCREENS, type Screen } from "./screens";

/** The part of a key press that tells what it means to the page. */
export type KeyPress = Pick<
  KeyboardEvent,
  "key" | "ctrlKey" | "altKey" | "metaKey" | "shiftKey" | "repeat" | "target"
>;

/** Return the screen that a number key goes to, null for any other press. */
export function screenOfKey(event: KeyPress): Screen | null {
  if (event.ctrlKey || event.altKey || event.metaKey || event.shiftKey || event.repeat) return null;
  const target = event.target as KeyTarget | null;
  // Number fields take digits, too.
  if (takesText(target) || target?.tagName === "INPUT" || target?.tagName === "SELECT") return null;
  return SCREENS[Number(event.key) - 1] ?? null;
}

/** True where a press shows or hides the list of keys. */
export function asksForKeys(event: KeyPress): boolean {
  return event.key === "?" && !takesText(event.target as KeyTarget | null);
}

/**
 * Let the page's keys work in a frame's window, too: presses there do not reach the page.
 *
 * Returns the way back.
 */
export function forwardPageKeys(frame: Window, page: Window): () => void {
  const press = (event: KeyboardEvent) => {
    if (screenOfKey(event) === null && !asksForKeys(event)) return;
    page.dispatchEvent(new KeyboardEvent("keydown", { key: event.key }));
  };
  frame.addEventListener("keydown", press);
  return () => {
    frame.removeEventListener("keydown", press);
  };
}
