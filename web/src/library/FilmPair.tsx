import { useEffect, useRef, useState } from "react";
import { artifactUrl } from "../api/library";
import { Icon } from "../design/Icon";
import { Slider } from "../design/Slider";
import { words } from "../text/words";

interface FilmPairProps {
  readonly a: string;
  readonly b: string;
  readonly altA: string;
  readonly altB: string;
}

/** Farther apart than this, seconds, the second film is set to where the first one is. */
const APART_S = 0.06;

/** Two runs' films, once round the object, in step under one slider. */
export function FilmPair({ a, b, altA, altB }: FilmPairProps) {
  const first = useRef<HTMLVideoElement>(null);
  const second = useRef<HTMLVideoElement>(null);
  const [playing, setPlaying] = useState(() => !matchMedia("(prefers-reduced-motion: reduce)").matches);
  const [turn, setTurn] = useState(0);
  const text = words.library;
  useEffect(() => {
    for (const film of [first.current, second.current]) {
      if (playing) film?.play().catch(() => undefined); // One that is not there stays black.
      else film?.pause();
    }
  }, [playing]);
  const follow = () => {
    const [lead, other] = [first.current, second.current];
    if (lead === null || other === null || !(lead.duration > 0)) return;
    setTurn(lead.currentTime / lead.duration);
    setStep(lead, other);
  };
  const film = { loop: true, muted: true, playsInline: true, autoPlay: playing, preload: "auto" } as const;
  return (
    <Slider
      a={<video ref={first} {...film} src={artifactUrl(a, "orbit.mp4")} aria-label={altA} onTimeUpdate={follow} />}
      b={<video ref={second} {...film} src={artifactUrl(b, "orbit.mp4")} aria-label={altB} onLoadedData={follow} />}
      nameA="A"
      nameB="B"
      label={text.slide}
      valueText={text.slideAt}
      testId="compare-slider"
    >
      <button
        type="button"
        className="button button-small"
        onClick={() => {
          setPlaying(!playing);
        }}
      >
        <Icon name={playing ? "pause" : "play"} />
        {playing ? text.stand : text.turn}
      </button>
      <label>
        {text.around}
        <input
          type="range"
          min={0}
          max={359}
          value={Math.round(360 * turn) % 360}
          aria-valuetext={`${Math.round(360 * turn)}°`}
          onChange={(event) => {
            const lead = first.current;
            setPlaying(false);
            if (lead === null || !(lead.duration > 0)) return;
            lead.currentTime = (Number(event.target.value) / 360) * lead.duration;
            follow();
          }}
        />
      </label>
    </Slider>
  );
}

/** Set the second film to the first one's share of the way round. */
function setStep(lead: HTMLVideoElement, other: HTMLVideoElement): void {
  if (!(other.duration > 0)) return;
  const wanted = (lead.currentTime / lead.duration) * other.duration;
  if (Math.abs(other.currentTime - wanted) > APART_S) other.currentTime = wanted;
}
