import type { Tile } from "../protocol/tile";

/** Shows one drone's picture; settles when it is on the screen. */
export type TileSink = (tile: Tile) => Promise<void>;

/**
 * Brings pictures to the tile that shows them, past React: twenty pictures a second and drone
 * would otherwise render the page eighty times a second.
 */
export class TileHub {
  readonly #sinks = new Map<string, TileSink>();

  /** Show `droneId`'s pictures through `sink`; returns the way back. */
  attach(droneId: string, sink: TileSink): () => void {
    this.#sinks.set(droneId, sink);
    return () => {
      if (this.#sinks.get(droneId) === sink) this.#sinks.delete(droneId);
    };
  }

  /** Show a picture; one that nobody shows is done with at once. */
  async show(tile: Tile): Promise<void> {
    await this.#sinks.get(tile.header.drone_id)?.(tile);
  }
}
