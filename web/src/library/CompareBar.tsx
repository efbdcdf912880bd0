import { hashOfScreen } from "../shell/screens";
import { words } from "../text/words";

interface CompareBarProps {
  /** The keys of the fields that are marked. */
  readonly pair: readonly string[];
  readonly testId: string;
}

/** How many are marked, and once there are two the way to their comparison. */
export function CompareBar({ pair, testId }: CompareBarProps) {
  return (
    <p className="compare-bar">
      <span>{words.library.marked(pair.length)}</span>
      {pair.length === 2 && (
        <a
          className="button button-small button-primary"
          data-testid={testId}
          href={hashOfScreen("library", pair.join(","))}
        >
          {words.library.compare}
        </a>
      )}
    </p>
  );
}
