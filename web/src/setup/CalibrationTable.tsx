import type { StartPlace } from "../api/setup";
import { Icon } from "../design/Icon";
import { words } from "../text/words";

interface CalibrationTableProps {
  readonly places: readonly StartPlace[];
  readonly onCalibrate: (droneId: string) => void;
}

/** The id of the button that opens the calibration of a drone's camera. */
export function calibrateButtonId(droneId: string): string {
  return `calibrate-${droneId}`;
}

/** What is known of each camera, and how to know more. */
export function CalibrationTable({ places, onCalibrate }: CalibrationTableProps) {
  const text = words.setup.calibration;
  const [first] = places.filter((place) => !place.calibrated);
  return (
    <>
      <table className="table" data-testid="calibration">
        <caption>{text.title}</caption>
        <thead>
          <tr>
            <th scope="col">{words.plan.drone}</th>
            <th scope="col">{text.camera}</th>
            <th scope="col">{text.focal}</th>
            <th scope="col">{text.tilt}</th>
          </tr>
        </thead>
        <tbody>
          {places.map((place) => (
            <tr key={place.drone_id}>
              <th scope="row" className="line-drone" style={{ "--drone": place.colour } as React.CSSProperties}>
                {place.name}
              </th>
              <td className="calibration-cell">
                <span className={`chip chip-${place.calibrated ? "good" : "calm"}`}>
                  <Icon name={place.calibrated ? "check" : "info"} />
                  {place.calibrated ? text.own : text.usual}
                </span>{" "}
                <button
                  type="button"
                  id={calibrateButtonId(place.drone_id)}
                  className="button button-small"
                  aria-label={text.calibrateOf(place.name)}
                  data-testid={calibrateButtonId(place.drone_id)}
                  onClick={() => {
                    onCalibrate(place.drone_id);
                  }}
                >
                  <Icon name="target" />
                  {text.calibrate}
                </button>
              </td>
              <td>{place.focal_px.toFixed(0)} px</td>
              <td>{place.tilt_deg.toFixed(1)}°</td>
            </tr>
          ))}
        </tbody>
      </table>
      {first !== undefined && (
        <p className="hint">
          {text.how} <code>dronerf calibrate --drone {first.drone_id} --fleet fleet.toml --out fleet.toml</code>
        </p>
      )}
    </>
  );
}
