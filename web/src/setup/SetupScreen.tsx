import { getFloorPlan } from "../api/setup";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { usePreflight } from "../preflight/usePreflight";
import { ChecklistPanel } from "./ChecklistPanel";
import { FloorPlanPanel } from "./FloorPlanPanel";
import { SettingsPanel } from "./SettingsPanel";

/** Before a flight: where the drones go, what is still wrong, and how everything is set. */
export function SetupScreen() {
  const epoch = useConsole((state) => state.epoch);
  const plan = useAnswer(`fleet ${epoch}`, getFloorPlan);
  const preflight = usePreflight();
  return (
    <>
      <div className="column">
        <FloorPlanPanel plan={plan.value} error={plan.error} checks={preflight.checks ?? []} />
      </div>
      <div className="column">
        <ChecklistPanel preflight={preflight} />
      </div>
      <div className="column">
        <SettingsPanel />
      </div>
    </>
  );
}
