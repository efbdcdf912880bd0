import { afterEach, describe, expect, it, vi } from "vitest";
import { asksForKeys, forwardPageKeys, screenOfKey, type KeyPress } from "./pageKeys";

function press(key: string, changes: object = {}): KeyPress {
  const modifiers = { ctrlKey: false, altKey: false, metaKey: false, shiftKey: false };
  return { key, ...modifiers, repeat: false, target: null, ...changes };
}

describe("screenOfKey", () => {
  it("goes by the order of the screens", () => {
    expect(["1", "2", "5"].map((key) => screenOfKey(press(key)))).toEqual(["fly", "plan", "setup"]);
  });

  it.each(["0", "6", "1.5", "", " ", "a", "?"])("knows nothing of %j", (key) => {
    expect(screenOfKey(press(key))).toBeNull();
  });

  it("leaves shortcuts of the browser and fields alone", () => {
    expect(screenOfKey(press("1", { ctrlKey: true }))).toBeNull();
    expect(screenOfKey(press("1", { target: { tagName: "INPUT", type: "number" } }))).toBeNull();
    expect(screenOfKey(press("1", { target: { tagName: "TEXTAREA" } }))).toBeNull();
  });
});

describe("forwardPageKeys", () => {
  class FakeKeyboardEvent extends Event {
    readonly key: string;
    constructor(type: string, init: { readonly key: string }) {
      super(type);
      this.key = init.key;
    }
  }

  afterEach(() => {
    vi.unstubAllGlobals();
  });

  it("hands the page its keys and no others, until it ends", () => {
    vi.stubGlobal("KeyboardEvent", FakeKeyboardEvent);
    const [frame, page] = [new EventTarget(), new EventTarget()];
    const heard: string[] = [];
    page.addEventListener("keydown", (event) => {
      if (event instanceof FakeKeyboardEvent) heard.push(event.key);
    });
    const end = forwardPageKeys(frame as Window, page as Window);
    const type = (key: string) => frame.dispatchEvent(new FakeKeyboardEvent("keydown", { key }));
    ["w", "3", "?", "9"].forEach(type);
    expect(heard).toEqual(["3", "?"]);
    end();
    type("3");
    expect(heard).toHaveLength(2);
  });

  it("keeps a question mark that is written", () => {
    expect(asksForKeys(press("?", { shiftKey: true }))).toBe(true);
    expect(asksForKeys(press("?", { target: { tagName: "TEXTAREA" } }))).toBe(false);
  });
});
