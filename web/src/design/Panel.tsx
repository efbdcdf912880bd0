import { useId, type ReactNode } from "react";

interface PanelProps {
  readonly title: string;
  readonly className?: string;
  /** Stands at the right end of the title line. */
  readonly aside?: ReactNode;
  readonly children: ReactNode;
}

/** One titled area of the console. */
export function Panel({ title, className = "", aside, children }: PanelProps) {
  const id = useId();
  return (
    <section className={`panel ${className}`} aria-labelledby={id}>
      <header className="panel-head">
        <h2 id={id}>{title}</h2>
        {aside !== undefined && <div className="panel-aside">{aside}</div>}
      </header>
      {children}
    </section>
  );
}
