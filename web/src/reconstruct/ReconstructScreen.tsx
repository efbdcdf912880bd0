import { FieldPanel } from "./FieldPanel";
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
      </div>
      <div className="column">
        <PicturesPanel />
      </div>
    </>
  );
}
