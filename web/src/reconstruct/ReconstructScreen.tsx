import { FieldPanel } from "./FieldPanel";
import { JudgedPanel } from "./JudgedPanel";
import { PicturesPanel } from "./PicturesPanel";
import { QualityPanel } from "./QualityPanel";
import { useCourse } from "./useCourse";

/** From pictures to the field: what it looks like, how good it is, what it is made from. */
export function ReconstructScreen() {
  const { series, last } = useCourse();
  return (
    <>
      <div className="column">
        <FieldPanel training={last} />
      </div>
      <div className="column">
        <QualityPanel series={series} />
        <JudgedPanel />
      </div>
      <div className="column">
        <PicturesPanel />
      </div>
    </>
  );
}
