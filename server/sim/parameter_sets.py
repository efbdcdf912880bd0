"""Makes the sequence parameter set of a software encoder look like a real drone's; pure.

A real drone's says nothing about how its pictures are to be shown (no VUI), so that decoders cannot
know from it that none is ever reordered. Clauses are those of ITU-T H.264.
"""

from __future__ import annotations

_PLAIN_PROFILES = (66, 77, 88)  # The others carry more fields before what is read here.


class _Bits:
    """Reads a raw byte sequence payload bit by bit."""

    def __init__(self, payload: bytes) -> None:
        self.at = 0
        self.text = "".join(f"{byte:08b}" for byte in payload)

    def take(self, count: int) -> int:
        """Return ``count`` bits as an unsigned number, clause 7.2 u(n)."""
        bits = self.text[self.at : self.at + count]
        if len(bits) < count:
            raise ValueError("the parameter set ends too early")
        self.at += count
        return int(bits, 2)

    def golomb(self) -> int:
        """Return an unsigned Exp-Golomb number, clause 9.1 ue(v)."""
        zeros = 0
        while self.take(1) == 0:
            zeros += 1
        return (1 << zeros) - 1 + (self.take(zeros) if zeros else 0)


def without_vui(unit: bytes) -> bytes:
    """Return a sequence parameter set without its video usability information.

    Args:
        unit: The NAL unit from its header on, without start code.

    Raises:
        ValueError: If it is no sequence parameter set of Baseline, Main or Extended profile.
    """
    # Clause 7.4.1: 00 00 03 stands for 00 00 wherever it is followed by 00 to 03.
    bits = _Bits(unit[1:].replace(b"\0\0\3", b"\0\0"))
    if unit[0] & 0x1F != 7 or bits.take(8) not in _PLAIN_PROFILES:
        raise ValueError("not a sequence parameter set of a plain profile")
    bits.take(16)  # Constraints and level.
    bits.golomb()  # Its number.
    bits.golomb()  # Length of picture numbers.
    order = bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        raise ValueError("picture order of type 1 is not read")
    bits.golomb()  # Reference pictures.
    bits.take(1)
    bits.golomb()  # Width and height in macroblocks.
    bits.golomb()
    if bits.take(1) == 0:
        bits.take(1)
    bits.take(1)
    if bits.take(1):
        for _ in range(4):
            bits.golomb()  # Cropping.
    kept = bits.text[: bits.at] + "0" + "1"  # No information; then the stop bit.
    kept += "0" * (-len(kept) % 8)
    payload = bytes(int(kept[i : i + 8], 2) for i in range(0, len(kept), 8))
    return unit[:1] + _escaped(payload)


def _escaped(payload: bytes) -> bytes:
    """Return the payload with emulation prevention bytes, clause 7.4.1."""
    out = bytearray()
    zeros = 0
    for byte in payload:
        if zeros >= 2 and byte <= 3:
            out.append(3)
            zeros = 0
        out.append(byte)
        zeros = zeros + 1 if byte == 0 else 0
    return bytes(out)
