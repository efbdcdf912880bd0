import { Panel } from "../design/Panel";
import type { QualitySeries } from "../state/series";
import { words } from "../text/words";
import { LossChart, PsnrChart } from "./PsnrChart";

/** How the training goes: quality and loss over its seconds. */
export function QualityPanel({ series }: { readonly series: QualitySeries }) {
  return (
    <Panel title={words.field.quality} className="quality">
      <PsnrChart series={series} />
      <LossChart series={series} />
    </Panel>
  );
}
