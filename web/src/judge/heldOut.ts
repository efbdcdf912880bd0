import type { Artifact } from "../api/library";

const RENDERING = /^held_out\/(\d+)\.jpg$/;

/** The numbers, from 0, of the pictures whose renderings a run has kept. */
export function keptRenderings(files: readonly Artifact[]): readonly number[] {
  return files
    .flatMap(({ path }) => {
      const number = RENDERING.exec(path)?.[1];
      return number === undefined ? [] : [Number(number)];
    })
    .sort((a, b) => a - b);
}

/** The file of a held-out picture's rendering. */
export function renderingFile(index: number): string {
  return `held_out/${String(index).padStart(4, "0")}.jpg`;
}
