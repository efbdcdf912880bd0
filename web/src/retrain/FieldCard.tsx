import type { ReactNode } from "react";
import type { Artifact, RunMetrics } from "../api/library";
import { CheckBox } from "../design/CheckBox";
import { decimal, withUnit } from "../design/format";
import { Icon } from "../design/Icon";
import { RunPicture } from "../library/RunPicture";
import { words } from "../text/words";

/** What a field leaves in its run folder for people. */
const RESULTS = ["preview.jpg", "orbit.mp4", "mesh.glb", "metrics.json"];

/** How a field is chosen for a comparison. */
export interface Marking {
  readonly marked: boolean;
  /** True when two are marked already. */
  readonly full: boolean;
  readonly onMark: (mark: boolean) => void;
}

interface FieldCardProps {
  readonly runId: string;
  readonly title: string;
  readonly files: readonly Artifact[];
  readonly settings: readonly string[];
  readonly metrics: RunMetrics | null;
  readonly marking?: Marking | undefined;
  readonly testId: string;
  readonly children?: ReactNode;
}

/** A field of a capture: its rendering, settings, figures and what it left. */
export function FieldCard({ runId, title, files, settings, metrics, marking, testId, children }: FieldCardProps) {
  const there = new Map(files.map((file) => [file.path, file]));
  const results = RESULTS.flatMap((path) => there.get(path) ?? []);
  return (
    <li className="field-card" data-testid={testId} data-run={runId}>
      <RunPicture
        key={String(there.has("preview.jpg"))}
        captureId={runId}
        files={there.has("preview.jpg") ? ["preview.jpg"] : []}
        alt=""
      />
      <div className="field-words">
        <strong>{title}</strong>
        {settings.length > 0 && <span className="capture-when">{settings.join(", ")}</span>}
        {metrics !== null && <Figures metrics={metrics} />}
        {results.length > 0 && (
          <span className="field-files">
            {results.map((file) => (
              <a key={file.path} href={file.url} download={file.path}>
                <Icon name="download" />
                {file.path}
                <span className="sr-only">, {title}</span>
              </a>
            ))}
          </span>
        )}
        {children}
      </div>
      {marking !== undefined && (
        <label className="mark">
          <CheckBox
            checked={marking.marked}
            disabled={marking.full && !marking.marked}
            testId={`mark-field-${runId}`}
            onChange={marking.onMark}
          />
          <span>{words.library.mark}</span>
          <span className="sr-only"> {title}</span>
        </label>
      )}
    </li>
  );
}

function Figures({ metrics }: { readonly metrics: RunMetrics }) {
  const { psnr, psnrObject, ssim } = words.field;
  return (
    <span className="capture-line">
      <span>
        {psnr} <strong>{withUnit(metrics.psnr_db ?? null, 2, "dB")}</strong>
      </span>
      <span>
        {psnrObject} <strong>{withUnit(metrics.psnr_db_object ?? null, 2, "dB")}</strong>
      </span>
      <span>
        {ssim} <strong>{decimal(metrics.ssim, 3)}</strong>
      </span>
    </span>
  );
}

/** What was asked of a training, as far as it is known. */
export function settingWords(seconds: number | null, seed: number | null, objectOnly: boolean): readonly string[] {
  const text = words.retrain;
  return [
    ...(seconds === null ? [] : [text.lasting(seconds)]),
    ...(seed === null ? [] : [text.seeded(seed)]),
    ...(objectOnly ? [words.library.part(true)] : []),
  ];
}
