import { useId, useState, type SubmitEvent } from "react";
import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { NumberField } from "../design/NumberField";
import { isActive, type ConsoleState } from "../state/state";
import { words } from "../text/words";

/** A capture takes no more in all; the server says so, too. */
const MOST = 400;
/** On their way down or past it: no picture more can be taken. */
const FLOWN: readonly string[] = ["land", "train", "done", "ended"];

/** Take more pictures than was asked for, where they add most to those taken and planned. */
export function MoreViews() {
  const operator = useOperator();
  const text = words.plan.more;
  const id = useId();
  const captureId = useConsole(chosenCapture);
  const drones = useConsole((state) => state.drones.size);
  const left = useConsole((state) => MOST - (state.capture?.images_total ?? 0));
  const [wish, setWish] = useState<string | null>(null);
  const [asking, setAsking] = useState(false);
  if (captureId === null || left < 1) return null;
  const shown = wish ?? String(Math.max(1, Math.min(drones, left)));
  const count = Number(shown);
  const valid = Number.isInteger(count) && count >= 1 && count <= left;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (!valid || asking) return;
    setAsking(true);
    void operator.addPictures(captureId, count).finally(() => {
      setAsking(false);
    });
  };
  return (
    <form className="more-views" noValidate onSubmit={submit}>
      <NumberField
        id={id}
        label={text.label}
        whole
        min={1}
        max={left}
        value={shown}
        valid={valid}
        describedBy={`${id}-hint`}
        onChange={setWish}
      />
      <button
        type="submit"
        className="button button-small"
        data-testid="more-views"
        disabled={!valid || asking}
      >
        <Icon name="play" />
        {text.add}
      </button>
      <p id={`${id}-hint`} className={valid ? "hint" : "field-error"}>
        {valid ? text.hint : text.bounds(left)}
      </p>
    </form>
  );
}

/** The capture whose viewpoints are being chosen, null where none are or the ring is flown. */
function chosenCapture({ capture }: ConsoleState): string | null {
  if (capture === null || !isActive(capture) || capture.mode !== "optimized") return null;
  return FLOWN.includes(capture.phase) ? null : capture.id;
}
