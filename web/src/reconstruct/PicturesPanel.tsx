import { useMemo } from "react";
import { artifactUrl, getPoses, pictureFile, type RefinedPose } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import type { PictureReport } from "../protocol/messages.gen";
import { words } from "../text/words";
import { blurredPictures, pictureState } from "./pictureState";

/** All pictures of the capture with what became of each; places for those still to be taken. */
export function PicturesPanel() {
  const pictures = useConsole((state) => state.findings.pictures);
  const total = useConsole((state) => state.capture?.images_total ?? 0);
  const sigmas = useSigmas();
  const widest = Math.max(0, ...sigmas.map(({ sigma_m: sigmaM }) => sigmaM));
  const blurred = useMemo(() => blurredPictures(pictures), [pictures]);
  const byIndex = new Map(pictures.map((picture) => [picture.index, picture]));
  const places = Math.max(total, (pictures.at(-1)?.index ?? -1) + 1);
  return (
    <Panel
      title={words.strip.title}
      className="pictures"
      aside={places > 0 && <span>{words.strip.taken(pictures.length, places)}</span>}
    >
      {places === 0 ? (
        <p className="empty">{words.strip.nothing}</p>
      ) : (
        // The list scrolls, so the keyboard must reach it.
        <ol className="sheet" tabIndex={0} aria-label={words.strip.title}>
          {Array.from({ length: places }, (_, index) => (
            <li key={index}>
              <Place number={index + 1} picture={byIndex.get(index)} blurred={blurred.has(index)} />
              <PoseBar pose={sigmas[index]} widestM={widest} />
            </li>
          ))}
        </ol>
      )}
    </Panel>
  );
}

/** How sure the refinement is of each picture's pose; empty before it has said so. */
function useSigmas(): readonly RefinedPose[] {
  const captureId = useConsole((state) => state.capture?.id ?? "");
  const at = useConsole((state) => state.findings.poses?.at ?? "");
  const refined = at === "" ? "" : `${captureId} ${at}`;
  const { value } = useAnswer(refined, () => (refined === "" ? Promise.resolve([]) : getPoses(captureId)));
  return value ?? [];
}

/** One standard deviation of a pose's place, as a number and as a bar beside the widest one. */
function PoseBar({ pose, widestM }: { readonly pose: RefinedPose | undefined; readonly widestM: number }) {
  if (pose === undefined) return null;
  const text = words.strip.sigma((100 * pose.sigma_m).toFixed(1), pose.sigma_deg.toFixed(1));
  return (
    <span className="pose-bar" title={text}>
      <span className="pose-bar-line" aria-hidden="true">
        <span style={{ width: `${widestM > 0 ? (100 * pose.sigma_m) / widestM : 0}%` }} />
      </span>
      <span aria-hidden="true">±{(100 * pose.sigma_m).toFixed(1)} cm</span>
      <span className="sr-only">{text}</span>
    </span>
  );
}

interface PlaceProps {
  readonly number: number;
  readonly picture: PictureReport | undefined;
  readonly blurred: boolean;
}

function Place({ number, picture, blurred }: PlaceProps) {
  if (picture === undefined) {
    return (
      <span className="place">
        {number}
        <span className="sr-only"> {words.strip.empty}</span>
      </span>
    );
  }
  return <Picture picture={picture} blurred={blurred} />;
}

function Picture({ picture, blurred }: { readonly picture: PictureReport; readonly blurred: boolean }) {
  const drone = useConsole((state) => state.drones.get(picture.drone_id)?.report);
  const captureId = useConsole((state) => state.capture?.id ?? "");
  const { poses, training, metrics } = useConsole((state) => state.findings);
  const state = pictureState(picture.index, poses, training, metrics);
  const number = picture.index + 1;
  const label = words.strip.picture(number, drone?.name ?? picture.drone_id, picture.round_index + 1);
  const before = picture.damaged_before;
  const title = before === 0 ? label : `${label}, ${words.strip.damagedBefore(before)}`;
  const file = artifactUrl(captureId, pictureFile(picture.index));
  return (
    <a
      className="picture"
      href={file}
      target="_blank"
      rel="noreferrer"
      title={title}
      style={{ "--drone": drone?.colour ?? "var(--line)" } as React.CSSProperties}
      data-testid={`picture-${picture.index}`}
    >
      <span className="place is-taken">
        <img src={picture.thumbnail} alt={label} width={160} height={120} />
        <span className="place-number" aria-hidden="true">
          {number}
        </span>
      </span>
      <span className="picture-state">
        {state.heldOut && <span className="tag tag-held-out">{words.strip.heldOut}</span>}
        {state.used && (
          <span className="tag">
            <Icon name="check" />
            {words.strip.used}
          </span>
        )}
        {blurred && (
          <span className="tag tag-warning" title={words.strip.blurredMeans}>
            <Icon name="warning" />
            {words.strip.blurred}
          </span>
        )}
        {state.pose === "flight" && (
          <span className="tag tag-warning">
            <Icon name="warning" />
            {words.strip.flightPose}
          </span>
        )}
      </span>
    </a>
  );
}
