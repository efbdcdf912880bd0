/** From no error to the largest that is told apart: dark, violet, orange, light yellow. */
const STOPS: readonly (readonly [number, number, number])[] = [
  [5, 8, 12],
  [87, 20, 109],
  [187, 55, 84],
  [249, 142, 8],
  [252, 254, 164],
];

/** Mean difference of the three channels, as a share of full scale, that is shown brightest. */
export const LARGEST_ERROR = 0.3;

/** The colour, red, green and blue 0 to 255, of a share of the largest error. */
export function errorColour(share: number): readonly [number, number, number] {
  const place = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const from = STOPS[Math.min(Math.floor(place), STOPS.length - 2)] ?? [0, 0, 0];
  const to = STOPS[Math.min(Math.floor(place) + 1, STOPS.length - 1)] ?? [0, 0, 0];
  const part = place - Math.min(Math.floor(place), STOPS.length - 2);
  const mix = (channel: 0 | 1 | 2) => Math.round(from[channel] + part * (to[channel] - from[channel]));
  return [mix(0), mix(1), mix(2)];
}

/** All colours in small steps, so that a picture of them takes milliseconds. */
const STEPS = 256;
const COLOURS = Array.from({ length: STEPS }, (_, step) => errorColour(step / (STEPS - 1)));

/**
 * Return where and by how much two pictures differ, as a picture.
 *
 * All three are red, green, blue and opacity by pixel, 0 to 255.
 *
 * @throws RangeError if the pictures are not of one size.
 */
export function errorMap(a: Uint8ClampedArray, b: Uint8ClampedArray): Uint8ClampedArray<ArrayBuffer> {
  if (a.length !== b.length) throw new RangeError("the pictures are not of one size");
  const map = new Uint8ClampedArray(a.length);
  const perStep = (3 * 255 * LARGEST_ERROR) / (STEPS - 1);
  for (let at = 0; at < a.length; at += 4) {
    const off = (channel: number) => Math.abs((a[at + channel] ?? 0) - (b[at + channel] ?? 0));
    const step = Math.min(STEPS - 1, Math.round((off(0) + off(1) + off(2)) / perStep));
    map.set(COLOURS[step] ?? [0, 0, 0], at);
    map[at + 3] = 255;
  }
  return map;
}
