import { Icon } from "../design/Icon";
import { hashOfScreen } from "../shell/screens";
import { words } from "../text/words";
import { readFieldKey } from "./fieldKey";

/** The fields marked for a comparison, by their keys, and how that is changed. */
export interface Marks {
  readonly keys: readonly string[];
  readonly onMark: (key: string, mark: boolean) => void;
  readonly onClear: () => void;
  readonly nameOf: (key: string) => string;
}

interface CompareBarProps {
  readonly marks: Marks;
  readonly testId: string;
}

/** What is marked, how to take that back, and once there are two the way to their comparison. */
export function CompareBar({ marks, testId }: CompareBarProps) {
  const { keys } = marks;
  const text = words.library;
  return (
    <div className="compare-bar">
      <span>{text.marked(keys.length)}</span>
      {keys.length > 0 && (
        <button
          type="button"
          className="button button-small button-quiet"
          data-testid={`${testId}-clear`}
          onClick={marks.onClear}
        >
          <Icon name="close" />
          {text.clear}
        </button>
      )}
      {keys.length === 2 && (
        <a
          className="button button-small button-primary"
          data-testid={testId}
          href={hashOfScreen("library", keys.join(","))}
        >
          {text.compare}
        </a>
      )}
      {keys.length > 0 && (
        <ul>
          {keys.map((key) => (
            <li key={key}>
              <a href={hashOfScreen("library", readFieldKey(key).capture)}>{marks.nameOf(key)}</a>
            </li>
          ))}
        </ul>
      )}
    </div>
  );
}
