import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { words } from "../text/words";

/** On a drone's tile: it sees something else than the others, and what to do about it. */
export function DisagreementNote({ droneId }: { readonly droneId: string }) {
  const disagreement = useConsole((state) => state.disagreement);
  if (disagreement?.drone_ids.includes(droneId) !== true) return null;
  return (
    <p className="disagree-note" data-testid={`disagrees-${droneId}`} title={disagreement.reason}>
      <Icon name="warning" />
      <span>
        <strong>{words.pick.disagree}</strong> {words.pick.disagreeDo}
      </span>
    </p>
  );
}
