import { useId, useState, type SubmitEvent } from "react";
import type { ScaleFound } from "../api/scale";
import { LONG_WORK_MS } from "../api/request";
import { useOperator } from "../context";
import { decimal } from "../design/format";
import { Icon } from "../design/Icon";
import { NumberField } from "../design/NumberField";
import { Waiting } from "../design/Waiting";
import { words } from "../text/words";
import { MarkedPicture } from "./MarkedPicture";
import { endsOf, isEnough, nextEnd, withMark, type End, type Mark } from "./marks";

const MOST_M = 100;

interface KnownLengthProps {
  readonly captureId: string;
  readonly pictures: number;
}

/** Set a capture's scale: mark both ends of something in two pictures, and say how long it is. */
export function KnownLength({ captureId, pictures }: KnownLengthProps) {
  const operator = useOperator();
  const id = useId();
  // Seen from two sides, rays cross at a wide angle.
  const [shown, setShown] = useState<readonly number[]>([0, Math.min(Math.floor(pictures / 4), pictures - 1)]);
  const [marks, setMarks] = useState<readonly Mark[]>([]);
  const [end, setEnd] = useState<End>(0);
  const [length, setLength] = useState("");
  const [asking, setAsking] = useState(false);
  const [found, setFound] = useState<ScaleFound | null>(null);
  const text = words.scale;
  const metres = length.trim() === "" ? NaN : Number(length);
  const fits = metres > 0 && metres <= MOST_M;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    if (!fits || !isEnough(marks) || asking) return;
    setAsking(true);
    void operator
      .scaleCapture(captureId, { length_m: metres, ends: endsOf(marks) })
      .then((scale) => {
        setFound(scale);
        if (scale !== null) setMarks([]);
      })
      .finally(() => {
        setAsking(false);
      });
  };
  return (
    <details className="known-length" data-testid="known-length">
      <summary>{text.title}</summary>
      <p className="hint">{text.hint}</p>
      <div className="segments" role="group" aria-label={text.which}>
        {([0, 1] as const).map((each) => (
          <button
            key={each}
            type="button"
            aria-pressed={end === each}
            onClick={() => {
              setEnd(each);
            }}
          >
            {text.mark(text.end(each))}
          </button>
        ))}
      </div>
      <div className="marked-pictures">
        {shown.map((picture, place) => (
          <div key={place}>
            <select
              className="select-small"
              aria-label={text.choose}
              value={picture}
              onChange={(event) => {
                const chosen = Number(event.target.value);
                const now = shown.map((each, k) => (k === place ? chosen : each));
                setShown(now);
                // What is not to be seen any more must not count unseen.
                setMarks(marks.filter((mark) => now.includes(mark.picture)));
              }}
            >
              {Array.from({ length: pictures }, (_, each) => (
                <option key={each} value={each}>
                  {text.picture(each + 1)}
                </option>
              ))}
            </select>
            <MarkedPicture
              captureId={captureId}
              picture={picture}
              end={end}
              marks={marks.filter((mark) => mark.picture === picture)}
              onMark={({ x, y }) => {
                const marked = withMark(marks, { end, picture, x, y });
                setMarks(marked);
                setEnd(nextEnd(marked, picture, end));
              }}
            />
          </div>
        ))}
      </div>
      <form className="form-row" noValidate onSubmit={submit}>
        <NumberField
          id={id}
          label={text.length}
          min={0}
          max={MOST_M}
          value={length}
          valid={length === "" || fits}
          onChange={setLength}
        />
        <button
          type="submit"
          className="button button-small"
          data-testid="set-scale"
          disabled={!fits || !isEnough(marks) || asking}
        >
          <Icon name="check" />
          {text.set}
        </button>
        {length !== "" && !fits && <p className="field-error">{text.lengthBounds(MOST_M)}</p>}
        {!isEnough(marks) && found === null && <p className="hint">{text.missing}</p>}
      </form>
      {asking && (
        <p>
          <Waiting quiet what={text.setting} mostMs={LONG_WORK_MS} />
        </p>
      )}
      {found !== null && !asking && (
        <p role="status" data-testid="scale-found">
          {text.found(decimal(found.measured_m, 3), decimal(found.factor, 4), decimal(found.sigma, 4))}
        </p>
      )}
    </details>
  );
}
