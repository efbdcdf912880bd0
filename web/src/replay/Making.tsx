import { useEffect } from "react";
import { getReplayShare } from "../api/replay";
import { LONG_WORK_MS } from "../api/request";
import { useAnswer } from "../api/useAnswer";
import { TimeLeft, Waiting } from "../design/Waiting";
import { words } from "../text/words";

/** So often the console is asked how far it is. */
const EVERY_MS = 1000;

/** What is waited for while a recording is read, and how far it is. */
export function Making({ captureId }: { readonly captureId: string }) {
  const { value, asking, again } = useAnswer(captureId, async () => ({
    share: await getReplayShare(captureId),
    atS: Date.now() / 1000,
  }));
  // The next question waits for this answer, however long the line takes for it.
  useEffect(() => {
    if (asking) return;
    const timer = setTimeout(again, EVERY_MS);
    return () => {
      clearTimeout(timer);
    };
  }, [asking, again]);
  const share = value?.share ?? null;
  const text = words.replay;
  return (
    <div className="empty">
      <Waiting what={text.making} mostMs={LONG_WORK_MS} />
      {share !== null && (
        <p className="under-way">
          <progress aria-label={text.progress} value={share} max={1} />
          <TimeLeft share={share} atS={value?.atS ?? 0} />
        </p>
      )}
    </div>
  );
}
