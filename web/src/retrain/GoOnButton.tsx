import { useOperator } from "../context";
import { Icon } from "../design/Icon";
import { words } from "../text/words";

interface GoOnButtonProps {
  readonly captureId: string;
  readonly onChanged?: () => void;
}

/** Goes on with a training that was cut off. */
export function GoOnButton({ captureId, onChanged }: GoOnButtonProps) {
  const operator = useOperator();
  return (
    <button
      type="button"
      className="button"
      data-testid="resume-capture"
      title={words.library.resumeHint}
      onClick={() => {
        void operator.changeCapture(captureId, "resume").then((done) => {
          if (done) onChanged?.();
        });
      }}
    >
      <Icon name="play" />
      {words.library.resume}
    </button>
  );
}
