import { useState } from "react";
import { artifactUrl, pictureFile, type RunMetrics } from "../api/library";
import { decimal } from "../design/format";
import { Slider } from "../design/Slider";
import { words } from "../text/words";
import { ErrorMap } from "./ErrorMap";
import { renderingFile } from "./heldOut";

interface HeldOutViewProps {
  readonly captureId: string;
  /** Numbers, from 0, of the pictures that were judged; at least one. */
  readonly indices: readonly number[];
  readonly scores: RunMetrics["pictures"];
}

type Shown = "slider" | "error";

/** The pictures that the judged field had not seen, against what it makes of them. */
export function HeldOutView({ captureId, indices, scores }: HeldOutViewProps) {
  const [chosen, setChosen] = useState(indices[0] ?? 0);
  const [shown, setShown] = useState<Shown>("slider");
  const index = indices.includes(chosen) ? chosen : (indices[0] ?? 0);
  const photograph = artifactUrl(captureId, pictureFile(index));
  const rendering = artifactUrl(captureId, renderingFile(index));
  const text = words.judge;
  return (
    <div className="judge" data-testid="held-out">
      <div className="judge-bar">
        <div className="segments" role="group" aria-label={text.shows}>
          {(["slider", "error"] as const).map((each) => (
            <button
              key={each}
              type="button"
              aria-pressed={shown === each}
              data-testid={`judge-${each}`}
              onClick={() => {
                setShown(each);
              }}
            >
              {text.view[each]}
            </button>
          ))}
        </div>
        <select
          className="select-small"
          aria-label={text.picture}
          value={index}
          onChange={(event) => {
            setChosen(Number(event.target.value));
          }}
        >
          {indices.map((each) => (
            <option key={each} value={each}>
              {optionText(each, scores)}
            </option>
          ))}
        </select>
      </div>
      {shown === "slider" ? (
        <Slider
          a={<img src={photograph} alt={text.photograph(index + 1)} />}
          b={<img src={rendering} alt={text.rendering(index + 1)} />}
          nameA={text.nameA}
          nameB={text.nameB}
          label={text.slide}
          valueText={text.slideAt}
          testId="judge-slider"
        />
      ) : (
        <ErrorMap photograph={photograph} rendering={rendering} label={text.map(index + 1)} />
      )}
    </div>
  );
}

function optionText(index: number, scores: RunMetrics["pictures"]): string {
  const name = words.library.taken(index + 1);
  const psnr = scores?.find((score) => score.index === index)?.psnr_db ?? null;
  return psnr === null ? name : `${name}, ${decimal(psnr, 1)} dB`;
}
