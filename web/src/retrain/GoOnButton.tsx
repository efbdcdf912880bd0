import { useOperator } from "../context";
import { Icon } from "../design/Icon";
import { useUnderWay } from "../design/useUnderWay";
import { Waiting } from "../design/Waiting";
import { words } from "../text/words";

interface GoOnButtonProps {
  readonly captureId: string;
  readonly onChanged?: () => void;
}

/** Goes on with a training that was cut off. */
export function GoOnButton({ captureId, onChanged }: GoOnButtonProps) {
  const operator = useOperator();
  const [asking, follow] = useUnderWay();
  return (
    <>
      <button
        type="button"
        className="button"
        data-testid="resume-capture"
        title={words.library.resumeHint}
        disabled={asking}
        onClick={() => {
          const done = operator.changeCapture(captureId, "resume").then((accepted) => {
            if (accepted) onChanged?.();
          });
          follow(done);
        }}
      >
        <Icon name="play" />
        {words.library.resume}
      </button>
      {asking && <Waiting quiet what={words.retrain.begins} />}
    </>
  );
}
