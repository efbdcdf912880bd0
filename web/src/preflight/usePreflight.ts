import { useEffect, useState } from "react";
import { RequestError } from "../api/request";
import { getPreflight, type Check } from "../api/safety";

const EVERY_MS = 1000;

/** The newest checklist, and why there is no newer one. */
export interface Preflight {
  readonly checks: readonly Check[] | null;
  readonly error: string | null;
}

/** Ask for the checklist once a second for as long as the component stands. */
export function usePreflight(): Preflight {
  const [preflight, setPreflight] = useState<Preflight>({ checks: null, error: null });
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    let over = false;
    const look = async () => {
      try {
        const checks = await getPreflight();
        if (!over) setPreflight({ checks, error: null });
      } catch (error) {
        if (!(error instanceof RequestError)) throw error;
        const { message } = error;
        if (!over) setPreflight((last) => ({ ...last, error: message }));
      }
      if (!over) timer = setTimeout(() => void look(), EVERY_MS);
    };
    void look();
    return () => {
      over = true;
      clearTimeout(timer);
    };
  }, []);
  return preflight;
}
