import { useEffect, useRef, useState } from "react";
import { useConsole } from "../context";
import { CheckBox } from "../design/CheckBox";
import { timeOfDay } from "../design/format";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import type { LogLine } from "../state/state";
import { words } from "../text/words";

/** Which lines are shown: this level and the graver ones. */
type Filter = LogLine["level"];

const GRAVITY: Readonly<Record<Filter, number>> = { info: 0, warning: 1, error: 2 };
const FILTERS: readonly { readonly filter: Filter; readonly word: string }[] = [
  { filter: "info", word: words.log.all },
  { filter: "warning", word: words.log.level.warning },
  { filter: "error", word: words.log.level.error },
];
/** This near to the end counts as being there, pixels. */
const NEAR_END_PX = 24;

/** What happened, oldest first; follows the newest line until the reader scrolls up. */
export function EventLog() {
  const log = useConsole((state) => state.log);
  const [filter, setFilter] = useState<Filter>("info");
  const [follow, setFollow] = useState(true);
  const list = useRef<HTMLDivElement>(null);
  const lastTop = useRef(0);
  const lines = log.filter((line) => GRAVITY[line.level] >= GRAVITY[filter]);
  // Older lines may come in between.
  const newest = `${lines.length} ${lines.at(-1)?.id ?? ""}`;

  useEffect(() => {
    if (follow && list.current !== null) list.current.scrollTop = list.current.scrollHeight;
  }, [follow, newest]);

  // The list also loses its end when the panel above it grows.
  useEffect(() => {
    const element = list.current;
    if (!follow || element === null) return;
    const watcher = new ResizeObserver(() => {
      element.scrollTop = element.scrollHeight;
    });
    watcher.observe(element);
    return () => {
      watcher.disconnect();
    };
  }, [follow]);

  const scrolled = () => {
    const element = list.current;
    if (element === null) return;
    const { scrollTop, scrollHeight, clientHeight } = element;
    // Only a reader scrolls up; new lines and the following itself move the other way.
    if (scrollHeight - scrollTop - clientHeight < NEAR_END_PX) setFollow(true);
    else if (scrollTop < lastTop.current) setFollow(false);
    lastTop.current = scrollTop;
  };

  return (
    <Panel
      title={words.log.title}
      className="log"
      aside={
        <>
          <div className="segments" role="group" aria-label={words.log.filter}>
            {FILTERS.map((each) => (
              <button
                key={each.filter}
                type="button"
                aria-pressed={filter === each.filter}
                onClick={() => {
                  setFilter(each.filter);
                }}
              >
                {each.word}
              </button>
            ))}
          </div>
          <label className="follow">
            <CheckBox checked={follow} onChange={setFollow} />
            {words.log.follow}
          </label>
        </>
      }
    >
      <div
        ref={list}
        className="lines"
        role="log"
        aria-label={words.log.title}
        tabIndex={0}
        onScroll={scrolled}
      >
        {lines.length === 0 && (
          <p className="empty">{log.length === 0 ? words.log.empty : words.log.nothing}</p>
        )}
        {/* A log's role would take the list its own, so the list stands inside. */}
        <ol>
          {lines.map((line) => (
            <Line key={line.id} line={line} />
          ))}
        </ol>
      </div>
    </Panel>
  );
}

function Line({ line }: { readonly line: LogLine }) {
  const drone = useConsole((state) =>
    line.droneId === null ? undefined : state.drones.get(line.droneId)?.report,
  );
  return (
    <li className={`line is-${line.level}`}>
      <time dateTime={line.at}>{timeOfDay(line.at)}</time>
      <span className="line-level">
        <Icon name={line.level} />
        {words.log.level[line.level]}
      </span>
      <span className="line-text">
        {drone !== undefined && (
          <span className="line-drone" style={{ "--drone": drone.colour } as React.CSSProperties}>
            {drone.name}
          </span>
        )}
        {line.text}
      </span>
    </li>
  );
}
