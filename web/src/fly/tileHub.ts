import type { Tile } from "../protocol/tile";

/** Shows one drone's picture; settles when it is on the screen. */
type TileSink = (tile: Tile) => Promise<void>;

/**
 * Brings pictures to the tile that shows them, past React: twenty pictures a second and drone
 * would otherwise render the page eighty times a second.
 */
export class TileHub {
  readonly #sinks = new Map<string, TileSink>();
  readonly #listeners = new Set<() => void>();
  #outOfSight: ReadonlySet<string> = new Set();
  #watched: ReadonlySet<string> = new Set();

  /** Show `droneId`'s pictures through `sink`; returns the way back. */
  attach(droneId: string, sink: TileSink): () => void {
    this.#sinks.set(droneId, sink);
    this.#noteWatched();
    return () => {
      if (this.#sinks.get(droneId) !== sink) return;
      this.#sinks.delete(droneId);
      this.#noteWatched();
    };
  }

  /** Show a picture; one that nobody shows is done with at once. */
  async show(tile: Tile): Promise<void> {
    await this.#sinks.get(tile.header.drone_id)?.(tile);
  }

  /** The drones whose pictures some tile shows; the same object until that changes. */
  readonly watched = (): ReadonlySet<string> => this.#watched;

  /** The drones whose tile is scrolled out of sight; the same object until that changes. */
  readonly outOfSight = (): ReadonlySet<string> => this.#outOfSight;

  /** Say whether a drone's tile is in sight; one that says nothing is. */
  setInSight(droneId: string, inSight: boolean): void {
    if (inSight !== this.#outOfSight.has(droneId)) return;
    const next = new Set(this.#outOfSight);
    if (inSight) next.delete(droneId);
    else next.add(droneId);
    this.#outOfSight = next;
    this.#tell();
  }

  #noteWatched(): void {
    this.#watched = new Set(this.#sinks.keys());
    this.#tell();
  }

  #tell(): void {
    for (const changed of this.#listeners) changed();
  }

  /** Be told when a tile comes, goes, comes into sight or leaves it; returns the way back. */
  readonly subscribe = (changed: () => void): (() => void) => {
    this.#listeners.add(changed);
    return () => {
      this.#listeners.delete(changed);
    };
  };
}
