import { useEffect, useRef, useState } from "react";
import { words } from "../text/words";
import { errorColour, errorMap, LARGEST_ERROR } from "./errorMap";

interface ErrorMapProps {
  /** The pictures' addresses; the map has the second one's size. */
  readonly photograph: string;
  readonly rendering: string;
  readonly label: string;
}

/** Where a rendering differs from its photograph. */
export function ErrorMap({ photograph, rendering, label }: ErrorMapProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [missing, setMissing] = useState(false);
  useEffect(() => {
    let over = false;
    void Promise.all([loaded(photograph), loaded(rendering)]).then(
      ([taken, made]) => {
        const { current } = canvas;
        if (over || current === null) return;
        setMissing(false);
        draw(current, taken, made);
      },
      () => {
        if (!over) setMissing(true);
      },
    );
    return () => {
      over = true;
    };
  }, [photograph, rendering]);
  const scale = Array.from({ length: 5 }, (_, step) => `rgb(${errorColour(step / 4).join(" ")})`);
  return (
    <figure className="error-map">
      <canvas ref={canvas} role="img" aria-label={label} data-testid="error-map" />
      {missing && <p className="field-error">{words.judge.missing}</p>}
      <figcaption>
        0 %
        <span className="error-scale" style={{ background: `linear-gradient(to right, ${scale.join()})` }} />
        {words.judge.scale(Math.round(100 * LARGEST_ERROR))}
      </figcaption>
    </figure>
  );
}

async function loaded(address: string): Promise<HTMLImageElement> {
  const image = new Image();
  image.src = address;
  await image.decode();
  return image;
}

function draw(canvas: HTMLCanvasElement, taken: HTMLImageElement, made: HTMLImageElement): void {
  const { naturalWidth: width, naturalHeight: height } = made;
  canvas.width = width;
  canvas.height = height;
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  if (pen === null) return;
  const pixels = (image: HTMLImageElement) => {
    pen.drawImage(image, 0, 0, width, height);
    return pen.getImageData(0, 0, width, height).data;
  };
  const photograph = pixels(taken);
  pen.putImageData(new ImageData(errorMap(photograph, pixels(made)), width, height), 0, 0);
}
