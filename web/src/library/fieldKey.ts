import type { Training } from "../api/trainings";

/** Between capture and training; no id has it. */
const ANEW = "~";

/** What names a field trained anew in addresses and marks; a capture's own field is named by the capture's id. */
export function fieldKey({ capture, id }: Pick<Training, "capture" | "id">): string {
  return `${capture}${ANEW}${id}`;
}

/** The capture and the training, null for the capture's own field, that a key names. */
export function readFieldKey(key: string): { readonly capture: string; readonly training: string | null } {
  const [capture = "", training = ""] = key.split(ANEW);
  return { capture, training: training === "" ? null : training };
}
