/** Input types that take no text: the space bar means HOLD there as everywhere else. */
const TEXTLESS_INPUTS = new Set(["button", "checkbox", "number", "radio", "range", "reset", "submit"]);

/** The part of an element that tells whether it takes text; elements of any frame have it. */
export interface KeyTarget {
  readonly tagName?: unknown;
  readonly type?: unknown;
  readonly isContentEditable?: unknown;
}

/** True where a space bar press writes a space. */
export function takesText(target: KeyTarget | null): boolean {
  if (target === null) return false;
  if (target.isContentEditable === true) return true;
  if (target.tagName === "TEXTAREA") return true;
  return target.tagName === "INPUT" && !TEXTLESS_INPUTS.has(String(target.type));
}

/**
 * Let the space bar mean HOLD in a window, before anything else there sees the key.
 *
 * Returns the way back. The scene's frame is a window of its own and gets its own call.
 */
export function listenForHold(page: Window, hold: () => void): () => void {
  const isHoldKey = (event: KeyboardEvent) =>
    event.code === "Space" &&
    !(event.ctrlKey || event.altKey || event.metaKey) &&
    !takesText(event.target as KeyTarget | null);
  const down = (event: KeyboardEvent) => {
    if (!isHoldKey(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) hold();
  };
  // A focused button would be pressed by the release of the key.
  const up = (event: KeyboardEvent) => {
    if (isHoldKey(event)) event.preventDefault();
  };
  page.addEventListener("keydown", down, true);
  page.addEventListener("keyup", up, true);
  return () => {
    page.removeEventListener("keydown", down, true);
    page.removeEventListener("keyup", up, true);
  };
}
