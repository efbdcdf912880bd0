import { useCallback, useState } from "react";
import { getFloorPlan } from "../api/setup";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { usePreflight } from "../preflight/usePreflight";
import { CalibrationPanel } from "./CalibrationPanel";
import { calibrateButtonId } from "./CalibrationTable";
import { ChecklistPanel } from "./ChecklistPanel";
import { FloorPlanPanel } from "./FloorPlanPanel";
import { SettingsPanel } from "./SettingsPanel";

/** Before a flight: where the drones go, what is still wrong, and how everything is set. */
export function SetupScreen() {
  const epoch = useConsole((state) => state.epoch);
  const plan = useAnswer(`fleet ${epoch}`, getFloorPlan);
  const preflight = usePreflight();
  const [calibrated, setCalibrated] = useState<string | null>(null);
  const place = plan.value?.places.find((each) => each.drone_id === calibrated);
  const close = useCallback(() => {
    setCalibrated(null);
    // Back to where it was opened from.
    if (calibrated !== null) document.getElementById(calibrateButtonId(calibrated))?.focus();
  }, [calibrated]);
  return (
    <>
      <div className="column">
        <FloorPlanPanel plan={plan.value} error={plan.error} checks={preflight.checks ?? []} onCalibrate={setCalibrated} />
      </div>
      <div className="column">
        <ChecklistPanel preflight={preflight} />
      </div>
      <div className="column">
        {place === undefined ? (
          <SettingsPanel />
        ) : (
          <CalibrationPanel key={place.drone_id} place={place} onClose={close} onUsed={plan.again} />
        )}
      </div>
    </>
  );
}
