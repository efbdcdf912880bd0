/** H.264 names of what a stream needs from its decoder; bytes are Annex B. */

const SEQUENCE_PARAMETERS = 7;

/**
 * The codec string (RFC 6381) that a key picture's own parameter set asks for, as `avc1.4D4028`;
 * null when it brings none.
 */
export function codecOf(data: Uint8Array): string | null {
  for (let at = 0; at + 6 < data.length; at++) {
    if (data[at] !== 0 || data[at + 1] !== 0 || data[at + 2] !== 1) continue;
    if (((data[at + 3] ?? 0) & 0x1f) !== SEQUENCE_PARAMETERS) continue;
    const hex = [...data.subarray(at + 4, at + 7)].map((byte) => byte.toString(16).padStart(2, "0"));
    return `avc1.${hex.join("").toUpperCase()}`;
  }
  return null;
}
