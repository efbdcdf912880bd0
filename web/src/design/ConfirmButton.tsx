import { useEffect, useState, type ReactNode } from "react";
import { words } from "../text/words";

interface ConfirmButtonProps {
  readonly className?: string;
  readonly disabled?: boolean;
  readonly title?: string;
  readonly testId?: string;
  readonly label: ReactNode;
  readonly confirm: ReactNode;
  /** Ask for what the question has to say, at the first press. */
  readonly onPress?: () => void;
  /** False while that is not there yet: the question waits for it. */
  readonly ready?: boolean;
  readonly onConfirm: () => void;
}

/** How long the second press is waited for. */
const PATIENCE_MS = 3000;

/** A button that acts on the second press: the first one asks, and the question fades by itself. */
export function ConfirmButton({ disabled = false, ready = true, ...props }: ConfirmButtonProps) {
  const [stage, setStage] = useState<"calm" | "pressed" | "asking">("calm");
  // Once it is asked it stays asked: what is told meanwhile changes its words alone.
  if (stage === "pressed" && ready) setStage("asking");
  useEffect(() => {
    if (stage !== "asking") return;
    const timer = setTimeout(() => {
      setStage("calm");
    }, PATIENCE_MS);
    return () => {
      clearTimeout(timer);
    };
  }, [stage]);
  const press = () => {
    if (stage === "calm") {
      setStage("pressed");
      props.onPress?.();
    } else if (stage === "asking") {
      setStage("calm");
      props.onConfirm();
    }
  };
  const asking = stage === "asking" && !disabled;
  return (
    <button
      type="button"
      className={`button ${props.className ?? ""} ${asking ? "is-asking" : ""}`}
      disabled={disabled}
      title={props.title}
      data-testid={props.testId}
      onClick={press}
      onBlur={() => {
        setStage("calm");
      }}
    >
      {asking ? props.confirm : stage === "pressed" ? words.waiting.console : props.label}
    </button>
  );
}
