import { useEffect } from "react";
import { useConsole, useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { Icon } from "../design/Icon";
import { anyFlying } from "../fly/activity";
import { fliesByItself } from "../state/state";
import { en } from "../text/en";

/** Says that this tab is in command, and lets the operator take leave. Nothing for who watches. */
export function CommandPill() {
  const operator = useOperator();
  const inCommand = useConsole((state) => state.inCommand);
  useWarnBeforeLeaving(inCommand);
  if (!inCommand) return null;
  const text = en.command;
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
