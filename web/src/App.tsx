import { useEffect } from "react";
import { useConsole, useOperator } from "./context";
import { FieldPanel } from "./field/FieldPanel";
import { FlyPanel } from "./fly/FlyPanel";
import { Header } from "./Header";
import { EventLog } from "./log/EventLog";
import { Filmstrip } from "./mission/Filmstrip";
import { MissionPanel } from "./mission/MissionPanel";
import { ScenePanel } from "./scene/ScenePanel";

/** The whole console: stops above, then drones, scene with field, and mission with events. */
export function App() {
  useVideoWhileVisible();
  return (
    <>
      <Header />
      <main className="console">
        <div className="column column-drones">
          <FlyPanel />
          <Filmstrip />
        </div>
        <div className="column column-scene">
          <ScenePanel />
          <FieldPanel />
        </div>
        <div className="column column-mission">
          <MissionPanel />
          <EventLog />
        </div>
      </main>
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
