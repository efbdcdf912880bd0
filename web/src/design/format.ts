import { language, words } from "../text/words";

/** A number with fixed decimals, or a dash where there is none. */
export function decimal(value: number | null | undefined, digits: number): string {
  return value === null || value === undefined ? words.none : value.toFixed(digits);
}

/** A value with its unit, or a dash alone. */
export function withUnit(value: number | null, digits: number, unit: string): string {
  return value === null ? words.none : `${value.toFixed(digits)} ${unit}`;
}

/** An age: tenths below ten seconds, whole seconds below two minutes, then minutes. */
export function age(seconds: number | null): string {
  if (seconds === null) return words.none;
  const whole = Math.max(0, seconds);
  if (whole < 9.95) return `${whole.toFixed(1)} s`;
  return whole < 120 ? `${Math.round(whole)} s` : `${Math.round(whole / 60)} min`;
}

/** A duration as minutes and seconds, `1:05`; hours when there are any. */
export function clock(seconds: number): string {
  const whole = Math.max(0, Math.round(seconds));
  const s = String(whole % 60).padStart(2, "0");
  const m = Math.floor(whole / 60) % 60;
  const h = Math.floor(whole / 3600);
  return h > 0 ? `${h}:${String(m).padStart(2, "0")}:${s}` : `${m}:${s}`;
}

/** A large count with three figures: `950`, `4.13 k`, `6.42 M`. */
export function count(value: number): string {
  const magnitude = Math.abs(value);
  if (magnitude >= 999_500) return `${(value / 1e6).toPrecision(3)} M`;
  if (magnitude >= 999.5) return `${(value / 1e3).toPrecision(3)} k`;
  return value.toFixed(0);
}

/** A number by its power of ten, `1e-3`: for logarithmic scales, whose unmarked ticks are null. */
export function power(value: number | null): string {
  return value === null ? "" : value.toExponential(0);
}

/** A size of files with three figures: `950 B`, `4.13 kB`, `61.2 MB`. */
export function bytes(value: number): string {
  const units = ["B", "kB", "MB", "GB"];
  const power = Math.min(units.length - 1, Math.max(0, Math.floor(Math.log10(Math.max(1, value)) / 3)));
  const scaled = value / 1000 ** power;
  return `${power === 0 ? scaled.toFixed(0) : scaled.toPrecision(3)} ${units[power] ?? ""}`;
}

const MOMENT = new Intl.DateTimeFormat(language === "en" ? "en-GB" : language, {
  dateStyle: "medium",
  timeStyle: "short",
});

/** Local date and time of day of an ISO 8601 moment. */
export function moment(at: string): string {
  const date = new Date(at);
  return Number.isNaN(date.getTime()) ? at : MOMENT.format(date);
}

const TIME_OF_DAY = new Intl.DateTimeFormat("en-GB", {
  hour: "2-digit",
  minute: "2-digit",
  second: "2-digit",
});

/** Local time of day of an ISO 8601 moment. */
export function timeOfDay(at: string): string {
  const moment = new Date(at);
  return Number.isNaN(moment.getTime()) ? at : TIME_OF_DAY.format(moment);
}
