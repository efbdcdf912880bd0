import { useEffect, useRef } from "react";
import { takesText, type KeyTarget } from "../fly/holdKey";
import { words } from "../text/words";

/** What the keyboard does everywhere; the key ? shows and hides it. It never lies over the stops. */
export function KeysHelp() {
  const sheet = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      if (event.key !== "?" || takesText(event.target as KeyTarget | null)) return;
      sheet.current?.togglePopover();
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
