import { useEffect } from "react";
import { clientId } from "../api/tabId";
import { useConsole, useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { Icon } from "../design/Icon";
import { anyFlying } from "../fly/activity";
import { fliesByItself } from "../state/state";
import { words } from "../text/words";

/** Who is in command: this tab, another browser, or nobody, of which nothing is said. */
export function CommandPill() {
  const inCommand = useConsole((state) => state.inCommand);
  const holder = useConsole((state) => state.command.holder);
  useWarnBeforeLeaving(inCommand);
  if (inCommand) return <InCommand />;
  return holder === null ? null : <Watching />;
}

/** This tab flies, and the operator may take leave. */
function InCommand() {
  const operator = useOperator();
  const text = words.command;
  return (
    <div className="command" role="group" aria-label={text.group} data-testid="in-command">
      <span className="command-word" role="status">
        <Icon name="hand" />
        {text.word}
      </span>
      <ConfirmButton
        className="button-small"
        title={text.leaveDoes}
        testId="leave-unattended"
        label={text.leave}
        confirm={text.leaveConfirm}
        onConfirm={() => {
          operator.leaveUnattended();
        }}
      />
    </div>
  );
}

/** Another browser flies: this one watches, and may ask for the command or take it. */
function Watching() {
  const operator = useOperator();
  const asked = useConsole((state) => state.command.asking === clientId);
  const text = words.command;
  return (
    <div className="command is-watching" role="group" aria-label={text.group} data-testid="watching">
      <span className="command-word" role="status">
        <Icon name="info" />
        {asked ? text.asked : text.watching}
      </span>
      {!asked && (
        <button
          type="button"
          className="button button-small"
          data-testid="ask-command"
          onClick={() => {
            operator.askCommand();
          }}
        >
          {text.ask}
        </button>
      )}
      <ConfirmButton
        className="button-small"
        title={text.takeDoes}
        testId="take-command"
        label={text.take}
        confirm={text.takeConfirm}
        onConfirm={() => {
          operator.takeCommand();
        }}
      />
    </div>
  );
}

/** Below the stops of who is in command: another browser asks for it. */
export function AskingBand() {
  const operator = useOperator();
  const asks = useConsole((state) => state.inCommand && state.command.asking !== null);
  if (!asks) return null;
  const text = words.command;
  return (
    <div className="band band-held" role="alert" data-testid="asking">
      <Icon name="hand" />
      <span className="band-text">{text.asks}</span>
      <button
        type="button"
        className="button"
        data-testid="hand-over"
        onClick={() => {
          operator.answerCommand(true);
        }}
      >
        {text.handOver}
      </button>
      <button
        type="button"
        className="button"
        onClick={() => {
          operator.answerCommand(false);
        }}
      >
        {text.keep}
      </button>
    </div>
  );
}

/** Have the browser ask before a tab in command is closed under flying drones. */
function useWarnBeforeLeaving(inCommand: boolean): void {
  const flying = useConsole((state) => anyFlying(state.drones) || fliesByItself(state.capture));
  useEffect(() => {
    if (!inCommand || !flying) return;
    const ask = (event: BeforeUnloadEvent) => {
      event.preventDefault();
    };
    window.addEventListener("beforeunload", ask);
    return () => {
      window.removeEventListener("beforeunload", ask);
    };
  }, [inCommand, flying]);
}
