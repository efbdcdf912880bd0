/** Line drawings on a 16 by 16 grid, in the colour of the text around them. */
const PATHS = {
  hold: "M5.5 3.5v9 M10.5 3.5v9",
  land: "M8 2v8 M4.5 6.8 8 10.2l3.5-3.4 M3 13.5h10",
  cut: "M8 1.8v5 M4.6 4.2a5.4 5.4 0 1 0 6.8 0",
  takeoff: "M8 10.5v-8 M4.5 5.8 8 2.4l3.5 3.4 M3 13.5h10",
  rearm: "M13 8a5 5 0 1 1-1.6-3.7 M13.2 1.8v3h-3",
  fly: "M3.5 4.5h3 M9.5 4.5h3 M5 4.5v2.2h6V4.5 M6 6.7l-1 3.3h6l-1-3.3 M8 10v2",
  ground: "M2.5 12.5h11 M5 9.5h6 M6.5 9.5V7h3v2.5",
  offline: "M2.5 2.5l11 11 M4.8 8.6a4.6 4.6 0 0 1 2-1.1 M2.6 6.2a8 8 0 0 1 2.2-1.5 M8.2 4a8 8 0 0 1 5.2 2.2 M8 12.2h.01",
  play: "M5 3.2v9.6L12.5 8z",
  pause: "M5.5 3.5v9 M10.5 3.5v9",
  hand: "M4 9.2V5.4a1 1 0 0 1 2 0V3.2a1 1 0 0 1 2 0v-.6a1 1 0 0 1 2 0v1a1 1 0 0 1 2 0v6.2c0 2.6-1.6 4.4-4 4.4-1.8 0-2.8-.8-3.8-2.4L2.2 9.4a1 1 0 0 1 1.8-1z M6 5.4v2.4 M8 3.2v4.4 M10 3.4v4.2",
  land_all: "M4.5 1.8v6 M2 5.6l2.5 2.6L7 5.6 M11.5 1.8v6 M9 5.6l2.5 2.6L14 5.6 M1.5 13.5h13 M1.5 10.9h13",
  shield: "M8 1.8 13.4 4v3.8c0 3.2-2.2 5.4-5.4 6.4-3.2-1-5.4-3.2-5.4-6.4V4z",
  close: "M4 4l8 8 M12 4l-8 8",
  chevron: "M4 6l4 4 4-4",
  abort: "M4 4l8 8 M12 4l-8 8",
  check: "M3.2 8.4l3.2 3.2 6.4-7",
  info: "M8 7.4v4 M8 4.7h.01 M8 1.8a6.2 6.2 0 1 0 0 12.4A6.2 6.2 0 0 0 8 1.8",
  warning: "M8 2.2 14.4 13.4H1.6z M8 6.6v3.2 M8 11.6h.01",
  error: "M5.4 1.8h5.2l3.6 3.6v5.2l-3.6 3.6H5.4l-3.6-3.6V5.4z M8 4.8v4 M8 11h.01",
  battery: "M2 5h10v6H2z M13.8 7v2",
  target: "M8 2.6a5.4 5.4 0 1 0 0 10.8A5.4 5.4 0 0 0 8 2.6 M8 1v4 M8 11v4 M1 8h4 M11 8h4",
  star: "M8 2l1.8 3.9 4.2.5-3.1 2.9.8 4.2L8 11.4l-3.7 2.1.8-4.2L2 6.4l4.2-.5z",
  shrink: "M9.5 2.5v4h4 M6.5 13.5v-4h-4 M9.8 6.2l4-4 M6.2 9.8l-4 4",
  cube: "M8 1.8 13.6 5v6L8 14.2 2.4 11V5z M2.4 5 8 8.2 13.6 5 M8 8.2v6",
  picture: "M2 3h12v10H2z M2 11l3.5-3.5 3 3 2-2L14 11.5 M10.8 5.8h.01",
  gear: "M8 5.6a2.4 2.4 0 1 0 0 4.8 2.4 2.4 0 0 0 0-4.8 M8 1.8v2 M8 12.2v2 M1.8 8h2 M12.2 8h2 M3.6 3.6 5 5 M11 11l1.4 1.4 M12.4 3.6 11 5 M5 11l-1.4 1.4",
  download: "M8 2v7.5 M4.8 6.5 8 9.7l3.2-3.2 M2.5 11v2.5h11V11",
  trash: "M3 4.5h10 M6.2 4.5V2.8h3.6v1.7 M4.4 4.5l.7 9h5.8l.7-9 M6.8 7v4 M9.2 7v4",
  clock: "M8 1.8a6.2 6.2 0 1 0 0 12.4A6.2 6.2 0 0 0 8 1.8 M8 4.6V8l2.4 1.6",
  curve: "M2 2.5v11h12 M4.5 11c1.5-5 4-6 8.5-6.6",
  forward: "M8 13V3 M4 7l4-4 4 4",
  back: "M8 3v10 M4 9l4 4 4-4",
  left: "M13 8H3 M7 4 3 8l4 4",
  right: "M3 8h10 M9 4l4 4-4 4",
  up: "M8 12.5v-7 M4.5 8.6 8 5.2l3.5 3.4 M3 2.5h10",
  down: "M8 3.5v7 M4.5 7.4 8 10.8l3.5-3.4 M3 13.5h10",
  draw: "M3 13l.8-3.2L10.6 3 13 5.4l-6.8 6.8z M9 4.6 11.4 7",
  add: "M8 3v10 M3 8h10",
  turnLeft: "M3.2 8a5 5 0 1 0 1.6-3.7 M2.8 1.8v3h3",
  turnRight: "M12.8 8a5 5 0 1 1-1.6-3.7 M13.2 1.8v3h-3",
} as const;

export type IconName = keyof typeof PATHS;

/** A small drawing; it never stands without a word beside it, so it is silent for screen readers. */
export function Icon({ name }: { readonly name: IconName }) {
  return (
    <svg className="icon" viewBox="0 0 16 16" aria-hidden="true" focusable="false">
      <path d={PATHS[name]} />
    </svg>
  );
}
