import type { CaptureRequest } from "../api/captures";
import { FailsafePanel } from "../failsafe/FailsafePanel";
import { EventLog } from "../log/EventLog";
import { ManualPanel } from "../manual/ManualPanel";
import { MissionPanel } from "../mission/MissionPanel";
import { FlyPanel } from "./FlyPanel";
import { HistoryPanel } from "./HistoryPanel";

/** Drones in the air: their pictures, how they are, what they are doing and what watches them. */
export function FlyScreen({ onPrepare }: { readonly onPrepare: (request: CaptureRequest) => void }) {
  return (
    <>
      <div className="column column-drones">
        <FlyPanel />
      </div>
      <div className="column column-watch">
        <HistoryPanel />
        <FailsafePanel />
        <EventLog />
      </div>
      <div className="column column-mission">
        <MissionPanel onPrepare={onPrepare} />
        <ManualPanel />
      </div>
    </>
  );
}
