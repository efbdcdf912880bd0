import type { MarkedArea } from "../floor/useFloorGesture";
import type { NoGoVolume } from "../protocol/messages.gen";
import { words } from "../text/words";

/** What people call a volume: its number is the end of its id. */
export function nameOf({ id, configured }: NoGoVolume): string {
  const number = id.slice(id.lastIndexOf("-") + 1);
  return configured ? words.noGo.nameConfigured(number) : words.noGo.name(number);
}

/** A volume as a floor plan shows it. */
export function markedArea(volume: NoGoVolume): MarkedArea {
  const [x0 = 0, y0 = 0, x1 = 0, y1 = 0] = volume.area;
  return { key: volume.id, area: [x0, y0, x1, y1], label: nameOf(volume), fixed: volume.configured };
}
