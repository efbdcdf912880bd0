import { BASE } from "../api/base";
import { clientId } from "../api/tabId";
import type { Sticks } from "../manual/sticks";
import type { ClientMessage, ServerMessage } from "./messages.gen";
import { parseMessage } from "./parse";
import { parseTile, TileError, type Tile } from "./tile";

/** What the stream tells the rest of the console. */
export interface StreamListener {
  /** The socket opened; the server now sends everything that stands. */
  onOpen(): void;
  /** The socket is gone; the next attempt starts in `retryInMs`. */
  onLost(retryInMs: number): void;
  onMessage(message: ServerMessage): void;
  /** Show a picture; it is acknowledged when the promise settles, however it settles. */
  onTile(tile: Tile): Promise<void>;
  /** Something arrived that could not be read; it was dropped. */
  onUnreadable(reason: string): void;
}

/** The part of a WebSocket that the stream uses; tests bring their own. */
export type Socket = Pick<WebSocket, "send" | "close" | "readyState"> & {
  binaryType: BinaryType;
  onopen: ((event: Event) => void) | null;
  onclose: ((event: CloseEvent) => void) | null;
  onmessage: ((event: MessageEvent) => void) | null;
};

const OPEN = 1;
const FIRST_RETRY_MS = 250;
const LONGEST_RETRY_MS = 5000;

/**
 * The console's one websocket: opens it, opens it again when it is lost (after 0.25 s, then twice
 * as long each time up to 5 s), reads what comes and acknowledges every picture.
 */
export class ConsoleStream {
  readonly #url: string;
  readonly #listener: StreamListener;
  readonly #open: (url: string) => Socket;
  #socket: Socket | null = null;
  #retryTimer: ReturnType<typeof setTimeout> | undefined;
  #retryMs = FIRST_RETRY_MS;
  #running = false;
  /** Drones whose pictures are wanted; null means all, which is what the server starts with. */
  #shown: readonly string[] | null = null;
  #coding: "jpeg" | "h264" = "jpeg";

  constructor(url: string, listener: StreamListener, open: (url: string) => Socket = openSocket) {
    this.#url = url;
    this.#listener = listener;
    this.#open = open;
  }

  start(): void {
    if (this.#running) return;
    this.#running = true;
    this.#connect();
  }

  stop(): void {
    this.#running = false;
    clearTimeout(this.#retryTimer);
    const socket = this.#socket;
    this.#socket = null;
    socket?.close();
  }

  /** Ask for the pictures of these drones only, now and after every reconnection. */
  showTiles(droneIds: readonly string[]): void {
    this.#shown = droneIds;
    this.#sendShown();
  }

  /** Have pictures come in this form, now and after every reconnection; false when they do. */
  codeTiles(coding: "jpeg" | "h264"): boolean {
    if (coding === this.#coding) return false;
    this.#coding = coding;
    this.#sendShown();
    return true;
  }

  /** Tell the server that the operator in command is there; lost with the line, as it should be. */
  sendHeartbeat(): void {
    this.#send({ type: "heartbeat", client: clientId });
  }

  /** Push a drone's sticks; lost with the line, as it should be. */
  steer(droneId: string, sticks: Sticks): void {
    this.#send({ type: "steer", client: clientId, drone_id: droneId, ...sticks });
  }

  /** Take leave of the flight; false when there is no line to say it on. */
  releaseCommand(): boolean {
    return this.#send({ type: "release_command", client: clientId });
  }

  /** Be in command from now on, whoever was before; false when there is no line to say it on. */
  takeCommand(): boolean {
    return this.#send({ type: "take_command", client: clientId });
  }

  /** Ask the browser in command for it; false when there is no line to say it on. */
  askCommand(): boolean {
    return this.#send({ type: "ask_command", client: clientId });
  }

  /** Hand the command over to who asks for it, or keep it. */
  answerCommand(grant: boolean): boolean {
    return this.#send({ type: "answer_command", client: clientId, grant });
  }

  #connect(): void {
    const socket = this.#open(this.#url);
    this.#socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      if (socket !== this.#socket) return;
      this.#retryMs = FIRST_RETRY_MS;
      this.#sendShown();
      this.#listener.onOpen();
    };
    socket.onmessage = (event) => {
      if (socket === this.#socket) this.#receive(socket, event.data);
    };
    // A socket that fails to open closes as well, so `onclose` alone covers both.
    socket.onclose = () => {
      if (socket !== this.#socket) return;
      this.#socket = null;
      this.#retry();
    };
  }

  #retry(): void {
    if (!this.#running) return;
    const waitMs = this.#retryMs;
    this.#retryMs = Math.min(2 * waitMs, LONGEST_RETRY_MS);
    this.#retryTimer = setTimeout(() => {
      this.#connect();
    }, waitMs);
    this.#listener.onLost(waitMs);
  }

  #receive(socket: Socket, data: unknown): void {
    if (typeof data === "string") this.#receiveText(data);
    else if (data instanceof ArrayBuffer) this.#receiveTile(socket, data);
  }

  #receiveText(text: string): void {
    let message: ServerMessage | null;
    try {
      message = parseMessage(text);
    } catch (error) {
      if (!(error instanceof SyntaxError)) throw error;
      this.#listener.onUnreadable(error.message);
      return;
    }
    if (message === null) this.#listener.onUnreadable(text.slice(0, 80));
    else this.#listener.onMessage(message);
  }

  #receiveTile(socket: Socket, bytes: ArrayBuffer): void {
    let tile: Tile;
    try {
      tile = parseTile(bytes);
    } catch (error) {
      if (!(error instanceof TileError)) throw error;
      this.#listener.onUnreadable(error.message);
      return;
    }
    const { drone_id, sequence } = tile.header;
    const acknowledge = (decoded: boolean) => {
      // The picture belongs to the socket it came from; a newer socket knows nothing of it.
      if (socket === this.#socket) this.#send({ type: "tile_shown", drone_id, sequence, decoded });
    };
    // A picture that cannot be shown is acknowledged too: otherwise its drone's video would stop.
    this.#listener.onTile(tile).then(
      () => {
        acknowledge(true);
      },
      () => {
        acknowledge(false);
      },
    );
  }

  #sendShown(): void {
    // Before the page has chosen, the server's own choice stands.
    if (this.#shown === null) return;
    this.#send({ type: "show_tiles", drone_ids: this.#shown, coding: this.#coding });
  }

  #send(message: ClientMessage): boolean {
    if (this.#socket?.readyState !== OPEN) return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }
}

function openSocket(url: string): Socket {
  return new WebSocket(url);
}

/** The stream's address beside the page that was loaded. */
export function streamUrl(page: Pick<Location, "protocol" | "host">): string {
  return `${page.protocol === "https:" ? "wss:" : "ws:"}//${page.host}${BASE}/api/v1/stream`;
}
