import { useEffect, useRef } from "react";
import type { ReplayMoment } from "../api/replay";
import { clock } from "../design/format";
import { Icon } from "../design/Icon";
import { words } from "../text/words";
import { lastMoment } from "./flightCourse";
import type { Face } from "./ReplayMap";

interface MomentListProps {
  readonly moments: readonly ReplayMoment[];
  readonly faces: readonly Face[];
  readonly atS: number;
  readonly onChoose: (atS: number) => void;
}

/** What happened; a press goes there. */
export function MomentList({ moments, faces, atS, onChoose }: MomentListProps) {
  const now = lastMoment(moments, atS);
  const list = useRef<HTMLOListElement>(null);
  useEffect(() => {
    const line = list.current?.children[now];
    if (!(line instanceof HTMLElement) || list.current === null) return;
    // The list alone scrolls, not the page around it.
    const { offsetTop, offsetHeight } = line;
    const { scrollTop, clientHeight } = list.current;
    if (offsetTop < scrollTop || offsetTop + offsetHeight > scrollTop + clientHeight) {
      list.current.scrollTop = offsetTop - clientHeight / 2;
    }
  }, [now]);
  return (
    <ol ref={list} className="moments" aria-label={words.log.title}>
      {moments.map((moment, index) => {
        const face = faces.find(({ drone }) => drone.drone_id === moment.drone_id);
        return (
          <li key={index}>
            <button
              type="button"
              className={`moment is-${moment.kind}`}
              aria-current={index === now ? "time" : undefined}
              onClick={() => {
                onChoose(moment.at_s);
              }}
            >
              <span className="moment-time">{clock(moment.at_s)}</span>
              <Icon name={moment.kind} />
              <span>
                {face !== undefined && (
                  <span className="line-drone" style={{ "--drone": face.colour } as React.CSSProperties}>
                    {face.name}
                  </span>
                )}
                {moment.kind === "picture" ? words.library.taken(Number(moment.text)) : moment.text}
              </span>
            </button>
          </li>
        );
      })}
    </ol>
  );
}
