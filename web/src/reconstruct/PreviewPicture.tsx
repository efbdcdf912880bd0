import { useEffect, useRef, useState, type PointerEvent } from "react";
import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import type { PreviewReport } from "../protocol/messages.gen";
import { isActive, type ConsoleState } from "../state/state";
import { words } from "../text/words";
import { dragged, isSameView, moved, viewAfterKey, type FieldView } from "./fieldView";

/** A step of the wheel. */
const WHEEL = 1.1;

/** The field's newest rendering; while it is trained it can be turned, from all sides. */
export function PreviewPicture({ preview }: { readonly preview: PreviewReport }) {
  const captureId = useConsole(trained);
  return captureId === null ? (
    <Picture preview={preview} />
  ) : (
    <Turned key={captureId} captureId={captureId} preview={preview} />
  );
}

function Picture({ preview }: { readonly preview: PreviewReport }) {
  return (
    <img
      src={preview.image}
      alt={words.field.preview}
      draggable={false}
      data-testid="preview"
      data-at={preview.at}
    />
  );
}

function Turned({ captureId, preview }: { readonly captureId: string; readonly preview: PreviewReport }) {
  const { view, look, orbit } = useView(captureId, preview);
  const frame = useRef<HTMLDivElement>(null);
  const held = useRef<{ readonly x: number; readonly y: number; readonly from: FieldView } | null>(null);
  const text = words.field;

  // The wheel moves the camera and not the page, which only a listener of our own may prevent.
  useEffect(() => {
    const element = frame.current;
    if (element === null) return;
    const wheel = (event: WheelEvent) => {
      // A page that scrolls by is not caught; whoever means the picture has clicked it.
      if (document.activeElement !== element) return;
      event.preventDefault();
      look((now) => moved(now, event.deltaY > 0 ? WHEEL : 1 / WHEEL));
    };
    element.addEventListener("wheel", wheel, { passive: false });
    return () => {
      element.removeEventListener("wheel", wheel);
    };
  }, [look]);

  const drag = (event: PointerEvent<HTMLDivElement>) => {
    const grip = held.current;
    if (grip === null) return;
    const { width, height } = event.currentTarget.getBoundingClientRect();
    look(() => dragged(grip.from, (event.clientX - grip.x) / width, (event.clientY - grip.y) / height));
  };
  return (
    <>
      <div
        ref={frame}
        className="preview-turned"
        role="group"
        tabIndex={0}
        aria-label={text.turnHow}
        data-testid="preview-turned"
        onPointerDown={(event) => {
          event.currentTarget.setPointerCapture(event.pointerId);
          event.currentTarget.focus({ preventScroll: true });
          held.current = { x: event.clientX, y: event.clientY, from: view };
        }}
        onPointerMove={drag}
        onPointerUp={() => {
          held.current = null;
        }}
        onPointerCancel={() => {
          held.current = null;
        }}
        onKeyDown={(event) => {
          const after = viewAfterKey(view, event.key);
          if (after === null) return;
          event.preventDefault();
          look(() => after);
        }}
      >
        <Picture preview={preview} />
      </div>
      <figcaption className="preview-hint">
        <span>{text.turnHow}</span>
        <button type="button" className="button button-small button-quiet" onClick={orbit} data-testid="orbit">
          <Icon name="rearm" />
          {text.orbit}
        </button>
      </figcaption>
    </>
  );
}

/** The capture whose field is being trained now, null for none. */
function trained({ capture, findings }: ConsoleState): string | null {
  return capture !== null && isActive(capture) && findings.training !== null ? capture.id : null;
}

/**
 * Where the operator looks from: as the newest rendering, but for the moment that a wish of their own
 * takes to be rendered. One wish is under way at a time, and then the newest.
 */
function useView(captureId: string, preview: PreviewReport) {
  const operator = useOperator();
  const [own, setOwn] = useState<FieldView | null>(null);
  const { azimuth_rad, elevation_rad, distance } = preview;
  const shown = { azimuth_rad, elevation_rad, distance };
  if (own !== null && isSameView(own, shown)) setOwn(null);
  const view = own ?? shown;
  const newest = useRef(view);
  useEffect(() => {
    newest.current = view;
  });
  const [act] = useState(() => {
    let wanted: FieldView | null = null;
    let asking = false;
    const ask = async () => {
      if (asking) return;
      asking = true;
      while (wanted !== null) {
        const next = wanted;
        wanted = null;
        await operator.viewField(captureId, next);
      }
      asking = false;
    };
    return {
      look: (next: (now: FieldView) => FieldView) => {
        newest.current = wanted = next(newest.current);
        setOwn(newest.current);
        void ask();
      },
      orbit: () => {
        wanted = null;
        setOwn(null);
        void operator.viewField(captureId, null);
      },
    };
  });
  return { view, ...act };
}
