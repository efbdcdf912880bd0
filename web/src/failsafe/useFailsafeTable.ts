import { useEffect } from "react";
import { RequestError } from "../api/request";
import { getFailsafes } from "../api/safety";
import { useConsole, useOperator } from "../context";

const AGAIN_MS = 5000;

/** Ask each server that the page comes to for its failsafe table. For the page's outermost part. */
export function useFailsafeTable(): void {
  const operator = useOperator();
  // A server that was started anew may have another table.
  const epoch = useConsole((state) => state.epoch);
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    let over = false;
    const ask = async () => {
      try {
        const rows = await getFailsafes();
        if (!over) operator.store.dispatch({ type: "failsafes_known", rows });
      } catch (error) {
        if (!(error instanceof RequestError)) throw error;
        if (!over) timer = setTimeout(() => void ask(), AGAIN_MS);
      }
    };
    if (epoch > 0) void ask();
    return () => {
      over = true;
      clearTimeout(timer);
    };
  }, [operator, epoch]);
}
