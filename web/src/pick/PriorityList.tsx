import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { words } from "../text/words";

/** The parts of the object that shall have better pictures; nothing while there are none. */
export function PriorityList() {
  const operator = useOperator();
  const parts = useConsole((state) => state.priorities);
  const drones = useConsole((state) => state.drones);
  if (parts.length === 0) return null;
  return (
    <ul className="parts" aria-label={words.pick.parts} data-testid="priorities">
      {parts.map((part) => {
        const name = drones.get(part.drone_id)?.report.name ?? part.drone_id;
        const size = part.size?.map((metres) => metres.toFixed(2)).join(" × ");
        return (
          <li key={part.id}>
            <Icon name="star" />
            <span>{words.pick.part(name, part.weight)}</span>
            <span className="parts-size">{size === undefined ? words.pick.partWaits : `${size} m`}</span>
            <button
              type="button"
              className="button button-small"
              onClick={() => {
                void operator.dropPriority(part.id);
              }}
            >
              <Icon name="close" />
              {words.pick.remove}
              <span className="sr-only"> {words.pick.part(name, part.weight)}</span>
            </button>
          </li>
        );
      })}
    </ul>
  );
}
