import { useState } from "react";
import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { PriorityList } from "../pick/PriorityList";
import { words } from "../text/words";
import { VideoTile } from "./VideoTile";

/** All drones side by side, or one large and the others beside it. */
export function FlyPanel() {
  const drones = useConsole((state) => state.drones);
  const [chosen, setChosen] = useState<string | null>(null);
  const focus = chosen !== null && drones.has(chosen) ? chosen : null;
  const all = [...drones.values()];
  const online = all.filter((drone) => drone.report.activity !== "offline").length;
  return (
    <Panel
      title={words.fly.title}
      className="fly"
      aside={all.length > 0 && <span>{words.fly.count(online, all.length)}</span>}
    >
      {all.length === 0 && <p className="empty">{words.fly.none}</p>}
      <div className={`tiles ${focus === null ? "" : "has-focus"}`} data-count={all.length}>
        {all.map((drone) => {
          const id = drone.report.drone_id;
          return (
            <VideoTile
              key={id}
              drone={drone}
              size={focus === null ? "even" : focus === id ? "large" : "small"}
              onToggle={() => {
                setChosen(focus === id ? null : id);
              }}
            />
          );
        })}
      </div>
      <PriorityList />
    </Panel>
  );
}
