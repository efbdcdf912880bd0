import { useEffect, useState, type ReactNode } from "react";

interface ConfirmButtonProps {
  readonly className?: string;
  readonly disabled?: boolean;
  readonly title?: string;
  readonly testId?: string;
  readonly label: ReactNode;
  readonly confirm: ReactNode;
  readonly onConfirm: () => void;
}

/** How long the second press is waited for. */
const PATIENCE_MS = 3000;

/** A button that acts on the second press: the first one asks, and the question fades by itself. */
export function ConfirmButton(props: ConfirmButtonProps) {
  const [asking, setAsking] = useState(false);
  useEffect(() => {
    if (!asking) return;
    const timer = setTimeout(() => {
      setAsking(false);
    }, PATIENCE_MS);
    return () => {
      clearTimeout(timer);
    };
  }, [asking]);
  const press = () => {
    setAsking(!asking);
    if (asking) props.onConfirm();
  };
  return (
    <button
      type="button"
      className={`button ${props.className ?? ""} ${asking ? "is-asking" : ""}`}
      disabled={props.disabled}
      title={props.title}
      data-testid={props.testId}
      onClick={press}
      onBlur={() => {
        setAsking(false);
      }}
    >
      {asking ? props.confirm : props.label}
    </button>
  );
}
