import { useEffect, useRef } from "react";
import { words } from "../text/words";
import { asksForKeys } from "./pageKeys";

/** What the keyboard does everywhere; the key ? shows and hides it. It never lies over the stops. */
export function KeysHelp() {
  const sheet = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      if (asksForKeys(event)) sheet.current?.togglePopover();
    };
    window.addEventListener("keydown", press);
    return () => {
      window.removeEventListener("keydown", press);
    };
  }, []);
  const text = words.keys;
  return (
    <>
      <button type="button" className="keys-button" popoverTarget="keys" aria-keyshortcuts="?" data-testid="keys">
        <kbd>?</kbd> <span>{text.title}</span>
      </button>
      <div ref={sheet} id="keys" className="keys" popover="auto" aria-label={text.title}>
        <dl>
          {text.list.map(([key, does]) => (
            <div key={key}>
              <dt>
                <kbd>{key}</kbd>
              </dt>
              <dd>{does}</dd>
            </div>
          ))}
        </dl>
      </div>
    </>
  );
}
