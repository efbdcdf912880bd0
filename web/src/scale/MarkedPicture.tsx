import { useState, type KeyboardEvent, type MouseEvent } from "react";
import { artifactUrl, pictureFile } from "../api/library";
import { words } from "../text/words";
import { placeInPicture, within, type End, type Mark, type Place } from "./marks";

/** The steps of the arrow keys, pixels of the picture. */
const STEP = 1;
const LEAP = 20;

interface MarkedPictureProps {
  readonly captureId: string;
  readonly picture: number;
  readonly marks: readonly Mark[];
  /** What the next mark is of: its older mark here is where the arrow keys begin. */
  readonly end: End;
  readonly onMark: (place: Place) => void;
}

/** A picture to put marks on: by a click, or with arrow keys and Enter. */
export function MarkedPicture({ captureId, picture, marks, end, onMark }: MarkedPictureProps) {
  const [whole, setWhole] = useState({ width: 960, height: 720 });
  const [cursor, setCursor] = useState<Place | null>(null);
  const text = words.scale;
  const point = (event: MouseEvent<HTMLDivElement>) => {
    const shown = event.currentTarget.getBoundingClientRect();
    onMark(placeInPicture(event.clientX - shown.left, event.clientY - shown.top, shown, whole));
    setCursor(null);
  };
  const press = (event: KeyboardEvent) => {
    const older = marks.find((mark) => mark.end === end);
    const at = cursor ?? older ?? { x: whole.width / 2, y: whole.height / 2 };
    const step = event.shiftKey ? LEAP : STEP;
    const move = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (move !== undefined) setCursor(within({ x: at.x + (move[0] ?? 0), y: at.y + (move[1] ?? 0) }, whole));
    else if (event.key === "Enter" && cursor !== null) {
      onMark(cursor);
      setCursor(null);
    }
    else return;
    event.preventDefault();
  };
  return (
    <div
      className="marked-picture"
      role="application"
      tabIndex={0}
      aria-label={text.picture(picture + 1)}
      aria-description={text.keys}
      data-testid={`mark-picture-${picture}`}
      onClick={point}
      onKeyDown={press}
    >
      <img
        src={artifactUrl(captureId, pictureFile(picture))}
        alt={text.picture(picture + 1)}
        draggable={false}
        onLoad={(event) => {
          const { naturalWidth: width, naturalHeight: height } = event.currentTarget;
          setWhole({ width, height });
        }}
      />
      {marks.map((mark) => (
        <Cross key={mark.end} place={mark} whole={whole} name={text.end(mark.end)} kind={mark.end === 0 ? "a" : "b"} />
      ))}
      {cursor !== null && <Cross place={cursor} whole={whole} name="" kind="cursor" />}
    </div>
  );
}

interface CrossProps {
  readonly place: Place;
  readonly whole: { readonly width: number; readonly height: number };
  readonly name: string;
  readonly kind: "a" | "b" | "cursor";
}

function Cross({ place, whole, name, kind }: CrossProps) {
  const style = {
    left: `${(100 * (place.x + 0.5)) / whole.width}%`,
    top: `${(100 * (place.y + 0.5)) / whole.height}%`,
  };
  return (
    <span className={`mark-cross mark-cross-${kind}`} style={style}>
      {name}
    </span>
  );
}
