import type { Setting } from "../api/setup";
import { words } from "../text/words";

/** A setting's value as people write it. */
export function valueText(value: unknown): string {
  if (typeof value === "number") return String(Number(value.toPrecision(6)));
  if (typeof value === "boolean") return value ? words.setup.yes : words.setup.no;
  if (typeof value === "string") return value === "" ? words.none : value;
  if (Array.isArray(value)) return value.map(valueText).join(", ");
  if (value !== null && typeof value === "object") {
    const entries = Object.entries(value).map(([key, each]) => `${key} ${valueText(each)}`);
    return entries.length === 0 ? words.none : entries.join(", ");
  }
  return words.none;
}

/** What a setting may be, empty where it may be anything. */
export function boundsText({ least, more_than: moreThan, most }: Setting): string {
  const text = words.setup.bounds;
  const upper = most === null ? null : valueText(most);
  if (least !== null) return upper === null ? text.least(valueText(least)) : text.between(valueText(least), upper);
  if (moreThan !== null) {
    return upper === null ? text.above(valueText(moreThan)) : text.aboveTo(valueText(moreThan), upper);
  }
  return upper === null ? "" : text.most(upper);
}

/** True where every wanted word is somewhere in the setting's name, variable or meaning. */
export function matches(setting: Setting, wanted: string): boolean {
  const all = `${setting.group}.${setting.name} ${setting.variable} ${setting.meaning}`.toLowerCase();
  return wanted
    .toLowerCase()
    .split(/\s+/)
    .every((word) => all.includes(word));
}
