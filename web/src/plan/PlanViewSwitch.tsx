import { useConsole, useOperator } from "../context";
import type { ShownPlan } from "../api/plans";
import { words } from "../text/words";

const CHOICES: readonly ShownPlan[] = ["planned", "ring", "both"];

/** What the scene shows: the plan, the standard ring around the same object, or both. */
export function PlanViewSwitch({ comparable }: { readonly comparable: boolean }) {
  const operator = useOperator();
  const shown = useConsole((state) => state.planView);
  if (!comparable) return null;
  return (
    <div className="segments" role="group" aria-label={words.plan.shows}>
      {CHOICES.map((choice) => (
        <button
          key={choice}
          type="button"
          aria-pressed={shown === choice}
          data-testid={`plan-view-${choice}`}
          onClick={() => void operator.choosePlanView(choice)}
        >
          {words.plan.view[choice]}
        </button>
      ))}
    </div>
  );
}
