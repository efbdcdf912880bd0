import { useEffect } from "react";
import { useConsole, useOperator } from "../context";
import type { LocalMessage } from "../state/state";
import { RequestError } from "./request";

const AGAIN_MS = 5000;

/**
 * Ask each server that the page comes to, until it answers, and take the answer in.
 *
 * A server that was started anew may know something else. For the page's outermost part; `ask` and
 * `message` are to be the same at every call.
 */
export function useTold<T>(ask: () => Promise<T>, message: (answer: T) => LocalMessage): void {
  const operator = useOperator();
  const epoch = useConsole((state) => state.epoch);
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    let over = false;
    const once = async () => {
      try {
        const answer = await ask();
        if (!over) operator.store.dispatch(message(answer));
      } catch (error) {
        if (!(error instanceof RequestError)) throw error;
        if (!over) timer = setTimeout(() => void once(), AGAIN_MS);
      }
    };
    if (epoch > 0) void once();
    return () => {
      over = true;
      clearTimeout(timer);
    };
  }, [operator, epoch, ask, message]);
}
