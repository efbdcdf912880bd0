import { createContext, useContext, useSyncExternalStore } from "react";
import type { Operator } from "./operator";
import type { ConsoleState } from "./state/state";

export const OperatorContext = createContext<Operator | null>(null);

/** The operator's hands; only inside `OperatorContext`. */
export function useOperator(): Operator {
  const operator = useContext(OperatorContext);
  if (operator === null) throw new Error("useOperator outside its context");
  return operator;
}

/** A part of the state; `select` returns something that stays the same object until it changes. */
export function useConsole<T>(select: (state: ConsoleState) => T): T {
  const { store } = useOperator();
  return useSyncExternalStore(store.subscribe, () => select(store.get()));
}
