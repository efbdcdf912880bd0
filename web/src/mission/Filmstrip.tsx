import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import type { PictureReport } from "../protocol/messages.gen";
import { en } from "../text/en";

/** All pictures of the capture as they come; places for those still to be taken. */
export function Filmstrip() {
  const pictures = useConsole((state) => state.findings.pictures);
  const total = useConsole((state) => state.capture?.images_total ?? 0);
  const byIndex = new Map(pictures.map((picture) => [picture.index, picture]));
  const places = Math.max(total, (pictures.at(-1)?.index ?? -1) + 1);
  return (
    <Panel
      title={en.strip.title}
      className="strip"
      aside={places > 0 && <span>{en.strip.taken(pictures.length, places)}</span>}
    >
      {places === 0 ? (
        <p className="empty">{en.strip.nothing}</p>
      ) : (
        // The strip scrolls, so the keyboard must reach it.
        <ol className="sheet" tabIndex={0} aria-label={en.strip.title}>
          {Array.from({ length: places }, (_, index) => (
            <li key={index}>
              <Place number={index + 1} picture={byIndex.get(index)} />
            </li>
          ))}
        </ol>
      )}
    </Panel>
  );
}

function Place({ number, picture }: { readonly number: number; readonly picture: PictureReport | undefined }) {
  const drone = useConsole((state) => picture && state.drones.get(picture.drone_id)?.report);
  if (picture === undefined) {
    return (
      <span className="place">
        {number}
        <span className="sr-only"> {en.strip.empty}</span>
      </span>
    );
  }
  const label = en.strip.picture(number, drone?.name ?? picture.drone_id, picture.round_index + 1);
  return (
    <span
      className="place is-taken"
      title={label}
      style={{ "--drone": drone?.colour ?? "var(--line)" } as React.CSSProperties}
    >
      <img src={picture.thumbnail} alt={label} width={160} height={120} />
      <span className="place-number" aria-hidden="true">
        {number}
      </span>
    </span>
  );
}
