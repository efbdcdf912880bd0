import { useSyncExternalStore } from "react";
import type { IconName } from "../design/Icon";
import { words } from "../text/words";

/** The console's screens in their order; the number keys go to them. */
export const SCREENS = ["fly", "plan", "reconstruct", "library", "setup"] as const;

export type Screen = (typeof SCREENS)[number];

export const SCREEN_ICON: Readonly<Record<Screen, IconName>> = {
  fly: "fly",
  plan: "target",
  reconstruct: "cube",
  library: "picture",
  setup: "gear",
};

/** The screen of an address's hash, and what it shows there; an unknown one is where one flies. */
export function screenOfHash(hash: string): { readonly screen: Screen; readonly rest: string } {
  const [name = "", ...rest] = hash.replace(/^#\/?/, "").split("/");
  const known = SCREENS.find((screen) => screen === name);
  return known === undefined
    ? { screen: "fly", rest: "" }
    : { screen: known, rest: decodeURIComponent(rest.join("/")) };
}

export function hashOfScreen(screen: Screen, rest = ""): string {
  return rest === "" ? `#/${screen}` : `#/${screen}/${encodeURIComponent(rest)}`;
}

function subscribe(changed: () => void): () => void {
  window.addEventListener("hashchange", changed);
  return () => {
    window.removeEventListener("hashchange", changed);
  };
}

/** The address's hash, kept up to date. */
export function useHash(): string {
  return useSyncExternalStore(subscribe, () => location.hash);
}

export function screenWord(screen: Screen): string {
  return words.screens[screen];
}
