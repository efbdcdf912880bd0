import { useEffect } from "react";
import { Icon } from "../design/Icon";
import { words } from "../text/words";
import { KeysHelp } from "./KeysHelp";
import { screenOfKey } from "./pageKeys";
import { hashOfScreen, SCREEN_ICON, SCREENS, screenWord, type Screen } from "./screens";

/** The way from screen to screen: links, and the keys 1 to 5. */
export function Nav({ screen }: { readonly screen: Screen }) {
  useNumberKeys();
  return (
    <nav className="screens" aria-label={words.screens.label}>
      {SCREENS.map((each, index) => (
        <a
          key={each}
          href={hashOfScreen(each)}
          className="screen-link"
          aria-current={each === screen ? "page" : undefined}
          aria-keyshortcuts={String(index + 1)}
          title={words.screens.key(screenWord(each), index + 1)}
          data-testid={`screen-${each}`}
        >
          <Icon name={SCREEN_ICON[each]} />
          <span>{screenWord(each)}</span>
        </a>
      ))}
      <KeysHelp />
    </nav>
  );
}

function useNumberKeys(): void {
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      const screen = screenOfKey(event);
      if (screen !== null) location.hash = hashOfScreen(screen);
    };
    window.addEventListener("keydown", press);
    return () => {
      window.removeEventListener("keydown", press);
    };
  }, []);
}
