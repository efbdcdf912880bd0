import { useId, useState, type SubmitEvent } from "react";
import { useOperator } from "../context";
import { CheckBox } from "../design/CheckBox";
import { Icon } from "../design/Icon";
import { NumberField } from "../design/NumberField";
import { Waiting } from "../design/Waiting";
import { words } from "../text/words";

const LEAST_S = 1;
const MOST_S = 86_400;
const MOST_SEED = 2 ** 32 - 1;

interface TrainingFormProps {
  readonly captureId: string;
  readonly onStarted: () => void;
}

/** With what settings to train anew. */
export function TrainingForm({ captureId, onStarted }: TrainingFormProps) {
  const operator = useOperator();
  const id = useId();
  const [seconds, setSeconds] = useState("60");
  const [seed, setSeed] = useState("0");
  const [objectOnly, setObjectOnly] = useState(false);
  const [asking, setAsking] = useState(false);
  const text = words.retrain;
  const wish = {
    capture: captureId,
    seconds: numberIn(seconds),
    seed: numberIn(seed),
    object_only: objectOnly,
  };
  const secondsFit = wish.seconds >= LEAST_S && wish.seconds <= MOST_S;
  const seedFits = Number.isInteger(wish.seed) && wish.seed >= 0 && wish.seed <= MOST_SEED;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (!secondsFit || !seedFits || asking) return;
    setAsking(true);
    void operator
      .trainAnew(wish)
      .then(onStarted)
      .finally(() => {
        setAsking(false);
      });
  };
  return (
    <form className="form-row" noValidate onSubmit={submit}>
      <NumberField
        id={`${id}-seconds`}
        label={text.seconds}
        min={LEAST_S}
        max={MOST_S}
        value={seconds}
        valid={secondsFit}
        onChange={setSeconds}
      />
      <NumberField
        id={`${id}-seed`}
        label={text.seed}
        whole
        min={0}
        max={MOST_SEED}
        value={seed}
        valid={seedFits}
        onChange={setSeed}
      />
      <label className="retrain-only">
        <CheckBox checked={objectOnly} onChange={setObjectOnly} />
        {text.objectOnly}
      </label>
      <button
        type="submit"
        className="button button-small"
        data-testid="train-anew"
        disabled={!secondsFit || !seedFits || asking}
      >
        <Icon name="play" />
        {text.start}
      </button>
      {asking && <Waiting quiet what={text.begins} />}
      {!secondsFit && <p className="field-error">{text.secondsBounds(LEAST_S, MOST_S)}</p>}
      {!seedFits && <p className="field-error">{text.seedBounds(MOST_SEED)}</p>}
    </form>
  );
}

/** An empty field is no zero. */
function numberIn(text: string): number {
  return text.trim() === "" ? NaN : Number(text);
}
