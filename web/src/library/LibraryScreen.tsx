import { useState } from "react";
import { getCaptures, type CaptureEntry } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { Asking } from "../design/Waiting";
import { hashOfScreen } from "../shell/screens";
import { ReplayPanel } from "../replay/ReplayPanel";
import { words } from "../text/words";
import { CaptureCard } from "./CaptureCard";
import { ComparePanel } from "./ComparePanel";
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
  const shown = ids.split(",").flatMap((id) => captures?.find((entry) => entry.id === id) ?? []);
  const [first, second] = shown;
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
          {captures !== null && captures.length > 0 && <List captures={captures} shown={shown} />}
        </Panel>
      </div>
      <div className="column column-run">
        {first === undefined ? (
          <Panel title={text.look} className="run">
            <p className="empty">
              <Icon name="picture" /> {text.choose}
            </p>
          </Panel>
        ) : view === REPLAY ? (
          <ReplayPanel key={first.id} entry={first} />
        ) : second === undefined ? (
          <RunPanel key={first.id} entry={first} onChanged={again} />
        ) : (
          <ComparePanel key={`${first.id} ${second.id}`} a={first} b={second} />
        )}
      </div>
    </>
  );
}

function List({ captures, shown }: { readonly captures: readonly CaptureEntry[]; readonly shown: readonly CaptureEntry[] }) {
  const [marked, setMarked] = useState<readonly string[]>(() =>
    shown.length === 2 ? shown.map((entry) => entry.id) : [],
  );
  const pair = marked.filter((id) => captures.some((entry) => entry.id === id));
  const [a, b] = pair;
  return (
    <>
      <p className="compare-bar">
        <span>{words.library.marked(pair.length)}</span>
        {a !== undefined && b !== undefined && (
          <a
            className="button button-small button-primary"
            data-testid="compare"
            href={hashOfScreen("library", `${a},${b}`)}
          >
            {words.library.compare}
          </a>
        )}
      </p>
      <ul className="captures" tabIndex={0} aria-label={words.library.title}>
        {captures.map((entry) => (
          <CaptureCard
            key={entry.id}
            entry={entry}
            current={shown.includes(entry)}
            marked={pair.includes(entry.id)}
            full={pair.length >= 2}
            onMark={(mark) => {
              setMarked(mark ? [...pair, entry.id] : pair.filter((id) => id !== entry.id));
            }}
          />
        ))}
      </ul>
    </>
  );
}
