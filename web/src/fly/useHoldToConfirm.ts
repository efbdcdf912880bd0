import { useEffect, useRef, useState, type KeyboardEvent, type PointerEvent } from "react";

/** Long enough to be meant, short enough for an emergency. The stylesheet's fill takes as long. */
export const HOLD_TO_CONFIRM_MS = 800;

/** Act only after pointer or Enter key was held for `HOLD_TO_CONFIRM_MS`; letting go takes it back. */
export function useHoldToConfirm(act: () => void) {
  const [pressing, setPressing] = useState(false);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const release = () => {
    clearTimeout(timer.current);
    setPressing(false);
  };
  const press = () => {
    clearTimeout(timer.current);
    setPressing(true);
    timer.current = setTimeout(() => {
      setPressing(false);
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
      if (event.button === 0) press();
    },
    onPointerUp: release,
    onPointerLeave: release,
    onPointerCancel: release,
    onBlur: release,
    onKeyDown: (event: KeyboardEvent) => {
      if (event.key === "Enter" && !event.repeat) press();
    },
    onKeyUp: (event: KeyboardEvent) => {
      if (event.key === "Enter") release();
    },
    onContextMenu: (event: { preventDefault: () => void }) => {
      event.preventDefault();
    },
  };
  return { pressing, handlers };
}
