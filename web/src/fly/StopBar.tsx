import { useEffect, useRef, useState, type ReactNode } from "react";
import type { Stop } from "../api/stops";
import { useOperator } from "../context";
import { Icon } from "../design/Icon";
import { words } from "../text/words";
import { listenForHold } from "./holdKey";
import { useHoldToConfirm } from "./useHoldToConfirm";

type Outcome = "idle" | "sending" | "accepted" | "failed";

/** How long a button says that its stop was accepted. */
const THANKS_MS = 2500;

/** Send a stop and know how it went; presses while one is under way send another one. */
function useStop(stop: Stop): readonly [Outcome, () => void] {
  const operator = useOperator();
  const [outcome, setOutcome] = useState<Outcome>("idle");
  const latest = useRef(0);
  const send = () => {
    const mine = ++latest.current;
    setOutcome("sending");
    void operator.stop(stop).then((accepted) => {
      if (mine === latest.current) setOutcome(accepted ? "accepted" : "failed");
    });
  };
  useEffect(() => {
    if (outcome !== "accepted") return;
    const timer = setTimeout(() => {
      setOutcome("idle");
    }, THANKS_MS);
    return () => {
      clearTimeout(timer);
    };
  }, [outcome]);
  return [outcome, send];
}

function Face(props: {
  readonly icon: "hold" | "land" | "cut";
  readonly word: string;
  readonly does: string;
  readonly outcome: Outcome;
  readonly children?: ReactNode;
}) {
  const news = { idle: props.does, sending: words.stop.sending, accepted: words.stop.accepted, failed: props.does };
  return (
    <>
      <Icon name={props.outcome === "accepted" ? "check" : props.icon} />
      <span className="stop-words">
        <span className="stop-word">{props.word}</span>
        <span className="stop-does">{news[props.outcome]}</span>
      </span>
      {props.children}
    </>
  );
}

/** HOLD, LAND and CUT MOTORS: above everything, whatever else the page is doing. */
export function StopBar() {
  const [held, hold] = useStop("hold");
  const [landed, land] = useStop("land");
  const [wasCut, cut] = useStop("cut_motors");
  const press = useHoldToConfirm(cut);

  const holdNow = useRef(hold);
  useEffect(() => {
    holdNow.current = hold;
  });
  useEffect(
    () =>
      listenForHold(window, () => {
        holdNow.current();
      }),
    [],
  );

  return (
    <div className="stop-bar" role="group" aria-label={words.stop.group}>
      <button type="button" className="stop stop-hold" data-testid="hold" data-outcome={held} onClick={hold}>
        <Face icon="hold" word={words.stop.hold.word} does={words.stop.hold.does} outcome={held}>
          <kbd>{words.stop.hold.key}</kbd>
        </Face>
      </button>
      <button type="button" className="stop stop-land" data-testid="land" data-outcome={landed} onClick={land}>
        <Face icon="land" word={words.stop.land.word} does={words.stop.land.does} outcome={landed} />
      </button>
      <button
        type="button"
        className={`stop stop-cut ${press.pressing ? "is-pressing" : ""}`}
        data-testid="cut"
        data-outcome={wasCut}
        aria-label={words.stop.cut.label}
        {...press.handlers}
      >
        <Face
          icon="cut"
          word={words.stop.cut.word}
          does={press.pressing ? words.stop.cut.holding : words.stop.cut.does}
          outcome={press.pressing ? "idle" : wasCut}
        />
      </button>
      <span className="sr-only" role="status" data-testid="cut-announcement">
        {words.stop.cut.announce[press.press]}
      </span>
    </div>
  );
}
