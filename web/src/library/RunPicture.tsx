import { useState } from "react";
import { artifactUrl } from "../api/library";
import { Icon } from "../design/Icon";

interface RunPictureProps {
  readonly captureId: string;
  /** The first of these files that there is. */
  readonly files: readonly string[];
  readonly alt: string;
}

/** A picture of a run, or a drawing in its place where the run has none. */
export function RunPicture({ captureId, files, alt }: RunPictureProps) {
  const [tried, setTried] = useState(0);
  const file = files[tried];
  if (file === undefined) {
    return (
      <span className="run-picture is-empty">
        <Icon name="picture" />
      </span>
    );
  }
  return (
    <img
      className="run-picture"
      src={artifactUrl(captureId, file)}
      alt={alt}
      loading="lazy"
      onError={() => {
        setTried(tried + 1);
      }}
    />
  );
}
