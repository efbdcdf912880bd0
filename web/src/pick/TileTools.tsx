import { useState } from "react";
import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { activityFace } from "../fly/activity";
import { fliesByItself, type DroneState } from "../state/state";
import { words } from "../text/words";
import type { Place } from "./box";
import { PickSurface, type PickMode } from "./PickSurface";

interface TileToolsProps {
  readonly drone: DroneState;
  /** False where there is no live picture to point at. */
  readonly live: boolean;
}

/** Over a tile's picture: say where the object is, or which part of it matters. */
export function TileTools({ drone, live }: TileToolsProps) {
  const operator = useOperator();
  const { drone_id: droneId, name, activity } = drone.report;
  const picked = useConsole((state) => state.picks.has(droneId));
  const flies = useConsole((state) => fliesByItself(state.capture));
  const [mode, setMode] = useState<PickMode | null>(null);
  const inAir = flies && activityFace(activity).inAir;
  const cancel = () => {
    setMode(null);
  };
  const place = (where: Place) => {
    setMode(null);
    if (mode === "object") void operator.pickObject(droneId, where);
    else if (where.kind === "box") void operator.addPriority(droneId, where.box);
  };
  // Pictures may falter during a gesture; the server refuses where there is none.
  if (mode !== null) {
    return (
      <>
        <PickSurface mode={mode} name={name} onPlace={place} onCancel={cancel} />
        <div className="tile-tools">
          <button type="button" className="tool" data-testid={`cancel-pick-${droneId}`} onClick={cancel}>
            <Icon name="close" />
            {words.pick.cancel}
          </button>
        </div>
      </>
    );
  }
  return (
    <div className="tile-tools">
      <button
        type="button"
        className="tool"
        title={words.pick.object.does}
        disabled={!live}
        data-testid={`pick-${droneId}`}
        onClick={() => {
          setMode("object");
        }}
      >
        <Icon name="target" />
        {words.pick.object.word}
      </button>
      {picked && (
        <button
          type="button"
          className="tool is-on"
          title={words.pick.search.does}
          data-testid={`search-${droneId}`}
          onClick={() => {
            void operator.searchObject(droneId);
          }}
        >
          <Icon name="rearm" />
          {words.pick.search.word}
        </button>
      )}
      {inAir && (
        <button
          type="button"
          className="tool"
          title={words.pick.priority.does}
          disabled={!live}
          data-testid={`priority-${droneId}`}
          onClick={() => {
            setMode("priority");
          }}
        >
          <Icon name="star" />
          {words.pick.priority.word}
        </button>
      )}
    </div>
  );
}
