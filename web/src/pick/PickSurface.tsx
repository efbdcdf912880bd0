import { useEffect, useRef, useState } from "react";
import { words } from "../text/words";
import { boxBetween, isBox, MIDDLE, nudged, placeOf, shareAt, type Place, type ShareBox, type SharePoint } from "./box";

/** What is being shown to the drones: where the object is, or which part of it matters. */
export type PickMode = "object" | "priority";

interface PickSurfaceProps {
  readonly mode: PickMode;
  readonly name: string;
  readonly onPlace: (place: Place) => void;
  readonly onCancel: () => void;
}

interface Drag {
  readonly pointerId: number;
  readonly from: SharePoint;
  readonly to: SharePoint;
}

/**
 * Lies over a tile's picture and takes one gesture: a click, a drawn box, or a box by keys.
 *
 * Mouse, finger and pen alike. The space bar stays HOLD; Enter confirms and Escape cancels.
 */
export function PickSurface({ mode, name, onPlace, onCancel }: PickSurfaceProps) {
  const surface = useRef<HTMLDivElement>(null);
  const [drag, setDrag] = useState<Drag | null>(null);
  const [typed, setTyped] = useState<ShareBox | null>(null);
  const gesture = words.pick[mode];

  useEffect(() => {
    surface.current?.focus({ preventScroll: true });
  }, []);

  // Also where something else has the focus by now.
  useEffect(() => {
    const listen = (event: KeyboardEvent) => {
      if (event.key === "Escape") onCancel();
    };
    window.addEventListener("keydown", listen);
    return () => {
      window.removeEventListener("keydown", listen);
    };
  }, [onCancel]);

  const at = (event: React.PointerEvent<HTMLDivElement>): SharePoint =>
    shareAt(event.clientX, event.clientY, event.currentTarget.getBoundingClientRect());

  const begin = (event: React.PointerEvent<HTMLDivElement>) => {
    // A second finger, or a button other than the first, draws nothing.
    if (drag !== null || event.button !== 0) return;
    event.preventDefault();
    event.currentTarget.focus({ preventScroll: true });
    event.currentTarget.setPointerCapture(event.pointerId);
    setTyped(null);
    setDrag({ pointerId: event.pointerId, from: at(event), to: at(event) });
  };
  const move = (event: React.PointerEvent<HTMLDivElement>) => {
    if (drag?.pointerId === event.pointerId) setDrag({ ...drag, to: at(event) });
  };
  const end = (event: React.PointerEvent<HTMLDivElement>) => {
    if (drag?.pointerId !== event.pointerId) return;
    setDrag(null);
    const place = placeOf(drag.from, at(event), event.currentTarget.getBoundingClientRect());
    // A part needs a size: a click shows none, so the surface stays for another try.
    if (place !== null && (mode === "object" || place.kind === "box")) onPlace(place);
  };
  const lose = (event: React.PointerEvent<HTMLDivElement>) => {
    if (drag?.pointerId === event.pointerId) setDrag(null);
  };
  const press = (event: React.KeyboardEvent<HTMLDivElement>) => {
    if (event.key === "Enter" && typed !== null) onPlace({ kind: "box", box: typed });
    else {
      const next = nudged(typed ?? MIDDLE, event.key, event.shiftKey);
      if (next === null) return;
      setTyped(typed === null ? MIDDLE : next);
    }
    event.preventDefault();
    event.stopPropagation();
  };

  const box = drag !== null ? boxBetween(drag.from, drag.to) : typed;
  return (
    <div
      ref={surface}
      className={`pick-surface is-${mode}`}
      role="application"
      aria-label={gesture.surface(name)}
      tabIndex={0}
      data-testid="pick-surface"
      onPointerDown={begin}
      onPointerMove={move}
      onPointerUp={end}
      onPointerCancel={lose}
      onLostPointerCapture={lose}
      onKeyDown={press}
    >
      {box !== null && isBox(box) && <BoxMark box={box} className="pick-drawn" />}
      {drag === null && <span className="pick-hint">{gesture.hint}</span>}
    </div>
  );
}

/** A box over the picture. */
function BoxMark({ box, className }: { readonly box: ShareBox; readonly className: string }) {
  const [left, top, right, bottom] = box;
  return (
    <span
      className={className}
      style={{
        left: percent(left),
        top: percent(top),
        width: percent(right - left),
        height: percent(bottom - top),
      }}
    />
  );
}

function percent(share: number): string {
  return `${(100 * share).toFixed(2)}%`;
}
