import { useEffect, useRef, useState, type ReactNode } from "react";
import { BASE } from "../api/base";
import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { Waiting } from "../design/Waiting";
import { listenForHold } from "../fly/holdKey";
import { forwardPageKeys } from "../shell/pageKeys";
import { words } from "../text/words";

const RETRY_MS = 5000;

/**
 * The 3D scene in its frame.
 *
 * A scene that lost its server stays dead until it is loaded again, so the frame is made anew
 * whenever the stream comes back.
 */
export function ScenePanel({ aside }: { readonly aside?: ReactNode }) {
  const epoch = useConsole((state) => state.epoch);
  const [attempt, setAttempt] = useState(0);
  const [down, setDown] = useState(false);
  const again = () => {
    setAttempt((last) => last + 1);
  };
  useEffect(() => {
    if (!down) return;
    const timer = setTimeout(again, RETRY_MS);
    return () => {
      clearTimeout(timer);
    };
  }, [down, attempt]);
  return (
    <Panel
      title={words.scene.title}
      className="scene"
      aside={
        <>
          {aside}
          <button type="button" className="button button-small button-quiet" onClick={again}>
            <Icon name="rearm" />
            {words.scene.reload}
          </button>
        </>
      }
    >
      <div className="scene-body">
        <SceneFrame key={`${epoch}.${attempt}`} onDown={setDown} />
        {down && (
          <div className="scene-down" role="status">
            <Icon name="cube" />
            <strong>{words.scene.down}</strong>
            <span>{words.scene.retrying}</span>
          </div>
        )}
      </div>
      <SeenLegend />
    </Panel>
  );
}

/** What the colours of the painted surface mean, once it is painted. */
function SeenLegend() {
  const painted = useConsole((state) => state.findings.coverage !== null);
  const { seen, seenNever, seenOnce, seenOften } = words.scene;
  if (!painted) return null;
  const colours = [
    ["never", seenNever],
    ["once", seenOnce],
    ["often", seenOften],
  ] as const;
  return (
    <p className="scene-legend">
      {seen}
      {colours.map(([name, word]) => (
        <span key={name}>
          <i className={`seen-${name}`} aria-hidden="true" /> {word}
        </span>
      ))}
    </p>
  );
}

function SceneFrame({ onDown }: { readonly onDown: (down: boolean) => void }) {
  const operator = useOperator();
  const frame = useRef<HTMLIFrameElement>(null);
  const [loading, setLoading] = useState(true);
  const [dark] = useState(() => !matchMedia("(prefers-color-scheme: light)").matches);
  useEffect(() => {
    const element = frame.current;
    if (element === null) return;
    let forget: (() => void) | undefined;
    const loaded = () => {
      setLoading(false);
      forget?.();
      const inside = element.contentWindow;
      // An error answer is a page of plain text or JSON, or one that the browser made itself.
      const isScene = element.contentDocument?.contentType === "text/html";
      onDown(!isScene);
      // Keys pressed in the frame do not reach this page, and HOLD must work there too.
      if (inside !== null && isScene) {
        const forgetHold = listenForHold(inside, () => void operator.stop("hold"));
        const forgetKeys = forwardPageKeys(inside, window);
        forget = () => {
          forgetHold();
          forgetKeys();
        };
      }
    };
    element.addEventListener("load", loaded);
    return () => {
      element.removeEventListener("load", loaded);
      forget?.();
    };
  }, [onDown, operator]);
  return (
    <>
      <iframe
        ref={frame}
        title={words.scene.frame}
        src={`${BASE}/scene/${dark ? "?darkMode" : ""}`}
        data-testid="scene-frame"
      />
      {loading && (
        <span className="waiting-over">
          <Waiting quiet what={words.scene.loading} />
        </span>
      )}
    </>
  );
}
