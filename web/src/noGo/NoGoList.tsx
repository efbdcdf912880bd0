import { useId, useState, type SubmitEvent } from "react";
import { useOperator } from "../context";
import { Icon } from "../design/Icon";
import { NumberField } from "../design/NumberField";
import { isArea, type FloorArea } from "../floor/area";
import type { NoGoVolume } from "../protocol/messages.gen";
import { words } from "../text/words";
import { nameOf } from "./marked";

interface NoGoListProps {
  readonly volumes: readonly NoGoVolume[];
  readonly chosen: string | null;
  readonly onChosen: (id: string | null) => void;
}

/** The volumes that no drone may enter; the chosen one with its numbers. */
export function NoGoList({ volumes, chosen, onChosen }: NoGoListProps) {
  const operator = useOperator();
  const text = words.noGo;
  if (volumes.length === 0) return null;
  return (
    <ul className="parts no-go-list" aria-label={text.title} data-testid="no-go">
      {volumes.map((volume) => (
        <li key={volume.id} className={volume.id === chosen ? "is-chosen" : ""}>
          {volume.configured ? (
            <span>{nameOf(volume)}</span>
          ) : (
            <button
              type="button"
              className="link-button"
              aria-expanded={volume.id === chosen}
              onClick={() => {
                onChosen(volume.id === chosen ? null : volume.id);
              }}
            >
              {nameOf(volume)}
            </button>
          )}
          <span className="parts-size">{sizeOf(volume)}</span>
          {volume.configured ? (
            <span className="hint">{text.configured}</span>
          ) : (
            <button
              type="button"
              className="button button-small"
              onClick={() => {
                void operator.dropNoGo(volume.id);
              }}
            >
              <Icon name="close" />
              {text.remove}
              <span className="sr-only"> {nameOf(volume)}</span>
            </button>
          )}
          {volume.id === chosen && !volume.configured && (
            <NoGoForm volume={volume} />
          )}
        </li>
      ))}
    </ul>
  );
}

const SIDES = ["west", "south", "east", "north"] as const;
type Side = (typeof SIDES)[number];

function NoGoForm({ volume }: { readonly volume: NoGoVolume }) {
  const operator = useOperator();
  const text = words.noGo;
  const id = useId();
  // What is not typed here follows the volume, which may be moved on the plan or elsewhere.
  const [typed, setTyped] = useState<Partial<Record<Side, string>>>({});
  const shown = SIDES.map((side, index) => typed[side] ?? String(tidy(volume.area[index] ?? 0)));
  const numbers = shown.map((each) => (each.trim() === "" ? Number.NaN : Number(each)));
  const [west = NaN, south = NaN, east = NaN, north = NaN] = numbers;
  const area: FloorArea = [west, south, east, north];
  const valid = numbers.every(Number.isFinite) && isArea(area);
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (!valid) return;
    void operator.changeNoGo(volume.id, area).then((accepted) => {
      if (accepted) setTyped({});
    });
  };
  return (
    <form className="no-go-form" noValidate onSubmit={submit}>
      {SIDES.map((side, index) => (
        <NumberField
          key={side}
          id={`${id}-${side}`}
          label={text.side[side]}
          min={-100}
          max={100}
          value={shown[index] ?? ""}
          valid={Number.isFinite(numbers[index])}
          describedBy={`${id}-hint`}
          onChange={(value) => {
            setTyped({ ...typed, [side]: value });
          }}
        />
      ))}
      <button type="submit" className="button button-small" disabled={!valid}>
        {text.save}
      </button>
      <p id={`${id}-hint`} className={valid ? "hint" : "field-error"}>
        {valid ? text.axes : text.bad}
      </p>
    </form>
  );
}

function sizeOf({ area }: NoGoVolume): string {
  const [x0 = 0, y0 = 0, x1 = 0, y1 = 0] = area;
  return `${(x1 - x0).toFixed(2)} × ${(y1 - y0).toFixed(2)} m`;
}

function tidy(metres: number): number {
  return Math.round(metres * 1000) / 1000;
}
