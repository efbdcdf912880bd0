/** The path below which the page at `address` is served, without a slash at its end. */
export function pathBelow(address: string): string {
  return new URL(".", address).pathname.replace(/\/$/, "");
}

/** The path that a proxy puts before all of ours; empty without one. */
export const BASE = typeof document === "undefined" ? "" : pathBelow(document.baseURI);
