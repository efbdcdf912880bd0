import { useState, type ReactNode } from "react";

interface SliderProps {
  /** What lies on the left, in the flow of the page, and what lies over it on the right. */
  readonly a: ReactNode;
  readonly b: ReactNode;
  readonly nameA: string;
  readonly nameB: string;
  readonly label: string;
  readonly valueText: (share: number) => string;
  readonly testId: string;
  /** Stands beside the slider. */
  readonly children?: ReactNode;
}

/** Two pictures or films of the same size under one slider. */
export function Slider({ a, b, nameA, nameB, label, valueText, testId, children }: SliderProps) {
  const [share, setShare] = useState(50);
  return (
    <figure className="slider">
      <div className="slider-pictures" style={{ "--share": `${share}%` } as React.CSSProperties}>
        {a}
        <div className="slider-over">{b}</div>
        <span className="slider-name slider-name-a">{nameA}</span>
        <span className="slider-name slider-name-b">{nameB}</span>
      </div>
      <div className="slider-controls">
        <label>
          {label}
          <input
            type="range"
            min={0}
            max={100}
            value={share}
            data-testid={testId}
            aria-valuetext={valueText(share)}
            onChange={(event) => {
              setShare(Number(event.target.value));
            }}
          />
        </label>
        {children}
      </div>
    </figure>
  );
}
