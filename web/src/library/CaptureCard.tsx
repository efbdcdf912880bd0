import type { CaptureEntry } from "../api/library";
import { CheckBox } from "../design/CheckBox";
import { decimal, moment } from "../design/format";
import { Icon } from "../design/Icon";
import { hashOfScreen } from "../shell/screens";
import { words } from "../text/words";
import { CaptureChip } from "../mission/CaptureStatus";
import { RunPicture } from "./RunPicture";

interface CaptureCardProps {
  readonly entry: CaptureEntry;
  readonly current: boolean;
  readonly marked: boolean;
  /** True when two are marked already. */
  readonly full: boolean;
  readonly onMark: (mark: boolean) => void;
}

/** One capture of the list: picture, name, state and figures. */
export function CaptureCard({ entry, current, marked, full, onMark }: CaptureCardProps) {
  const name = entry.name === "" ? entry.id : entry.name;
  const psnr = entry.metrics?.psnr_db ?? null;
  const text = words.library;
  const files = picturesOf(entry);
  return (
    <li className={`capture-card ${current ? "is-current" : ""}`} data-testid={`capture-${entry.id}`}>
      <RunPicture key={files.join()} captureId={entry.id} files={files} alt="" />
      <div className="capture-words">
        <a
          className="capture-name"
          href={hashOfScreen("library", entry.id)}
          aria-current={current ? "true" : undefined}
        >
          {name}
        </a>
        <span className="capture-when">{moment(entry.started_at)}</span>
        <span className="capture-line">
          <CaptureChip state={entry.state} />
          <span>{modeWord(entry.mode)}</span>
          <span>{text.pictures(entry.images, entry.images_total)}</span>
          {psnr !== null && <strong>{decimal(psnr, 2)} dB</strong>}
          {entry.starred && (
            <span className="chip" data-testid={`kept-${entry.id}`}>
              <Icon name="star" />
              {text.starred}
            </span>
          )}
        </span>
      </div>
      <label className="mark">
        <CheckBox
          checked={marked}
          disabled={full && !marked}
          testId={`mark-${entry.id}`}
          onChange={onMark}
        />
        <span>{text.mark}</span>
        <span className="sr-only"> {name}</span>
      </label>
    </li>
  );
}

/** Which files may show a capture, the best first: there is no rendering before it was judged. */
function picturesOf(entry: CaptureEntry): readonly string[] {
  const first = entry.images > 0 ? ["images/0000.jpg"] : [];
  return entry.metrics === null ? first : ["preview.jpg", ...first];
}

export function modeWord(mode: string): string {
  const names: Readonly<Record<string, string>> = words.mission.mode;
  return names[mode] ?? mode;
}
