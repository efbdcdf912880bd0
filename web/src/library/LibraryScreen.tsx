import { useState } from "react";
import { getCaptures, type CaptureEntry } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { Asking } from "../design/Waiting";
import { ReplayPanel } from "../replay/ReplayPanel";
import { words } from "../text/words";
import { CaptureCard } from "./CaptureCard";
import { CompareBar, type Marks } from "./CompareBar";
import { Comparison } from "./Comparison";
import { readFieldKey } from "./fieldKey";
import { markName } from "./run";
import { REPLAY, RunPanel } from "./RunPanel";

/** Captures of today and of before: look at one, or lay two side by side. */
export function LibraryScreen({ captureId }: { readonly captureId: string }) {
  // A capture that begins, ends or was judged changes the list; so does another server.
  const known = useConsole(
    (state) =>
      `${state.epoch} ${state.capture?.id ?? ""} ${state.capture?.state ?? ""} ${state.findings.metrics?.at ?? ""}`,
  );
  const { value: captures, error, asking, again } = useAnswer(known, getCaptures);
  const [ids = "", view] = captureId.split("/");
  const keys = ids.split(",");
  const [marked, setMarked] = useState<readonly string[]>(() => (keys.length === 2 ? keys : []));
  const entryOf = (key: string) => captures?.find((entry) => entry.id === readFieldKey(key).capture);
  const shown = keys.flatMap((key) => entryOf(key) ?? []);
  const [first] = shown;
  const marks = {
    keys: captures === null ? marked : marked.filter((key) => entryOf(key) !== undefined),
    onMark: (key: string, mark: boolean) => {
      setMarked(mark ? [...marks.keys, key] : marks.keys.filter((each) => each !== key));
    },
    onClear: () => {
      setMarked([]);
    },
    nameOf: (key: string) => markName(key, captures ?? []),
  };
  const text = words.library;
  return (
    <>
      <div className="column">
        <Panel title={text.title} className="library" aside={captures !== null && <span>{text.count(captures.length)}</span>}>
          {captures === null && asking && <Asking />}
          {error !== null && (
            <p className="field-error" role="alert">
              {text.failed(error)}{" "}
              <button type="button" className="button button-small" onClick={again}>
                {text.again}
              </button>
            </p>
          )}
          {captures?.length === 0 && <p className="empty">{text.none}</p>}
          {captures !== null && captures.length > 0 && (
            <List captures={captures} shown={shown} marks={marks} />
          )}
        </Panel>
      </div>
      <div className="column">
        {first === undefined ? (
          <Panel title={text.look} className="run">
            <p className="empty">
              <Icon name="picture" /> {text.choose}
            </p>
          </Panel>
        ) : view === REPLAY ? (
          <ReplayPanel key={first.id} entry={first} />
        ) : shown.length === 2 && captures !== null ? (
          <Comparison key={ids} keys={keys} captures={captures} />
        ) : (
          <RunPanel key={first.id} entry={first} marks={marks} onChanged={again} />
        )}
      </div>
    </>
  );
}

interface ListProps {
  readonly captures: readonly CaptureEntry[];
  readonly shown: readonly CaptureEntry[];
  readonly marks: Marks;
}

function List({ captures, shown, marks }: ListProps) {
  return (
    <>
      <CompareBar marks={marks} testId="compare" />
      <ul className="captures" tabIndex={0} aria-label={words.library.title}>
        {captures.map((entry) => (
          <CaptureCard
            key={entry.id}
            entry={entry}
            current={shown.includes(entry)}
            marked={marks.keys.includes(entry.id)}
            full={marks.keys.length >= 2}
            onMark={(mark) => {
              marks.onMark(entry.id, mark);
            }}
          />
        ))}
      </ul>
    </>
  );
}
