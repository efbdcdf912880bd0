import type { ReactNode } from "react";
import { words } from "../text/words";
import { TrainingForm } from "./TrainingForm";

interface TrainAnewSectionProps {
  readonly captureId: string;
  readonly onStarted: () => void;
  readonly children?: ReactNode;
}

/** What training anew is, the form for it, and what else belongs to it. */
export function TrainAnewSection({ captureId, onStarted, children }: TrainAnewSectionProps) {
  const text = words.retrain;
  return (
    <section className="retrain" aria-label={text.title}>
      <h3>{text.title}</h3>
      <p className="hint">{text.hint}</p>
      <TrainingForm captureId={captureId} onStarted={onStarted} />
      {children}
    </section>
  );
}
