import { useEffect, useRef, useState, type KeyboardEvent, type PointerEvent } from "react";

/** Long enough to be meant, short enough for an emergency. The stylesheet's fill takes as long. */
const HOLD_TO_CONFIRM_MS = 1000;

/** Where a press stands; `released` too early, or `done` once it acted. */
type Press = "idle" | "pressing" | "released" | "done";

/** Act only after pointer or Enter key was held for `HOLD_TO_CONFIRM_MS`; letting go takes it back. */
export function useHoldToConfirm(act: () => void) {
  const [press, setPress] = useState<Press>("idle");
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const release = () => {
    clearTimeout(timer.current);
    setPress((last) => (last === "pressing" ? "released" : last));
  };
  const begin = () => {
    clearTimeout(timer.current);
    setPress("pressing");
    timer.current = setTimeout(() => {
      setPress("done");
      act();
    }, HOLD_TO_CONFIRM_MS);
  };
  useEffect(
    () => () => {
      clearTimeout(timer.current);
    },
    [],
  );
  const handlers = {
    onPointerDown: (event: PointerEvent) => {
      if (event.button === 0) begin();
    },
    onPointerUp: release,
    onPointerLeave: release,
    onPointerCancel: release,
    onBlur: release,
    onKeyDown: (event: KeyboardEvent) => {
      if (event.key === "Enter" && !event.repeat) begin();
    },
    onKeyUp: (event: KeyboardEvent) => {
      if (event.key === "Enter") release();
    },
    onContextMenu: (event: { preventDefault: () => void }) => {
      event.preventDefault();
    },
  };
  return { press, pressing: press === "pressing", handlers };
}
