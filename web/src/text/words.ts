import { de } from "./de";
import { en } from "./en";

/** The shape of a catalogue: what the English one holds, with any words in it. */
type Words<T> = T extends string
  ? string
  : T extends (...values: infer V) => infer R
    ? (...values: V) => Words<R>
    : T extends readonly (infer U)[]
      ? readonly Words<U>[]
      : { readonly [K in keyof T]: Words<T[K]> };

export type Catalogue = Words<typeof en>;

export const LANGUAGES = { en: "English", de: "Deutsch" } as const;
export type Language = keyof typeof LANGUAGES;

const CATALOGUES: Readonly<Record<Language, Catalogue>> = { en, de };
const KEY = "dronerf.language";

/** The language that was chosen here, else the first of the browser's that there is. */
export function chooseLanguage(chosen: string | null, wanted: readonly string[]): Language {
  const isOurs = (code: string): code is Language => Object.hasOwn(LANGUAGES, code);
  if (chosen !== null && isOurs(chosen)) return chosen;
  return wanted.map((tag) => tag.slice(0, 2).toLowerCase()).find(isOurs) ?? "en";
}

function remembered(): string | null {
  try {
    return globalThis.localStorage.getItem(KEY);
  } catch {
    return null; // A browser that keeps nothing, or no browser at all.
  }
}

const here = "document" in globalThis;
export const language: Language = chooseLanguage(
  here ? remembered() : "en",
  here ? navigator.languages : [],
);

/** Every word of the page. Chosen once: another language comes with the next load. */
export const words: Catalogue = CATALOGUES[language];

/** Remember another language and load the page anew in it. */
export function changeLanguage(next: Language): void {
  try {
    localStorage.setItem(KEY, next);
  } catch {
    return;
  }
  location.reload();
}
