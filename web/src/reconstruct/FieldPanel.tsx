import { useConsole } from "../context";
import { clock, count, decimal } from "../design/format";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import type { MetricsReport, TrainingReport } from "../protocol/messages.gen";
import { words } from "../text/words";
import { CourseLine } from "./CourseLine";
import { PreviewPicture } from "./PreviewPicture";
import { TrainingControls } from "./TrainingControls";

/** The field as it grows, `training` being its last report: newest rendering, training figures, quality. */
export function FieldPanel({ training }: { readonly training: TrainingReport | null }) {
  const { preview, metrics } = useConsole((state) => state.findings);
  return (
    <Panel
      title={words.field.title}
      className="field"
      aside={training !== null && <span className="chip chip-calm">{stageWord(training.stage)}</span>}
    >
      <CourseLine />
      <div className="field-grid">
        <figure className="preview">
          {preview === null ? (
            <div className="preview-empty" data-testid="preview" data-at="">
              <Icon name="cube" />
              <figcaption>{words.field.noPreview}</figcaption>
            </div>
          ) : (
            <PreviewPicture preview={preview} />
          )}
        </figure>
        <div className="field-figures">
          <Figures training={training} />
          <Metrics metrics={metrics} />
        </div>
      </div>
      <TrainingControls />
    </Panel>
  );
}

function stageWord(stage: string): string {
  const names: Readonly<Record<string, string>> = words.field.stage;
  return names[stage] ?? stage;
}

function stageTime(training: TrainingReport): string {
  const { seconds, seconds_total: total } = training;
  return total === null ? clock(seconds) : words.field.of(clock(seconds), clock(total));
}

function Figures({ training }: { readonly training: TrainingReport | null }) {
  const text = words.field;
  const rows: readonly (readonly [string, string])[] = [
    [text.time, training === null ? words.none : stageTime(training)],
    [text.samples, training === null ? words.none : count(training.samples_per_s)],
    [text.step, training === null ? words.none : count(training.step)],
    [text.loss, training?.loss?.toPrecision(3) ?? words.none],
    [text.images, training === null ? words.none : String(training.images)],
  ];
  return (
    <dl className="figures">
      {rows.map(([word, value]) => (
        <div key={word}>
          <dt>{word}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

function Metrics({ metrics }: { readonly metrics: MetricsReport | null }) {
  const text = words.field;
  return (
    <table className="metrics" data-testid="metrics">
      <caption>
        {text.metrics}
        {metrics !== null && (
          <small>{text.measuredOn(metrics.images_held_out, metrics.images)}</small>
        )}
      </caption>
      <tbody>
        <Metric word={text.psnr} value={decimal(metrics?.psnr_db, 2)} unit="dB" />
        <Metric word={text.psnrObject} value={decimal(metrics?.psnr_db_object, 2)} unit="dB" />
        <Metric word={text.ssim} value={decimal(metrics?.ssim, 3)} unit="" />
        <Metric word={text.flip} value={decimal(metrics?.flip, 3)} unit="" />
      </tbody>
    </table>
  );
}

function Metric(props: { readonly word: string; readonly value: string; readonly unit: string }) {
  return (
    <tr>
      <th scope="row">{props.word}</th>
      <td>
        {props.value}
        {props.unit !== "" && props.value !== words.none && <small> {props.unit}</small>}
      </td>
    </tr>
  );
}
