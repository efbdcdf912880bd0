import {
  changeCapture,
  isSignedIn,
  startCapture,
  type CaptureRequest,
  type CaptureVerb,
} from "./api/captures";
import { commandDrone, type DroneCommand } from "./api/drones";
import { addPriority, dropPriority, pickObject, searchObject } from "./api/objects";
import { RequestError } from "./api/request";
import { stopFleet, STOP_ATTEMPTS, type Stop } from "./api/stops";
import { Command, type CommandMemory } from "./command/command";
import { startWorkerPulse } from "./command/pulse";
import { anyFlying } from "./fly/activity";
import { TileHub } from "./fly/tileHub";
import type { Place, ShareBox } from "./pick/box";
import { ConsoleStream, streamUrl } from "./protocol/stream";
import type { Note } from "./protocol/messages.gen";
import { fliesByItself } from "./state/state";
import { Store } from "./state/store";
import { en } from "./text/en";

/** The word on each stop's button. */
export const STOP_WORD: Readonly<Record<Stop, string>> = {
  hold: en.stop.hold.word,
  land: en.stop.land.word,
  cut_motors: en.stop.cut.word,
};

/** What the page can do, and where its state lives: built once, handed down by context. */
export class Operator {
  readonly store = new Store();
  readonly tiles = new TileHub();
  readonly #stream: ConsoleStream;
  readonly #command: Command;

  constructor(page: Pick<Location, "protocol" | "host">, memory: CommandMemory) {
    this.#stream = new ConsoleStream(streamUrl(page), {
      onOpen: () => {
        this.store.dispatch({ type: "stream_opened" });
        this.log("info", en.log.opened);
        this.#command.beat();
      },
      onLost: () => {
        if (this.store.get().connection.kind === "open") this.log("warning", en.log.lost);
        this.store.dispatch({ type: "stream_lost" });
        void this.#checkSignedIn();
      },
      onMessage: (message) => {
        this.store.dispatch(message);
      },
      onTile: (tile) => this.tiles.show(tile),
      onUnreadable: (reason) => {
        this.log("warning", en.log.unreadable(reason));
      },
    });
    this.#command = new Command(this.store, this.#stream, startWorkerPulse, memory);
  }

  start(): void {
    this.#stream.start();
    this.#command.restore();
  }

  /** The page ends. With drones in the air that is silence; with all of them down it is leave. */
  leave(): void {
    const { inCommand, drones, capture } = this.store.get();
    const flies = drones.size === 0 || anyFlying(drones) || fliesByItself(capture);
    if (inCommand && !flies) this.#stream.releaseCommand();
    this.#stream.stop();
  }

  /** Take leave of the flight, which goes on; an alarm when the server could not be told. */
  leaveUnattended(): void {
    if (this.#command.release()) this.log("warning", en.command.left);
    else this.#alarm(en.command.leaveFailed);
  }

  /** Have the pictures of these drones sent, and no others. */
  showVideo(droneIds: readonly string[]): void {
    this.#stream.showTiles(droneIds);
  }

  dismissAlarm(id: number): void {
    this.store.dispatch({ type: "alarm_dismissed", id });
  }

  log(level: Note["level"], text: string, droneId: string | null = null): void {
    this.store.dispatch({ type: "logged", at: new Date().toISOString(), level, text, droneId });
  }

  /** Stop all drones; false, and an alarm, when the server accepted none of the attempts. */
  async stop(stop: Stop): Promise<boolean> {
    const word = STOP_WORD[stop];
    const startMs = performance.now();
    const accepted = await this.#carryOut(
      () => stopFleet(stop),
      (reason) => en.stop.failed(word, STOP_ATTEMPTS, reason),
    );
    if (!accepted) return false;
    if (stop === "hold") this.store.dispatch({ type: "hold_accepted", droneId: null });
    this.log("info", en.stop.logAccepted(word, Math.round(performance.now() - startMs)));
    return true;
  }

  /** Give one drone a command; false, and an alarm, when it was not carried out. */
  async command(droneId: string, command: DroneCommand): Promise<boolean> {
    const name = this.#nameOf(droneId);
    const word = command === "cut_motors" ? en.stop.cut.word : en.fly.command[command];
    const accepted = await this.#carryOut(
      () => commandDrone(droneId, command),
      (reason) => en.fly.command.failed(word, name, reason),
    );
    if (!accepted) return false;
    if (command === "hold") this.store.dispatch({ type: "hold_accepted", droneId });
    if (command === "takeoff" || command === "rearm") this.#command.take();
    this.log("info", en.fly.command.sent(word), droneId);
    return true;
  }

  /** Say where the object is in a drone's picture; false, and an alarm, when it was refused. */
  pickObject(droneId: string, place: Place): Promise<boolean> {
    return this.#carryOut(
      () => pickObject(droneId, place),
      (reason) => en.pick.failed(this.#nameOf(droneId), reason),
    );
  }

  /** Let a drone search the object by itself again; false, and an alarm, when it was refused. */
  searchObject(droneId: string): Promise<boolean> {
    return this.#carryOut(
      () => searchObject(droneId),
      (reason) => en.pick.failed(this.#nameOf(droneId), reason),
    );
  }

  /** Want better pictures of what a drawn box shows; false, and an alarm, when it was refused. */
  addPriority(droneId: string, box: ShareBox): Promise<boolean> {
    return this.#carryOut(() => addPriority(droneId, box), en.pick.priorityFailed);
  }

  /** Forget a part of priority; false, and an alarm, when it was refused. */
  dropPriority(partId: string): Promise<boolean> {
    return this.#carryOut(() => dropPriority(partId), en.pick.priorityFailed);
  }

  /** Begin a capture; false, and an alarm, when it did not start. */
  async startCapture(wish: CaptureRequest): Promise<boolean> {
    const accepted = await this.#carryOut(() => startCapture(wish), en.mission.form.failed);
    if (accepted) this.#command.take();
    return accepted;
  }

  /** Pause, resume or abort; false, and an alarm, when it was not carried out. */
  async changeCapture(captureId: string, verb: CaptureVerb): Promise<boolean> {
    const accepted = await this.#carryOut(
      () => changeCapture(captureId, verb),
      (reason) => en.mission.verbFailed(en.mission[verb], reason),
    );
    if (accepted && verb === "resume") this.#command.take();
    return accepted;
  }

  #nameOf(droneId: string): string {
    return this.store.get().drones.get(droneId)?.report.name ?? droneId;
  }

  async #carryOut(
    act: () => Promise<void>,
    failure: (reason: string) => string,
  ): Promise<boolean> {
    try {
      await act();
      return true;
    } catch (error) {
      if (!(error instanceof RequestError)) throw error;
      this.#alarm(failure(error.message));
      return false;
    }
  }

  #alarm(text: string): void {
    this.store.dispatch({ type: "alarm_raised", at: new Date().toISOString(), text });
  }

  /** A refused handshake looks to a browser like a lost line; an ordinary request tells them apart. */
  async #checkSignedIn(): Promise<void> {
    if (!(await isSignedIn())) this.store.dispatch({ type: "signed_out" });
  }
}
