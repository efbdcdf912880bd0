import type { Store } from "../state/store";
import type { Pulse, StartPulse } from "./pulse";

/** The part of the stream that command needs. */
interface CommandLine {
  sendHeartbeat(): void;
  /** False when there is no line to say it on. */
  releaseCommand(): boolean;
}

/** Remembers, through a reload of this tab and nothing else, that it was in command. */
export interface CommandMemory {
  read(): boolean;
  write(inCommand: boolean): void;
}

/**
 * Whether somebody flies from this tab.
 *
 * It begins with the first thing done here that flies, and from then on the server is told every
 * two seconds that the operator is there. It ends only by taking leave: a tab that is closed, or a
 * browser that dies, falls silent, and the failsafe table answers that.
 */
export class Command {
  readonly #store: Store;
  readonly #line: CommandLine;
  readonly #startPulse: StartPulse;
  readonly #memory: CommandMemory;
  #pulse: Pulse | null = null;

  constructor(store: Store, line: CommandLine, startPulse: StartPulse, memory: CommandMemory) {
    this.#store = store;
    this.#line = line;
    this.#startPulse = startPulse;
    this.#memory = memory;
  }

  /** Go on where this tab left off before it was reloaded. */
  restore(): void {
    if (this.#memory.read()) this.take();
  }

  take(): void {
    this.#store.dispatch({ type: "command_taken" });
    this.#memory.write(true);
    this.beat();
    this.#pulse ??= this.#startPulse(() => {
      this.beat();
    });
  }

  /** Say now that the operator is there, if they are in command. */
  beat(): void {
    if (this.#store.get().inCommand) this.#line.sendHeartbeat();
  }

  /** Take leave; false, and still in command, when the server could not be told. */
  release(): boolean {
    if (!this.#line.releaseCommand()) return false;
    this.#end();
    return true;
  }

  /** Follow what the server says: `mine` where this tab is in command, false where another is. */
  follow(mine: boolean): "came" | "went" | "stays" {
    const { inCommand } = this.#store.get();
    if (mine === inCommand) return "stays";
    if (mine) this.take();
    else this.#end();
    return mine ? "came" : "went";
  }

  #end(): void {
    this.#pulse?.stop();
    this.#pulse = null;
    this.#memory.write(false);
    this.#store.dispatch({ type: "command_released" });
  }
}

const KEY = "dronerf_in_command";

/** Memory of one tab; a tab that was copied or restored later begins without command. */
export function tabMemory(page: Pick<Window, "sessionStorage" | "performance">): CommandMemory {
  const [entry] = page.performance.getEntriesByType("navigation");
  const reloaded = (entry as PerformanceNavigationTiming | undefined)?.type === "reload";
  return {
    read: () => {
      try {
        return reloaded && page.sessionStorage.getItem(KEY) === "yes";
      } catch {
        return false; // A browser may forbid storage altogether.
      }
    },
    write: (inCommand) => {
      try {
        if (inCommand) page.sessionStorage.setItem(KEY, "yes");
        else page.sessionStorage.removeItem(KEY);
      } catch {
        // Then a reloaded tab only watches until something is flown from it again.
      }
    },
  };
}
