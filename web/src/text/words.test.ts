import { describe, expect, it } from "vitest";
import { de } from "./de";
import { en } from "./en";
import { chooseLanguage } from "./words";

/** Every word of a catalogue by its path; words that depend on values are called with some. */
function flat(words: unknown, path = ""): [string, string][] {
  if (typeof words === "string") return [[path, words]];
  if (typeof words === "function") {
    const { length } = words;
    const call = words as (...values: unknown[]) => unknown;
    return flat(call(...Array.from({ length }, (_, index) => index + 2)), path);
  }
  return Object.entries(words as object).flatMap(([key, each]) => flat(each, `${path}.${key}`));
}

describe("the catalogues", () => {
  it("have the same words, none of them empty in one alone", () => {
    const german = new Map(flat(de));
    for (const [path, word] of flat(en)) {
      expect(german.get(path) === "", path).toBe(word === "");
    }
    expect([...german.keys()]).toEqual(flat(en).map(([path]) => path));
  });

  it("name the values they are given in both languages", () => {
    const german = new Map(flat(de));
    const numbers = (word: string) => [...word.matchAll(/\d+/g)].map(String).sort();
    for (const [path, word] of flat(en)) {
      expect(numbers(german.get(path) ?? ""), path).toEqual(numbers(word));
    }
  });

  it("differ", () => {
    const english = new Map(flat(en));
    const same = flat(de).filter(([path, word]) => english.get(path) === word && /[a-z]{3}/.test(word));
    expect(same.length).toBeLessThan(0.2 * english.size);
  });
});

describe("chooseLanguage", () => {
  it("takes what was chosen here before what the browser wants", () => {
    expect(chooseLanguage("de", ["en-GB"])).toBe("de");
    expect(chooseLanguage(null, ["fr-FR", "de-AT", "en"])).toBe("de");
    expect(chooseLanguage("constructor", ["fr"])).toBe("en");
    expect(chooseLanguage(null, [])).toBe("en");
  });
});
