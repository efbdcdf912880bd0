import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { words } from "../text/words";
import { LossChart, PsnrChart } from "./PsnrChart";

/** How the training goes: quality and loss over its seconds. */
export function QualityPanel() {
  const series = useConsole((state) => state.findings.quality);
  return (
    <Panel title={words.field.quality} className="quality">
      <PsnrChart series={series} />
      <LossChart series={series} />
    </Panel>
  );
}
