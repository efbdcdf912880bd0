import { beforeEach, describe, expect, it, vi } from "vitest";
import type { CodedTile } from "../protocol/tile";
import { codecOf } from "./annexB";
import { CodedVideo, PassedOver, type Decoder, type DecoderEvents } from "./codedVideo";

const SETS = [0, 0, 0, 1, 0x67, 0x4d, 0x40, 0x28, 9, 0, 0, 1, 0x68, 1];

function tile(sequence: number, key = false, sets: readonly number[] = SETS): CodedTile {
  const unit = Uint8Array.from([...(key ? sets : []), 0, 0, 1, key ? 0x65 : 0x41, 7]);
  return {
    kind: "h264",
    header: { drone_id: "a", sequence, age_s: 0, damaged: false, coding: "h264", key, sizes: [unit.length], marks: null, note: "" },
    units: [unit],
  };
}

/** A decoder that does as it is told. */
class FakeDecoder implements Decoder {
  state: CodecState = "unconfigured";
  readonly events: DecoderEvents;
  readonly decoded: { type: string; timestamp: number }[] = [];
  config: VideoDecoderConfig | null = null;
  constructor(events: DecoderEvents) {
    this.events = events;
  }
  configure(config: VideoDecoderConfig): void {
    this.config = config;
    this.state = "configured";
  }
  decode(chunk: EncodedVideoChunk): void {
    this.decoded.push(chunk);
  }
  close(): void {
    this.state = "closed";
  }
  put(sequence: number): { timestamp: number; close: () => void } {
    const picture = { timestamp: sequence, close: vi.fn() };
    this.events.output(picture as unknown as VideoFrame);
    return picture;
  }
  fail(): void {
    this.state = "closed";
    this.events.error(new DOMException("broken"));
  }
}

function setup() {
  const decoders: FakeDecoder[] = [];
  const onGiveUp = vi.fn();
  const video = new CodedVideo(onGiveUp, (events) => {
    const decoder = new FakeDecoder(events);
    decoders.push(decoder);
    return decoder;
  });
  return { video, decoders, onGiveUp };
}

beforeEach(() => {
  vi.stubGlobal(
    "EncodedVideoChunk",
    class {
      readonly type: string;
      readonly timestamp: number;
      constructor({ type, timestamp }: EncodedVideoChunkInit) {
        this.type = type;
        this.timestamp = timestamp;
      }
    },
  );
});

describe("codecOf", () => {
  it("reads profile, constraints and level of the first parameter set", () => {
    expect(codecOf(Uint8Array.from(SETS))).toBe("avc1.4D4028");
  });

  it.each([[[]], [[0, 0, 1]], [[0, 0, 1, 0x41, 1, 2, 3, 4]], [[0, 0, 1, 0x67, 0x42]]])("finds none in %j", (bytes) => {
    expect(codecOf(Uint8Array.from(bytes))).toBeNull();
  });
});

describe("CodedVideo", () => {
  it("waits for a key picture, then decodes in Annex B with low delay", async () => {
    const { video, decoders } = setup();
    await expect(video.decode(tile(1))).rejects.toThrow(PassedOver);
    expect(decoders).toHaveLength(0);
    const key = video.decode(tile(2, true));
    const next = video.decode(tile(3));
    expect(decoders[0]?.config).toEqual({
      codec: "avc1.4D4028",
      optimizeForLatency: true,
      hardwareAcceleration: "prefer-software",
    });
    expect(decoders[0]?.decoded.map(({ type, timestamp }) => [type, timestamp])).toEqual([
      ["key", 2],
      ["delta", 3],
    ]);
    decoders[0]?.put(2);
    decoders[0]?.put(3);
    expect((await key).timestamp).toBe(2);
    expect((await next).timestamp).toBe(3);
  });

  it("decodes those that nobody looked at as well, and shows the last", async () => {
    const { video, decoders } = setup();
    const key = tile(4, true);
    const rest = [tile(5), tile(6)];
    const shown = video.decode({
      ...key,
      header: { ...key.header, sequence: 6 },
      units: [...key.units, ...rest.flatMap(({ units }) => units)],
    });
    expect(decoders[0]?.decoded.map(({ type, timestamp }) => [type, timestamp])).toEqual([
      ["key", 4],
      ["delta", 5],
      ["delta", 6],
    ]);
    expect(decoders[0]?.put(4).close).toHaveBeenCalledOnce();
    decoders[0]?.put(6);
    expect((await shown).timestamp).toBe(6);
    const next = video.decode(tile(7));
    decoders[0]?.put(7);
    expect((await next).timestamp).toBe(7);
  });

  it("passes over what the decoder leaves out, and closes what nobody waits for", async () => {
    const { video, decoders } = setup();
    const key = video.decode(tile(2, true));
    const next = video.decode(tile(3));
    decoders[0]?.put(3);
    await expect(key).rejects.toThrow("left out");
    expect((await next).timestamp).toBe(3);
    expect(decoders[0]?.put(3).close).toHaveBeenCalledOnce();
  });

  it("goes on at the next key picture after a failure", async () => {
    const { video, decoders, onGiveUp } = setup();
    const key = video.decode(tile(2, true));
    decoders[0]?.fail();
    await expect(key).rejects.toThrow("broken");
    await expect(video.decode(tile(3))).rejects.toThrow("waits for a key picture");
    const later = video.decode(tile(4, true));
    decoders[1]?.put(4);
    expect((await later).timestamp).toBe(4);
    expect(onGiveUp).not.toHaveBeenCalled();
  });

  it("gives up after three failures in a row, not after more that were not", async () => {
    const { video, decoders, onGiveUp } = setup();
    for (let k = 0; k < 5; k++) {
      const shown = video.decode(tile(10 * k, true));
      decoders[2 * k]?.put(10 * k);
      await shown;
      decoders[2 * k]?.fail();
      const lost = video.decode(tile(10 * k + 5, true));
      decoders[2 * k + 1]?.fail();
      await expect(lost).rejects.toThrow();
    }
    expect(onGiveUp).not.toHaveBeenCalled();
    const lost = video.decode(tile(99, true));
    decoders[10]?.fail();
    await expect(lost).rejects.toThrow();
    expect(onGiveUp).toHaveBeenCalledOnce();
  });

  it("gives up on a decoder that keeps its pictures", async () => {
    const { video, decoders, onGiveUp } = setup();
    vi.useFakeTimers();
    try {
      const shown = video.decode(tile(1, true));
      const kept = [2, 3, 4].map((sequence) => video.decode(tile(sequence)));
      const ends = kept.map((each) => expect(each).rejects.toThrow("keeps its pictures"));
      vi.advanceTimersByTime(2900);
      // Slow is not kept.
      decoders[0]?.put(1);
      expect((await shown).timestamp).toBe(1);
      vi.advanceTimersByTime(2900);
      expect(onGiveUp).not.toHaveBeenCalled();
      vi.advanceTimersByTime(200);
      await Promise.all(ends);
      expect(onGiveUp).toHaveBeenCalledOnce();
    } finally {
      vi.useRealTimers();
    }
  });

  it("begins anew at the key picture after a gap", async () => {
    const { video, decoders } = setup();
    const first = video.decode(tile(1, true));
    decoders[0]?.put(1);
    await first;
    await expect(video.decode(tile(3))).rejects.toThrow("waits for a key picture");
    const key = video.decode(tile(4, true));
    expect(decoders).toHaveLength(2);
    decoders[1]?.put(4);
    expect((await key).timestamp).toBe(4);
  });

  it("keeps its decoder over key pictures, and makes another for another stream", async () => {
    const { video, decoders } = setup();
    const shown = [video.decode(tile(1, true)), video.decode(tile(2, true))];
    expect(decoders).toHaveLength(1);
    const other = video.decode(tile(3, true, [0, 0, 1, 0x67, 0x42, 0xe0, 0x1f, 1]));
    for (const each of shown) await expect(each).rejects.toThrow("changed");
    expect(decoders[0]?.state).toBe("closed");
    decoders[1]?.put(3);
    expect((await other).timestamp).toBe(3);
    video.close();
    expect(decoders[1]?.state).toBe("closed");
  });
});
