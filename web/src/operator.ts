import {
  addPictures,
  changeCapture,
  isSignedIn,
  startCapture,
  viewField,
  type CaptureRequest,
  type CaptureVerb,
} from "./api/captures";
import { commandDrone, type DroneCommand } from "./api/drones";
import { cancelJob, startTraining, type TrainingWish } from "./api/jobs";
import { deleteCapture, starCapture } from "./api/library";
import { addNoGo, changeNoGo, dropNoGo } from "./api/noGo";
import { addPriority, dropPriority, pickObject, searchObject } from "./api/objects";
import { choosePlanView, type ShownPlan } from "./api/plans";
import { RequestError } from "./api/request";
import { scaleCapture, type KnownLengthWish, type ScaleFound } from "./api/scale";
import { stopFleet, STOP_ATTEMPTS, type Stop } from "./api/stops";
import { clientId } from "./api/tabId";
import { deleteTraining } from "./api/trainings";
import { Command, type CommandMemory } from "./command/command";
import { startWorkerPulse } from "./command/pulse";
import type { FloorArea } from "./floor/area";
import { anyFlying } from "./fly/activity";
import { TileHub } from "./fly/tileHub";
import type { Sticks } from "./manual/sticks";
import type { Place, ShareBox } from "./pick/box";
import type { FieldView } from "./reconstruct/fieldView";
import { ConsoleStream, streamUrl } from "./protocol/stream";
import type { Note } from "./protocol/messages.gen";
import { fliesByItself } from "./state/state";
import { Store } from "./state/store";
import { words } from "./text/words";
import { shouldDecode } from "./video/codedVideo";

/** The word on each stop's button. */
const STOP_WORD: Readonly<Record<Stop, string>> = {
  hold: words.stop.hold.word,
  land: words.stop.land.word,
  cut_motors: words.stop.cut.word,
};

/** What the page can do, and where its state lives: built once, handed down by context. */
export class Operator {
  readonly store = new Store();
  readonly tiles = new TileHub();
  readonly #page: Pick<Location, "search">;
  readonly #stream: ConsoleStream;
  readonly #command: Command;

  constructor(page: Pick<Location, "protocol" | "host" | "search">, memory: CommandMemory) {
    this.#page = page;
    this.#stream = new ConsoleStream(streamUrl(page), {
      onOpen: () => {
        // Logged first: what comes from here on is what was missed.
        this.log("info", words.log.opened);
        this.store.dispatch({ type: "stream_opened" });
        this.#command.beat();
      },
      onLost: (retryInMs) => {
        if (this.store.get().connection.kind === "open") this.log("warning", words.log.lost);
        this.store.dispatch({ type: "stream_lost", retryInMs });
        void this.#checkSignedIn();
      },
      onMessage: (message) => {
        this.store.dispatch(message);
        if (message.type === "command_changed" && message.holder !== null) {
          this.#followCommand(message.holder);
        }
      },
      onTile: (tile) => this.tiles.show(tile),
      onUnreadable: (reason) => {
        this.log("warning", words.log.unreadable(reason));
      },
    });
    this.#command = new Command(this.store, this.#stream, startWorkerPulse, memory);
  }

  start(): void {
    this.#stream.start();
    this.#command.restore();
    void shouldDecode(this.#page).then((should) => {
      if (should) this.#stream.codeTiles("h264");
    });
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
    if (this.#command.release()) this.log("warning", words.command.left);
    else this.#alarm(words.command.leaveFailed);
  }

  /** Be in command from now on; an alarm when the server could not be told. */
  takeCommand(): void {
    if (!this.#stream.takeCommand()) this.#alarm(words.command.noLine);
  }

  /** Ask the browser in command for it; an alarm when the server could not be told. */
  askCommand(): void {
    if (!this.#stream.askCommand()) this.#alarm(words.command.noLine);
  }

  /** Hand the command over to who asks for it, or keep it. */
  answerCommand(grant: boolean): void {
    if (!this.#stream.answerCommand(grant)) this.#alarm(words.command.noLine);
  }

  /** Have the pictures of these drones sent, and no others. */
  showVideo(droneIds: readonly string[]): void {
    this.#stream.showTiles(droneIds);
  }

  /** Have no more coded video sent: this browser cannot show it. */
  showPicturesOnly(): void {
    // Every tile may say so.
    if (this.#stream.codeTiles("jpeg")) this.log("warning", words.log.notDecoded);
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
      (reason) => words.stop.failed(word, STOP_ATTEMPTS, reason),
    );
    if (!accepted) return false;
    if (stop === "hold") this.store.dispatch({ type: "hold_accepted", droneId: null });
    this.log("info", words.stop.logAccepted(word, Math.round(performance.now() - startMs)));
    return true;
  }

  /** Give one drone a command; false, and an alarm, when it was not carried out. */
  async command(droneId: string, command: DroneCommand): Promise<boolean> {
    const name = this.#nameOf(droneId);
    const word = command === "cut_motors" ? words.stop.cut.word : words.fly.command[command];
    const accepted = await this.#carryOut(
      () => commandDrone(droneId, command),
      (reason) => words.fly.command.failed(word, name, reason),
    );
    if (!accepted) return false;
    if (command === "hold") this.store.dispatch({ type: "hold_accepted", droneId });
    if (command === "takeoff" || command === "rearm") this.#command.take();
    this.log("info", words.fly.command.sent(word), droneId);
    return true;
  }

  /** Say where the object is in a drone's picture; false, and an alarm, when it was refused. */
  pickObject(droneId: string, place: Place): Promise<boolean> {
    return this.#carryOut(
      () => pickObject(droneId, place),
      (reason) => words.pick.failed(this.#nameOf(droneId), reason),
    );
  }

  /** Let a drone search the object by itself again; false, and an alarm, when it was refused. */
  searchObject(droneId: string): Promise<boolean> {
    return this.#carryOut(
      () => searchObject(droneId),
      (reason) => words.pick.failed(this.#nameOf(droneId), reason),
    );
  }

  /** Want better pictures of what a drawn box shows; false, and an alarm, when it was refused. */
  addPriority(droneId: string, box: ShareBox): Promise<boolean> {
    return this.#carryOut(() => addPriority(droneId, box), words.pick.priorityFailed);
  }

  /** Forget a part of priority; false, and an alarm, when it was refused. */
  dropPriority(partId: string): Promise<boolean> {
    return this.#carryOut(() => dropPriority(partId), words.pick.priorityFailed);
  }

  /** Let no drone enter a column of the room; false, and an alarm, when it was refused. */
  addNoGo(area: FloorArea): Promise<boolean> {
    return this.#carryOut(() => addNoGo(area), words.noGo.failed);
  }

  /** Give a volume another place; false, and an alarm, when it was refused. */
  changeNoGo(id: string, area: FloorArea): Promise<boolean> {
    return this.#carryOut(() => changeNoGo(id, area), words.noGo.failed);
  }

  /** Forget a volume; false, and an alarm, when it was refused. */
  dropNoGo(id: string): Promise<boolean> {
    return this.#carryOut(() => dropNoGo(id), words.noGo.failed);
  }

  /** Choose what the 3D scene shows, for everybody; false, and an alarm, when it was refused. */
  choosePlanView(shown: ShownPlan): Promise<boolean> {
    return this.#carryOut(() => choosePlanView(shown), words.plan.viewFailed);
  }

  /** Keep a capture, or no longer; false, and an alarm, when it was refused. */
  async starCapture(captureId: string, starred: boolean): Promise<boolean> {
    return this.#carryOut(
      () => starCapture(captureId, starred),
      (reason) => words.library.starFailed(captureId, reason),
    );
  }

  /** Delete a capture and its files; false, and an alarm, when it was refused. */
  async deleteCapture(captureId: string): Promise<boolean> {
    const done = await this.#carryOut(
      () => deleteCapture(captureId),
      (reason) => words.library.deleteFailed(captureId, reason),
    );
    if (done) this.log("info", words.library.deleted(captureId));
    return done;
  }

  /** Delete a field trained anew and its files; false, and an alarm, when it was refused. */
  async deleteTraining(captureId: string, trainingId: string): Promise<boolean> {
    const done = await this.#carryOut(
      () => deleteTraining(captureId, trainingId),
      (reason) => words.library.deleteFailed(trainingId, reason),
    );
    if (done) this.log("info", words.library.deleted(trainingId));
    return done;
  }

  /** Begin a capture; false, and an alarm, when it did not start. */
  async startCapture(wish: CaptureRequest): Promise<boolean> {
    const accepted = await this.#carryOut(() => startCapture(wish), words.mission.form.failed);
    if (accepted) this.#command.take();
    return accepted;
  }

  /** Pause, resume or abort; false, and an alarm, when it was not carried out. */
  async changeCapture(captureId: string, verb: CaptureVerb): Promise<boolean> {
    const accepted = await this.#carryOut(
      () => changeCapture(captureId, verb),
      (reason) => words.mission.verbFailed(words.mission[verb], reason),
    );
    if (accepted && verb === "resume") this.#command.take();
    return accepted;
  }

  /** Train anew on a capture's pictures; false, and an alarm, when it was refused. */
  async trainAnew(wish: TrainingWish): Promise<boolean> {
    return this.#carryOut(
      () => startTraining(wish),
      (reason) => words.retrain.failed(reason),
    );
  }

  /** Set a capture's scale by a known length; null, and an alarm, when it was refused. */
  async scaleCapture(captureId: string, wish: KnownLengthWish): Promise<ScaleFound | null> {
    let found: ScaleFound | null = null;
    await this.#carryOut(
      async () => {
        found = await scaleCapture(captureId, wish);
      },
      (reason) => words.scale.failed(reason),
    );
    return found;
  }

  /** End a job; false, and an alarm, when it was not carried out. */
  async cancelJob(jobId: string): Promise<boolean> {
    return this.#carryOut(
      () => cancelJob(jobId),
      (reason) => words.retrain.cancelFailed(reason),
    );
  }

  /** See the field from `view`, null: from the orbit; a line in the log when it was refused. */
  async viewField(captureId: string, view: FieldView | null): Promise<void> {
    try {
      await viewField(captureId, view);
    } catch (error) {
      // Turned at the moment when the training ends: nothing to be alarmed about.
      if (!(error instanceof RequestError)) throw error;
      this.log("warning", words.field.viewFailed(error.message));
    }
  }

  /** Push a drone's sticks; lost with the line, as it should be. */
  steer(droneId: string, sticks: Sticks): void {
    if (this.store.get().command.holder === clientId) this.#stream.steer(droneId, sticks);
  }

  /** Have more pictures taken than was asked for; an alarm when it was refused. */
  async addPictures(captureId: string, count: number): Promise<boolean> {
    const accepted = await this.#carryOut(
      () => addPictures(captureId, count),
      (reason) => words.plan.more.failed(reason),
    );
    if (accepted) this.#command.take();
    return accepted;
  }

  #followCommand(holder: string): void {
    const turn = this.#command.follow(holder === clientId);
    if (turn === "came") this.log("info", words.command.came);
    if (turn === "went") this.log("warning", words.command.went);
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
