import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Store } from "../state/store";
import { Command, tabMemory } from "./command";
import { startWorkerPulse } from "./pulse";

function setup(remembered = false) {
  const store = new Store();
  const line = { sendHeartbeat: vi.fn(), releaseCommand: vi.fn(() => true) };
  const stop = vi.fn();
  let beat: () => void = () => undefined;
  const startPulse = vi.fn((tick: () => void) => {
    beat = tick;
    return { stop };
  });
  const memory = { read: () => remembered, write: vi.fn() };
  const command = new Command(store, line, startPulse, memory);
  return { store, line, stop, startPulse, memory, command, beat: () => { beat(); } };
}

describe("Command", () => {
  it("is silent while somebody only watches", () => {
    const { command, line, startPulse, store } = setup();
    command.restore();
    command.beat();
    expect(line.sendHeartbeat).not.toHaveBeenCalled();
    expect(startPulse).not.toHaveBeenCalled();
    expect(store.get().inCommand).toBe(false);
  });

  it("says at once that the operator is there, and again with every beat", () => {
    const { command, line, startPulse, store, beat } = setup();
    command.take();
    expect(store.get().inCommand).toBe(true);
    expect(line.sendHeartbeat).toHaveBeenCalledTimes(1);
    beat();
    beat();
    expect(line.sendHeartbeat).toHaveBeenCalledTimes(3);
    command.take();
    expect(startPulse).toHaveBeenCalledTimes(1);
  });

  it("falls silent when the operator takes leave, and can begin again", () => {
    const { command, line, stop, store, beat, startPulse, memory } = setup();
    command.take();
    expect(command.release()).toBe(true);
    expect(stop).toHaveBeenCalledTimes(1);
    beat();
    expect(line.sendHeartbeat).toHaveBeenCalledTimes(1);
    expect(store.get().inCommand).toBe(false);
    expect(memory.write.mock.calls).toEqual([[true], [false]]);
    command.take();
    expect(startPulse).toHaveBeenCalledTimes(2);
  });

  it("follows the server when the command comes or goes", () => {
    const { command, line, store, stop, memory, beat } = setup();
    expect(command.follow(false)).toBe("stays");
    expect(command.follow(true)).toBe("came");
    expect(store.get().inCommand).toBe(true);
    expect(line.sendHeartbeat).toHaveBeenCalledTimes(1);
    expect(command.follow(true)).toBe("stays");
    expect(command.follow(false)).toBe("went");
    // The other one is in command: no leave is to be taken of the flight.
    expect(line.releaseCommand).not.toHaveBeenCalled();
    expect(stop).toHaveBeenCalledTimes(1);
    beat();
    expect(line.sendHeartbeat).toHaveBeenCalledTimes(1);
    expect(memory.write.mock.calls).toEqual([[true], [false]]);
  });

  it("stays in command when the server cannot be told", () => {
    const { command, line, stop, store, beat } = setup();
    command.take();
    line.releaseCommand.mockReturnValueOnce(false);
    expect(command.release()).toBe(false);
    expect(stop).not.toHaveBeenCalled();
    beat();
    expect(line.sendHeartbeat).toHaveBeenCalledTimes(2);
    expect(store.get().inCommand).toBe(true);
  });

  it("goes on after a reload", () => {
    const { command, line, store } = setup(true);
    command.restore();
    expect(store.get().inCommand).toBe(true);
    expect(line.sendHeartbeat).toHaveBeenCalledTimes(1);
  });
});

describe("tabMemory", () => {
  function page(type: string, stored: Map<string, string>) {
    const sessionStorage = {
      getItem: (key: string) => stored.get(key) ?? null,
      setItem: (key: string, value: string) => void stored.set(key, value),
      removeItem: (key: string) => void stored.delete(key),
    };
    const performance = { getEntriesByType: () => [{ type }] };
    return { sessionStorage, performance } as unknown as Window;
  }

  it("survives a reload, and neither a copy of the tab nor a restored one", () => {
    const stored = new Map<string, string>();
    tabMemory(page("navigate", stored)).write(true);
    expect(tabMemory(page("reload", stored)).read()).toBe(true);
    expect(tabMemory(page("navigate", stored)).read()).toBe(false);
    tabMemory(page("reload", stored)).write(false);
    expect(tabMemory(page("reload", stored)).read()).toBe(false);
  });

  it("does without storage where the browser forbids it", () => {
    const forbidden = page("reload", new Map());
    Object.defineProperty(forbidden, "sessionStorage", {
      get: () => {
        throw new DOMException("denied", "SecurityError");
      },
    });
    const memory = tabMemory(forbidden);
    memory.write(true);
    expect(memory.read()).toBe(false);
  });
});

describe("startWorkerPulse", () => {
  beforeEach(() => {
    vi.useFakeTimers();
  });
  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  it("beats with the worker's ticks and stops with it", () => {
    const workers: { onmessage?: () => void; terminate: () => void }[] = [];
    const terminate = vi.fn();
    vi.stubGlobal("Worker", class {
      onmessage?: () => void;
      terminate = terminate;
      constructor() {
        workers.push(this);
      }
    });
    const beat = vi.fn();
    const pulse = startWorkerPulse(beat);
    vi.advanceTimersByTime(60_000);
    expect(beat).not.toHaveBeenCalled();
    workers[0]?.onmessage?.();
    expect(beat).toHaveBeenCalledTimes(1);
    pulse.stop();
    expect(terminate).toHaveBeenCalledTimes(1);
  });

  it("beats by the page's own timer where no worker can be had", () => {
    vi.stubGlobal("Worker", undefined);
    const beat = vi.fn();
    const pulse = startWorkerPulse(beat);
    vi.advanceTimersByTime(6000);
    expect(beat).toHaveBeenCalledTimes(3);
    pulse.stop();
    vi.advanceTimersByTime(60_000);
    expect(beat).toHaveBeenCalledTimes(3);
  });
});
