import { useEffect, useRef, useState, useSyncExternalStore } from "react";
import type { CaptureRequest } from "./api/captures";
import { getHistory } from "./api/history";
import { getFailsafes, type FailsafeRow } from "./api/safety";
import { useTold } from "./api/useTold";
import { useConsole, useOperator } from "./context";
import { FlyScreen } from "./fly/FlyScreen";
import { Header } from "./Header";
import { LibraryScreen } from "./library/LibraryScreen";
import type { DroneReport } from "./protocol/messages.gen";
import { PlanScreen } from "./plan/PlanScreen";
import { PreflightSheet } from "./preflight/PreflightSheet";
import { ReconstructScreen } from "./reconstruct/ReconstructScreen";
import { SetupScreen } from "./setup/SetupScreen";
import { ScreenBoundary } from "./shell/ScreenBoundary";
import { screenOfHash, screenWord, useHash, type Screen } from "./shell/screens";
import { words } from "./text/words";

const failsafesKnown = (rows: readonly FailsafeRow[]) => ({ type: "failsafes_known", rows }) as const;
const historyKnown = (reports: readonly DroneReport[]) => ({ type: "history_known", reports }) as const;

/** The whole console: stops above, then one of the five screens. */
export function App() {
  const { screen, rest } = screenOfHash(useHash());
  const [preparing, setPreparing] = useState<CaptureRequest | null>(null);
  const main = useRef<HTMLElement>(null);
  useTold(getFailsafes, failsafesKnown);
  useTold(getHistory, historyKnown);
  useVideoWhileSeen(screen === "fly");
  useNewScreen(screen, main);
  return (
    <>
      <Header screen={screen} />
      <div className="below">
        {/* A sheet lies over all of this, and over none of the stops. */}
        <main
          ref={main}
          className={`console console-${screen}`}
          aria-label={screenWord(screen)}
          tabIndex={-1}
          inert={preparing !== null}
        >
          <ScreenBoundary key={screen}>
            {screen === "fly" && <FlyScreen onPrepare={setPreparing} />}
            {screen === "plan" && <PlanScreen />}
            {screen === "reconstruct" && <ReconstructScreen />}
            {screen === "library" && <LibraryScreen captureId={rest} />}
            {screen === "setup" && <SetupScreen />}
          </ScreenBoundary>
        </main>
        {preparing !== null && (
          <PreflightSheet
            request={preparing}
            onClose={() => {
              setPreparing(null);
            }}
          />
        )}
      </div>
    </>
  );
}

/** Name the page after its screen, and let the keyboard go on from there. */
function useNewScreen(screen: Screen, main: React.RefObject<HTMLElement | null>): void {
  const before = useRef(screen);
  useEffect(() => {
    document.title = words.screens.page(screenWord(screen));
    if (before.current === screen) return;
    before.current = screen;
    main.current?.scrollTo(0, 0);
    main.current?.focus({ preventScroll: true });
  }, [screen, main]);
}

/** Have pictures sent only while they can be seen; `all`: of every drone there will be. */
function useVideoWhileSeen(all: boolean): void {
  const operator = useOperator();
  const { tiles } = operator;
  const ids = useConsole((state) => [...state.drones.keys()].join("\n"));
  const outOfSight = useSyncExternalStore(tiles.subscribe, tiles.outOfSight);
  const watched = useSyncExternalStore(tiles.subscribe, tiles.watched);
  useEffect(() => {
    const look = () => {
      const known = ids === "" ? [] : ids.split("\n");
      // Before any drone is known the server's own default, all of them, is the right one.
      if (all && known.length === 0 && !document.hidden) return;
      // Asked of the hub: tiles have come since this was rendered.
      const seen = (id: string) => tiles.watched().has(id) && !tiles.outOfSight().has(id);
      operator.showVideo(document.hidden ? [] : known.filter(seen));
    };
    look();
    document.addEventListener("visibilitychange", look);
    return () => {
      document.removeEventListener("visibilitychange", look);
    };
  }, [operator, tiles, ids, outOfSight, watched, all]);
}
