import { reduce } from "./reduce";
import { INITIAL_STATE, type ConsoleState, type Message } from "./state";

/** Holds the console's state, passes every message through `reduce` and tells who listens. */
export class Store {
  #state: ConsoleState = INITIAL_STATE;
  readonly #listeners = new Set<() => void>();
  readonly #nowMs: () => number;

  constructor(nowMs: () => number = Date.now) {
    this.#nowMs = nowMs;
  }

  readonly get = (): ConsoleState => this.#state;

  readonly subscribe = (listener: () => void): (() => void) => {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  };

  dispatch(message: Message): void {
    const next = reduce(this.#state, message, this.#nowMs());
    if (next === this.#state) return;
    this.#state = next;
    for (const listener of this.#listeners) listener();
  }
}
