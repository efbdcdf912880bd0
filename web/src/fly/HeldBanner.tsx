import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { words } from "../text/words";

/** Says which drones are held, and frees them. Nothing is shown while none is. */
export function HeldBanner() {
  const operator = useOperator();
  const drones = useConsole((state) => state.drones);
  const held = [...drones.values()].map((drone) => drone.report).filter((report) => report.held);
  const [first] = held;
  if (first === undefined) return null;
  const text =
    held.length === 1
      ? words.held.one(first.name)
      : held.length === drones.size
        ? words.held.all(held.length)
        : words.held.some(held.map((report) => report.name).join(", "));
  const rearm = () => {
    for (const report of held) void operator.command(report.drone_id, "rearm");
  };
  return (
    <div className="band band-held" role="status" data-testid="held-banner">
      <Icon name="hold" />
      <strong>{words.held.word}</strong>
      <span className="band-text">{text}</span>
      <button type="button" className="button" data-testid="rearm-all" onClick={rearm}>
        <Icon name="rearm" />
        {held.length > 1 ? words.held.rearmAll : words.held.rearm}
      </button>
    </div>
  );
}
