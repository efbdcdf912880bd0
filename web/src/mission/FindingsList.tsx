import { Fragment, type ReactNode } from "react";
import { Countdown } from "../design/Waiting";
import { searchOf } from "../plan/search";
import type { Findings } from "../state/state";
import { words } from "../text/words";

/** What the mission has found out so far: the object, the plan, the poses. */
export function FindingsList({ findings, run }: { readonly findings: Findings; readonly run: string | null }) {
  const { seed, coverage, plan, planning, annealing, poses } = findings;
  const text = words.mission.findings;
  const rows: [string, ReactNode][] = [];
  if (seed !== null) {
    const size = seed.size.map((metres) => metres.toFixed(2)).join(" × ");
    rows.push([text.object, text.objectSize(size, seed.boxes, seed.views)]);
  }
  // After a reconnection the annealing's last word may come behind the plan it led to.
  if (planning !== null && (plan === null || planning.at > plan.at)) {
    const { share, leftS } = searchOf(annealing) ?? { share: 0, leftS: null };
    rows.push([
      text.plan,
      <Fragment key="planning">
        {text.planning(Math.round(100 * share))} <Countdown key={planning.at} leftS={leftS} />
      </Fragment>,
    ]);
    rows.push([text.fitness, planning.fitness.toFixed(4)]);
  } else if (plan !== null) {
    // The ring is taken as it is: nothing was weighed.
    const weighed = Object.keys(plan.terms).length > 0;
    rows.push([text.plan, weighed ? text.planFound(plan.viewpoints, plan.candidates) : text.ring(plan.viewpoints)]);
    if (weighed) rows.push([text.fitness, <PlanFitness key="fitness" fitness={plan.fitness} bound={plan.bound} />]);
  }
  if (coverage !== null) {
    const { share_once: once, share_thrice: thrice } = coverage;
    rows.push([text.seen, text.seenShares(Math.round(100 * once), Math.round(100 * thrice))]);
  }
  if (poses !== null) rows.push([text.poses, text.refined(poses.refined, poses.images)]);
  if (run !== null && run !== "") rows.push([words.mission.run, <code key="run">{run}</code>]);
  if (rows.length === 0) return null;
  return (
    <dl className="findings">
      {rows.map(([word, value]) => (
        <div key={word}>
          <dt>{word}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

function PlanFitness({ fitness, bound }: { readonly fitness: number; readonly bound: number | null }) {
  if (bound === null || bound <= 0) return fitness.toFixed(4);
  const gap = Math.max(0, (100 * (bound - fitness)) / bound);
  return (
    <>
      {fitness.toFixed(4)}
      <small> {words.mission.findings.bound(gap.toFixed(1))}</small>
    </>
  );
}
