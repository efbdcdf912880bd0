import type { CodedTile } from "../protocol/tile";
import { codecOf } from "./annexB";

/** The part of a VideoDecoder that is used; tests bring their own. */
export type Decoder = Pick<VideoDecoder, "configure" | "decode" | "close" | "state">;

/** What a decoder tells. */
export interface DecoderEvents {
  readonly output: (picture: VideoFrame) => void;
  readonly error: (reason: DOMException) => void;
}

interface Waiting {
  readonly resolve: (picture: VideoFrame) => void;
  readonly reject: (reason: Error) => void;
}

/** After so many failures in a row the browser cannot decode this stream. */
const MOST_FAILURES = 3;
/** A decoder that shows none of its pictures for so long keeps them, to reorder them. */
const LONGEST_KEPT_MS = 3000;

/**
 * Drones do not say that they never reorder pictures, and decoders in hardware then hold a dozen
 * back, whatever the latency they are asked for.
 */
const WITHOUT_DELAY = { optimizeForLatency: true, hardwareAcceleration: "prefer-software" } as const;

/** A picture that is not shown; the text says why. */
export class PassedOver extends Error {
  override readonly name = "PassedOver";
}

/**
 * Decodes one drone's video. After a failure or a gap it begins anew at the next key picture; after
 * three failures in a row, none decoded between them, it calls `onGiveUp`.
 */
export class CodedVideo {
  readonly #onGiveUp: () => void;
  readonly #make: (events: DecoderEvents) => Decoder;
  readonly #waiting = new Map<number, Waiting>();
  #decoder: Decoder | null = null;
  #codec: string | null = null;
  #failures = 0;
  #last = -1;
  #watching: ReturnType<typeof setTimeout> | undefined;

  constructor(onGiveUp: () => void, make = (events: DecoderEvents): Decoder => new VideoDecoder(events)) {
    this.#onGiveUp = onGiveUp;
    this.#make = make;
  }

  /**
   * Decode a picture, and before it those that came along; who gets it closes it.
   *
   * Rejects with PassedOver what cannot be decoded, or what the decoder has left out.
   */
  decode({ header, units }: CodedTile): Promise<VideoFrame> {
    const first = header.sequence - units.length + 1;
    // What a decoder keeps of a broken picture may spoil even the next key picture.
    if (first !== this.#last + 1) this.#end("a gap");
    this.#last = header.sequence;
    if (header.key && units[0] !== undefined) this.#begin(codecOf(units[0]));
    const decoder = this.#decoder;
    if (decoder === null) return Promise.reject(new PassedOver("waits for a key picture"));
    return new Promise((resolve, reject) => {
      this.#waiting.set(header.sequence, { resolve, reject });
      this.#watch();
      try {
        for (const [k, data] of units.entries()) {
          // Its timestamp brings the sequence back.
          const timestamp = first + k;
          decoder.decode(
            new EncodedVideoChunk({ type: header.key && k === 0 ? "key" : "delta", timestamp, data }),
          );
        }
      } catch (error) {
        this.#fail(String(error));
      }
    });
  }

  close(): void {
    this.#end("closed");
  }

  /** Give up on a decoder that keeps its pictures: no more may come before one was shown. */
  #watch(): void {
    this.#watching ??= setTimeout(() => {
      this.#failures = MOST_FAILURES - 1;
      this.#fail("the decoder keeps its pictures");
    }, LONGEST_KEPT_MS);
  }

  #begin(codec: string | null): void {
    if (codec === null || (this.#decoder !== null && codec === this.#codec)) return;
    this.#end("the stream has changed");
    const decoder: Decoder = this.#make({
      output: (picture) => {
        this.#show(picture);
      },
      error: (reason) => {
        if (this.#decoder === decoder) this.#fail(reason.message);
      },
    });
    try {
      decoder.configure({ codec, ...WITHOUT_DELAY });
    } catch (error) {
      this.#fail(String(error));
      return;
    }
    this.#decoder = decoder;
    this.#codec = codec;
  }

  #show(picture: VideoFrame): void {
    const waiting = this.#waiting.get(picture.timestamp);
    if (waiting === undefined) {
      picture.close();
      return;
    }
    this.#failures = 0;
    this.#unwatch();
    // Pictures come out in order: those before it never will.
    for (const [sequence, before] of this.#waiting) {
      if (sequence > picture.timestamp) continue;
      this.#waiting.delete(sequence);
      if (before !== waiting) before.reject(new PassedOver("left out by the decoder"));
    }
    waiting.resolve(picture);
    if (this.#waiting.size > 0) this.#watch();
  }

  #unwatch(): void {
    clearTimeout(this.#watching);
    this.#watching = undefined;
  }

  #fail(reason: string): void {
    this.#end(reason);
    this.#failures += 1;
    if (this.#failures === MOST_FAILURES) this.#onGiveUp();
  }

  #end(reason: string): void {
    const decoder = this.#decoder;
    this.#decoder = null;
    this.#unwatch();
    if (decoder !== null && decoder.state !== "closed") decoder.close();
    for (const waiting of this.#waiting.values()) waiting.reject(new PassedOver(reason));
    this.#waiting.clear();
  }
}

/** Profiles that a Tello and its simulator send: Baseline and Main. */
const PROFILES = ["avc1.42E028", "avc1.4D4028"];

/**
 * Whether this page is to decode the drones' video itself: where it can and where a graphics card
 * draws. `?video=jpeg` in its address says no, `?video=h264` wherever it can.
 */
export async function shouldDecode(page: Pick<Location, "search">): Promise<boolean> {
  const wish = new URLSearchParams(page.search).get("video");
  // Only pages from localhost or over https have it.
  if (wish === "jpeg" || !("VideoDecoder" in globalThis)) return false;
  if (wish !== "h264" && !drawsInHardware()) return false;
  const answers = await Promise.all(
    PROFILES.map((codec) =>
      VideoDecoder.isConfigSupported({ codec, ...WITHOUT_DELAY }).then(
        ({ supported }) => supported === true,
        () => false,
      ),
    ),
  );
  return answers.every(Boolean);
}

/**
 * Whether a graphics card draws the page. Without one the page's own thread turns every picture of
 * four videos into colours, which takes it longer than an animation frame lasts.
 */
function drawsInHardware(): boolean {
  const context = document.createElement("canvas").getContext("webgl");
  if (context === null) return false;
  const about = context.getExtension("WEBGL_debug_renderer_info");
  const name: unknown = context.getParameter(about?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER);
  context.getExtension("WEBGL_lose_context")?.loseContext();
  // `failIfMajorPerformanceCaveat` would ask the same, but Chromium without a card grants it.
  return !/swiftshader|llvmpipe|software|basic render/i.test(String(name));
}
