import { coverageUrl, type CalibratedCamera, type Calibration } from "../api/calibration";
import { Icon } from "../design/Icon";
import { words } from "../text/words";
import { fileName, GOOD, missed } from "./calibrating";
import { TomlSnippet } from "./TomlSnippet";

interface CalibrationResultProps {
  readonly calibration: Calibration;
  readonly camera: CalibratedCamera;
  readonly asking: boolean;
  readonly onUse: () => void;
}

/** The camera that was found, how well it is known, and what using it would do or has done. */
export function CalibrationResult({ calibration, camera, asking, onUse }: CalibrationResultProps) {
  const text = words.setup.calibrating;
  const { applied, file, drone_id: droneId } = calibration;
  const wants = missed(camera);
  const good = wants.length === 0;
  const [sideways, upDown] = camera.tilts_deg;
  const facts = [
    [text.error, `${camera.mean_px.toFixed(2)} px`],
    [text.focal, text.focalIs(camera.fx.toFixed(1), camera.fx_sd.toFixed(1))],
    [text.distortion, camera.distortion.map((term) => term.toFixed(4)).join("  ")],
    [text.kept, text.keptOf(camera.views_kept, camera.views_dropped)],
    [text.coverage, text.percent(Math.round(100 * camera.coverage))],
    [text.tilts, text.tiltsAre(sideways.toFixed(0), upDown.toFixed(0))],
  ] as const;
  const keepsItself = applied === null ? file !== null : applied.file !== null;
  return (
    <section aria-label={text.result} data-testid="calibration-result">
      <dl className="calibration-facts">
        <div>
          <dt>{text.result}</dt>
          <dd>
            <span className={`chip chip-${good ? "good" : "busy"}`}>
              <Icon name={good ? "check" : "warning"} />
              {good ? text.good : text.poor}
            </span>
          </dd>
        </div>
        {facts.map(([word, value]) => (
          <div key={word}>
            <dt>{word}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {!good && (
        <>
          <p className="hint">{text.better}</p>
          <ul className="hint" data-testid="calibration-wants">
            {wants.map((want) => (
              <li key={want}>{text.wants[want](GOOD[want])}</li>
            ))}
          </ul>
        </>
      )}
      <figure className="coverage-picture">
        <img
          src={coverageUrl(droneId, `${camera.fx} ${camera.rms_px}`)}
          alt={text.coveragePicture}
          width={camera.width}
          height={camera.height}
        />
        <figcaption className="hint">{text.coveragePicture}</figcaption>
      </figure>
      {applied === null ? (
        <>
          <button
            type="button"
            className="button button-primary button-wide"
            data-testid="calibration-use"
            disabled={asking}
            onClick={onUse}
          >
            <Icon name="check" />
            {text.use}
          </button>
          <p className="hint">{file === null ? text.useNoFile : text.useFile(fileName(file))}</p>
        </>
      ) : (
        <p
          className={applied.problem === "" ? "calibration-done" : "field-error"}
          role="status"
          data-testid="calibration-used"
        >
          <Icon name={applied.problem === "" ? "check" : "warning"} />{" "}
          {applied.problem !== "" ? text.notWritten(applied.problem) : applied.file === null ? text.usedNoFile : text.used}{" "}
          {applied.file !== null && text.written(fileName(applied.file), fileName(applied.backup ?? ""))}
        </p>
      )}
      {!keepsItself && <TomlSnippet toml={camera.toml} name={`${droneId}-intrinsics.toml`} />}
    </section>
  );
}
