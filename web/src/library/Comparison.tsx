import type { CaptureEntry } from "../api/library";
import { getTrainings } from "../api/trainings";
import { useAnswer } from "../api/useAnswer";
import { Panel } from "../design/Panel";
import { Asking } from "../design/Waiting";
import { hashOfScreen } from "../shell/screens";
import { words } from "../text/words";
import { ComparePanel } from "./ComparePanel";
import { readFieldKey } from "./fieldKey";
import { fieldName, type Field } from "./run";

interface ComparisonProps {
  /** Two keys of fields of these captures. */
  readonly keys: readonly string[];
  readonly captures: readonly CaptureEntry[];
}

/** Finds the two fields of an address and lays them side by side. */
export function Comparison({ keys, captures }: ComparisonProps) {
  const { value: fields, error, asking } = useAnswer(keys.join(), () => Promise.all(keys.map((key) => find(key, captures))));
  const [a = null, b = null] = fields ?? [];
  if (a !== null && b !== null) return <ComparePanel a={a} b={b} />;
  const { library: text } = words;
  const back = hashOfScreen("library", readFieldKey(keys[0] ?? "").capture);
  return (
    <Panel title={text.compareTitle} className="compare" aside={<a href={back}>{text.back}</a>}>
      {fields === null && asking && <Asking />}
      {error !== null && <p className="field-error">{text.failed(error)}</p>}
      {fields !== null && <p className="empty">{text.fieldGone}</p>}
    </Panel>
  );
}

/** The field that a key names; null where it is gone. @throws RequestError */
async function find(key: string, captures: readonly CaptureEntry[]): Promise<Field | null> {
  const named = readFieldKey(key);
  const entry = captures.find(({ id }) => id === named.capture);
  if (entry === undefined) return null;
  if (named.training === null) return { id: entry.id, name: fieldName(entry, null), entry, training: null };
  const training = (await getTrainings(entry.id)).find(({ id }) => id === named.training);
  return training === undefined ? null : { id: training.id, name: fieldName(entry, training), entry, training };
}
