import { useState } from "react";
import { artifactUrl } from "../api/library";

interface RunFilmProps {
  readonly captureId: string;
  readonly alt: string;
}

/** The film of a run's field, once round the object; it plays by itself where motion is welcome. */
export function RunFilm({ captureId, alt }: RunFilmProps) {
  const [still] = useState(() => matchMedia("(prefers-reduced-motion: reduce)").matches);
  return (
    <video
      className="run-picture is-film"
      src={artifactUrl(captureId, "orbit.mp4")}
      aria-label={alt}
      data-testid="run-film"
      controls
      loop
      muted
      playsInline
      autoPlay={!still}
    />
  );
}
