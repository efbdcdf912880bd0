import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { clientId } from "../api/tabId";
import { ConsoleStream, streamUrl, type Socket, type StreamListener } from "./stream";

class FakeSocket implements Socket {
  binaryType: BinaryType = "blob";
  readyState: Socket["readyState"] = 0;
  readonly sent: unknown[] = [];
  onopen: Socket["onopen"] = null;
  onclose: Socket["onclose"] = null;
  onmessage: Socket["onmessage"] = null;
  send(data: string): void {
    this.sent.push(JSON.parse(data));
  }
  close(): void {
    this.readyState = 3;
  }
  open(): void {
    this.readyState = 1;
    this.onopen?.({} as Event);
  }
  lose(): void {
    this.readyState = 3;
    this.onclose?.({} as CloseEvent);
  }
  receive(data: string | ArrayBuffer): void {
    this.onmessage?.({ data } as MessageEvent);
  }
}

function setup(onTile: StreamListener["onTile"] = () => Promise.resolve()) {
  const sockets: FakeSocket[] = [];
  const listener = {
    onOpen: vi.fn(),
    onLost: vi.fn(),
    onMessage: vi.fn(),
    onTile: vi.fn(onTile),
    onUnreadable: vi.fn(),
  };
  const stream = new ConsoleStream("ws://host/api/v1/stream", listener, () => {
    const socket = new FakeSocket();
    sockets.push(socket);
    return socket;
  });
  const socket = (index: number): FakeSocket => {
    const found = sockets[index];
    if (found === undefined) throw new Error(`socket ${index} was not opened`);
    return found;
  };
  return { stream, listener, sockets, socket };
}

function tileBytes(sequence: number): ArrayBuffer {
  const header = new TextEncoder().encode(
    JSON.stringify({ drone_id: "a", sequence, age_s: 0, damaged: false }),
  );
  const bytes = new Uint8Array(4 + header.length + 1);
  new DataView(bytes.buffer).setUint32(0, header.length);
  bytes.set(header, 4);
  return bytes.buffer;
}

const MISSED = JSON.stringify({ type: "missed", events: 3 });

beforeEach(() => {
  vi.useFakeTimers();
});
afterEach(() => {
  vi.useRealTimers();
});

describe("ConsoleStream", () => {
  it("hands over messages and counts what it cannot read", () => {
    const { stream, listener, socket } = setup();
    stream.start();
    socket(0).open();
    socket(0).receive(MISSED);
    socket(0).receive("{");
    socket(0).receive('{"type":"toString"}');
    socket(0).receive(new ArrayBuffer(2));
    expect(listener.onMessage.mock.calls).toEqual([[{ type: "missed", events: 3 }]]);
    expect(listener.onUnreadable).toHaveBeenCalledTimes(3);
  });

  it("acknowledges a picture when it is shown, not before", async () => {
    let show: () => void = () => undefined;
    const { stream, socket } = setup(() => new Promise((resolve) => (show = resolve)));
    stream.start();
    socket(0).open();
    socket(0).receive(tileBytes(7));
    await vi.advanceTimersByTimeAsync(0);
    expect(socket(0).sent).toEqual([]);
    show();
    await vi.advanceTimersByTimeAsync(0);
    expect(socket(0).sent).toEqual([{ type: "tile_shown", drone_id: "a", sequence: 7, decoded: true }]);
  });

  it("acknowledges a picture that cannot be shown: its drone's video goes on", async () => {
    const { stream, socket } = setup(() => Promise.reject(new Error("not a JPEG")));
    stream.start();
    socket(0).open();
    socket(0).receive(tileBytes(8));
    await vi.advanceTimersByTimeAsync(0);
    expect(socket(0).sent).toEqual([{ type: "tile_shown", drone_id: "a", sequence: 8, decoded: false }]);
  });

  it("does not acknowledge an old socket's picture on a new one", async () => {
    let show: () => void = () => undefined;
    const { stream, socket } = setup(() => new Promise((resolve) => (show = resolve)));
    stream.start();
    socket(0).open();
    socket(0).receive(tileBytes(9));
    socket(0).lose();
    await vi.advanceTimersByTimeAsync(250);
    socket(1).open();
    show();
    await vi.advanceTimersByTimeAsync(0);
    expect([...socket(0).sent, ...socket(1).sent]).toEqual([]);
  });

  it("comes back, waiting twice as long each time up to five seconds", () => {
    const { stream, listener, sockets, socket } = setup();
    stream.start();
    for (let failure = 0; failure < 7; failure++) {
      socket(failure).lose();
      vi.advanceTimersByTime(5000);
    }
    expect(listener.onLost.mock.calls.flat()).toEqual([250, 500, 1000, 2000, 4000, 5000, 5000]);
    expect(sockets).toHaveLength(8);
    socket(7).open();
    socket(7).lose();
    expect(listener.onLost).toHaveBeenLastCalledWith(250);
  });

  it("asks a new socket for the same pictures", () => {
    const { stream, socket } = setup();
    stream.start();
    stream.showTiles([]);
    expect(socket(0).sent).toEqual([]);
    socket(0).open();
    socket(0).lose();
    vi.advanceTimersByTime(250);
    socket(1).open();
    const wish = { type: "show_tiles", drone_ids: [], coding: "jpeg" };
    expect([socket(0).sent, socket(1).sent]).toEqual([[wish], [wish]]);
    stream.codeTiles("h264");
    stream.codeTiles("h264");
    expect(socket(1).sent).toEqual([wish, { ...wish, coding: "h264" }]);
  });

  it("sends heartbeats on the open line and keeps none for later", () => {
    const { stream, socket } = setup();
    stream.start();
    stream.sendHeartbeat();
    expect(stream.releaseCommand()).toBe(false);
    socket(0).open();
    expect(socket(0).sent).toEqual([]);
    stream.sendHeartbeat();
    expect(stream.releaseCommand()).toBe(true);
    expect(socket(0).sent).toEqual([
      { type: "heartbeat", client: clientId },
      { type: "release_command", client: clientId },
    ]);
    socket(0).lose();
    stream.sendHeartbeat();
    expect(socket(0).sent).toHaveLength(2);
  });

  it("stays closed after stop", () => {
    const { stream, sockets, socket } = setup();
    stream.start();
    socket(0).open();
    stream.stop();
    socket(0).lose();
    vi.advanceTimersByTime(60_000);
    expect(sockets).toHaveLength(1);
  });
});

describe("streamUrl", () => {
  it("follows the page's own security", () => {
    expect(streamUrl({ protocol: "http:", host: "a:8000" })).toBe("ws://a:8000/api/v1/stream");
    expect(streamUrl({ protocol: "https:", host: "a" })).toBe("wss://a/api/v1/stream");
  });
});
