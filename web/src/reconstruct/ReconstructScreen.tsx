import { FieldPanel } from "./FieldPanel";
import { JudgedPanel } from "./JudgedPanel";
import { PicturesPanel } from "./PicturesPanel";
import { QualityPanel } from "./QualityPanel";

/** From pictures to the field: what it looks like, how good it is, what it is made from. */
export function ReconstructScreen() {
  return (
    <>
      <div className="column">
        <FieldPanel />
      </div>
      <div className="column">
        <QualityPanel />
        <JudgedPanel />
      </div>
      <div className="column">
        <PicturesPanel />
      </div>
    </>
  );
}
