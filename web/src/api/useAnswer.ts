import { useCallback, useEffect, useState } from "react";
import { RequestError } from "./request";

/** What the server answered, or why it did not. */
export interface Answer<T> {
  readonly value: T | null;
  readonly error: string | null;
  /** True while the answer to the newest question is out. */
  readonly asking: boolean;
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
  const [state, setState] = useState<{ value: T | null; error: string | null; answers: string }>({
    value: null,
    error: null,
    answers: "",
  });
  const question = `${asked} ${key}`;
  useEffect(() => {
    let over = false;
    ask().then(
      (value) => {
        if (!over) setState({ value, error: null, answers: question });
      },
      (error: unknown) => {
        if (!(error instanceof RequestError)) throw error;
        if (!over) setState((last) => ({ ...last, error: error.message, answers: question }));
      },
    );
    return () => {
      over = true;
    };
    // eslint-disable-next-line react-hooks/exhaustive-deps -- `key` stands for all that `ask` uses.
  }, [question]);
  const again = useCallback(() => {
    setAsked((times) => times + 1);
  }, []);
  return { value: state.value, error: state.error, asking: state.answers !== question, again };
}
