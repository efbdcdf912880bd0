/** Names this tab among those that hold the token; kept over a reload, new in another tab. */
export const CLIENT_HEADER = "X-Dronerf-Client";

const KEY = "dronerf.client";

function newId(): string {
  // `randomUUID` is for secure contexts only, and a console in the field is reached by plain http.
  const bytes = crypto.getRandomValues(new Uint8Array(12));
  return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function rememberedId(): string {
  const id = newId();
  try {
    const [entry] = performance.getEntriesByType("navigation");
    const reloaded = (entry as PerformanceNavigationTiming | undefined)?.type === "reload";
    const known = globalThis.sessionStorage.getItem(KEY);
    // A tab that was copied has the memory of the other one, and is another one.
    if (reloaded && known !== null) return known;
    globalThis.sessionStorage.setItem(KEY, id);
  } catch {
    // A browser that keeps nothing gives a reloaded tab a new name.
  }
  return id;
}

export const clientId = rememberedId();
