import type { ReactNode } from "react";
import type { Plan } from "../api/plans";
import type { Answer } from "../api/useAnswer";
import { useConsole } from "../context";
import { clock, decimal } from "../design/format";
import { Panel } from "../design/Panel";
import { Asking } from "../design/Waiting";
import { drainPerS } from "../state/history";
import { isActive } from "../state/state";
import { words } from "../text/words";
import { MoreViews } from "./MoreViews";
import { flightLeftS, nearestM, routes, usualFlightS } from "./route";

/** A Tello flies for 13 minutes on a full battery. */
const USUAL_DRAIN_PCT_S = 100 / (13 * 60);

/** What was chosen, how good it is, and what it costs in time and battery. */
export function PlanPanel({ answer }: { readonly answer: Answer<Plan | null> }) {
  const { value: plan, error, asking } = answer;
  const text = words.plan;
  return (
    <Panel title={text.title} className="plan-facts">
      {error !== null && <p className="field-error">{text.unknown(error)}</p>}
      {plan !== null ? <Facts plan={plan} /> : asking ? <Asking /> : <p className="empty">{text.none}</p>}
    </Panel>
  );
}

function Facts({ plan }: { readonly plan: Plan }) {
  const text = words.plan;
  const coverage = useConsole((state) => state.findings.coverage);
  const apart = nearestM(plan.viewpoints);
  // The ring is taken as it is: nothing was weighed.
  const weighed = Object.keys(plan.terms).length > 0;
  const rows: (readonly [string, ReactNode])[] = [
    [
      text.chosen,
      weighed
        ? text.chosenOf(plan.viewpoints.length, plan.candidates)
        : words.mission.findings.ring(plan.viewpoints.length),
    ],
  ];
  if (weighed) rows.push([text.fitness, decimal(plan.fitness, 4)]);
  if (plan.bound !== null && plan.fitness !== null && plan.bound > 0) {
    const gap = Math.max(0, (100 * (plan.bound - plan.fitness)) / plan.bound);
    rows.push([text.bound, words.mission.findings.bound(gap.toFixed(1))]);
  }
  if (plan.expected !== null) {
    const { once, thrice } = plan.expected;
    rows.push([text.expected, text.shares(percent(once), percent(thrice))]);
  }
  if (plan.ring_expected !== null) {
    const { once, thrice } = plan.ring_expected;
    rows.push([text.ringExpected, text.shares(percent(once), percent(thrice))]);
  }
  if (coverage !== null) {
    rows.push([text.seen, text.shares(percent(coverage.share_once), percent(coverage.share_thrice))]);
  }
  if (apart !== null) rows.push([text.apart, `${apart.toFixed(2)} m`]);
  return (
    <>
      <dl className="findings">
        {rows.map(([word, value]) => (
          <div key={word}>
            <dt>{word}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {weighed && <Terms terms={plan.terms} />}
      <Costs plan={plan} />
      <MoreViews />
    </>
  );
}

function percent(share: number): number {
  return Math.round(100 * share);
}

/** The fitness's terms before weighting; all but the overlap are better when larger. */
function Terms({ terms }: { readonly terms: Plan["terms"] }) {
  const names: Readonly<Record<string, string>> = words.plan.term;
  return (
    <dl className="terms" aria-label={words.plan.terms}>
      {Object.entries(terms).map(([name, value]) => (
        <div key={name}>
          <dt>{names[name] ?? name}</dt>
          <dd>
            <span className="term-bar" aria-hidden="true">
              <span style={{ width: `${100 * Math.min(1, Math.max(0, value ?? 0))}%` }} />
            </span>
            {decimal(value, 2)}
          </dd>
        </div>
      ))}
    </dl>
  );
}

/** By drone: its route, and its battery after the last picture at the pace of this flight. */
function Costs({ plan }: { readonly plan: Plan }) {
  const text = words.plan;
  const drones = useConsole((state) => state.drones);
  const history = useConsole((state) => state.history);
  const capture = useConsole((state) => state.capture);
  const since = useConsole((state) => state.stepEntered.rounds);
  const taken = capture !== null && capture.images >= capture.images_total;
  const flying = capture !== null && isActive(capture) && !taken;
  const paceS = flying ? flightLeftS(capture, since) : null;
  // Before the flight has a pace of its own, what such ways usually take.
  const leftS = paceS ?? (flying ? usualFlightS(plan.viewpoints, capture.round_index) : null);
  return (
    <>
      <table className="table costs">
        <thead>
          <tr>
            <th scope="col">{text.drone}</th>
            <th scope="col">{text.views}</th>
            <th scope="col">{text.route}</th>
            {flying && <th scope="col">{text.batteryThen}</th>}
          </tr>
        </thead>
        <tbody>
          {routes(plan.viewpoints).map((route) => {
            const report = drones.get(route.droneId)?.report;
            const drain = drainPerS(history, route.droneId) ?? USUAL_DRAIN_PCT_S;
            const charge = report?.battery_pct ?? null;
            const then =
              leftS === null || charge === null ? null : charge - drain * leftS;
            return (
              <tr key={route.droneId} style={{ "--drone": report?.colour ?? "var(--line)" } as React.CSSProperties}>
                <th scope="row" className="line-drone">
                  {report?.name ?? route.droneId}
                </th>
                <td>{route.ordered.length}</td>
                <td>{route.lengthM.toFixed(1)} m</td>
                {flying && (
                  <td className={then !== null && then < 20 ? "is-late" : ""}>
                    {then === null ? words.none : `${Math.max(0, Math.round(then))} %`}
                  </td>
                )}
              </tr>
            );
          })}
        </tbody>
      </table>
      {taken && <p className="hint">{text.allTaken}</p>}
      {leftS !== null && <p className="hint">{(paceS === null ? text.usual : text.pace)(clock(leftS))}</p>}
    </>
  );
}
