import { getPlan } from "../api/plans";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { ScenePanel } from "../scene/ScenePanel";
import { AnnealingPanel } from "./AnnealingPanel";
import { PlanPanel } from "./PlanPanel";
import { PlanViewSwitch } from "./PlanViewSwitch";
import { TopView } from "./TopView";
import { ViewpointsPanel } from "./ViewpointsPanel";

/** Where the pictures are taken: the scene, what was chosen and what it costs. */
export function PlanScreen() {
  const known = useConsole((state) => `${state.epoch} ${state.findings.plan?.at ?? ""}`);
  const answer = useAnswer(known, getPlan);
  const plan = answer.value;
  return (
    <>
      <div className="column column-scene">
        <ScenePanel aside={<PlanViewSwitch comparable={(plan?.ring.length ?? 0) > 0} />} />
      </div>
      <div className="column">
        <PlanPanel answer={answer} />
        {plan === null ? <TopView plan={plan} /> : <ViewpointsPanel plan={plan} />}
      </div>
      <div className="column">
        <AnnealingPanel plan={plan} />
        {plan !== null && <TopView plan={plan} />}
      </div>
    </>
  );
}
