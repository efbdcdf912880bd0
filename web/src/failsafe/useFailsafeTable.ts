import { useEffect, useState } from "react";
import { RequestError } from "../api/request";
import { getFailsafes, type FailsafeRow } from "../api/safety";
import { useConsole } from "../context";

const AGAIN_MS = 5000;

/** The failsafe table of the server at hand; null until it is known. */
export function useFailsafeTable(): readonly FailsafeRow[] | null {
  // A server that was started anew may have another table.
  const epoch = useConsole((state) => state.epoch);
  const [table, setTable] = useState<readonly FailsafeRow[] | null>(null);
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    let over = false;
    const ask = async () => {
      try {
        const rows = await getFailsafes();
        if (!over) setTable(rows);
      } catch (error) {
        if (!(error instanceof RequestError)) throw error;
        if (!over) timer = setTimeout(() => void ask(), AGAIN_MS);
      }
    };
    void ask();
    return () => {
      over = true;
      clearTimeout(timer);
    };
  }, [epoch]);
  return table;
}
