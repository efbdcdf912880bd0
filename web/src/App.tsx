import { useEffect, useState } from "react";
import type { CaptureRequest } from "./api/captures";
import { useConsole, useOperator } from "./context";
import { FailsafePanel } from "./failsafe/FailsafePanel";
import { FieldPanel } from "./field/FieldPanel";
import { FlyPanel } from "./fly/FlyPanel";
import { Header } from "./Header";
import { EventLog } from "./log/EventLog";
import { Filmstrip } from "./mission/Filmstrip";
import { MissionPanel } from "./mission/MissionPanel";
import { PreflightSheet } from "./preflight/PreflightSheet";
import { ScenePanel } from "./scene/ScenePanel";

/** The whole console: stops above, then drones, scene with field, and mission with events. */
export function App() {
  useVideoWhileVisible();
  const [preparing, setPreparing] = useState<CaptureRequest | null>(null);
  return (
    <>
      <Header />
      <div className="below">
        {/* A sheet lies over all of this, and over none of the stops. */}
        <main className="console" inert={preparing !== null}>
          <div className="column column-drones">
            <FlyPanel />
            <Filmstrip />
          </div>
          <div className="column column-scene">
            <ScenePanel />
            <FieldPanel />
          </div>
          <div className="column column-mission">
            <MissionPanel onPrepare={setPreparing} />
            <FailsafePanel />
            <EventLog />
          </div>
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

/** Have pictures sent only while the page can be seen. */
function useVideoWhileVisible(): void {
  const operator = useOperator();
  const ids = useConsole((state) => [...state.drones.keys()].join("\n"));
  useEffect(() => {
    const look = () => {
      const all = ids === "" ? [] : ids.split("\n");
      // Before any drone is known the server's own default, all of them, is the right one.
      if (document.hidden) operator.showVideo([]);
      else if (all.length > 0) operator.showVideo(all);
    };
    look();
    document.addEventListener("visibilitychange", look);
    return () => {
      document.removeEventListener("visibilitychange", look);
    };
  }, [operator, ids]);
}
