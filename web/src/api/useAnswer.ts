import { useCallback, useEffect, useState } from "react";
import { RequestError } from "./request";

/** What the server answered, or why it did not. */
export interface Answer<T> {
  readonly value: T | null;
  readonly error: string | null;
  /** Ask again. */
  readonly again: () => void;
}

/**
 * Ask the server, and again whenever `key` changes; the last answer stands until the next one.
 *
 * `ask` is taken from the rendering in which `key` changed.
 */
export function useAnswer<T>(key: string, ask: () => Promise<T>): Answer<T> {
  const [asked, setAsked] = useState(0);
  const [state, setState] = useState<{ value: T | null; error: string | null; key: string }>({
    value: null,
    error: null,
    key,
  });
  useEffect(() => {
    let over = false;
    ask().then(
      (value) => {
        if (!over) setState({ value, error: null, key });
      },
      (error: unknown) => {
        if (!(error instanceof RequestError)) throw error;
        if (!over) setState((last) => ({ ...last, error: error.message }));
      },
    );
    return () => {
      over = true;
    };
    // eslint-disable-next-line react-hooks/exhaustive-deps -- `key` stands for all that `ask` uses.
  }, [key, asked]);
  const again = useCallback(() => {
    setAsked((times) => times + 1);
  }, []);
  return { value: state.value, error: state.error, again };
}
