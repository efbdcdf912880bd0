"""From video datagrams to whole H.264 pictures; no I/O, no clock.

The drone sends a raw Annex-B stream in pieces of at most 1460 bytes, without header or sequence
number: SPS and PPS in datagrams of their own, then the picture (one slice), whose last piece is
shorter. A picture therefore ends at a short piece or, when its size happens to be a multiple of
the piece size, at the next start code.

Losses show only indirectly: a piece that continues nothing, a picture without a short end, a jump
of ``frame_num`` (H.264 section 7.4.3), parameter sets that no key picture follows. Each makes the
pictures up to the next key picture damaged. A piece that comes twice is known by its bytes and
dropped. What is lost or swapped inside a picture is the decoder's to find, and it cannot find all:
what follows the gap may happen to decode, mostly near the picture's lower edge.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

PIECE_BYTES = 1460

_START = b"\0\0\1"
_SLICE, _KEY_SLICE, _SPS, _PPS = 1, 5, 7, 8
# Profiles whose SPS holds the frame number's width right behind its id.
_SIMPLE_PROFILES = (66, 77, 88)
# Coded pictures hold no piece of at least so many bytes twice; a copy comes soon if at all.
_UNMISTAKABLE_BYTES = 200
_PIECES_KEPT = 64
# No picture of a drone is near this size; more means that the stream makes no sense.
_LARGEST_PICTURE_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class AccessUnit:
    """One coded picture.

    Attributes:
        data: Annex-B bytes, parameter sets included where they came before it.
        captured_s: When its first datagram arrived.
        completed_s: When its last datagram arrived.
        key: True when it can be decoded without any other picture.
        has_sets: True when both parameter sets came along.
        damaged: True when data is known or suspected to be lost since the last key picture.
        number: Counts the pictures of this drone as they are assembled here: whoever passes them on
            sees what was left out since. What was lost on the air shows in ``damaged``.
    """

    data: bytes
    captured_s: float
    completed_s: float
    key: bool
    has_sets: bool
    damaged: bool
    number: int = 0


class _Bits:
    """Reads the first bits of a NAL unit's payload."""

    def __init__(self, payload: bytes) -> None:
        plain = payload.replace(b"\0\0\3", b"\0\0")  # Emulation prevention.
        self._value = int.from_bytes(plain)
        self._left = 8 * len(plain)

    def fixed(self, count: int) -> int:
        if count > self._left:
            raise ValueError("NAL unit ends too early")
        self._left -= count
        return (self._value >> self._left) & ((1 << count) - 1)

    def exp_golomb(self) -> int:
        zeros = 0
        while self.fixed(1) == 0:
            zeros += 1
            if zeros > 31:
                raise ValueError("number too long")
        return (1 << zeros) - 1 + self.fixed(zeros)


def _frame_num_bits(sps: bytes) -> int | None:
    """Return the width of ``frame_num``, or None when this SPS does not tell it simply."""
    try:
        bits = _Bits(sps[1:32])
        profile = bits.fixed(8)
        bits.fixed(16)
        bits.exp_golomb()
        width = bits.exp_golomb() + 4
    except ValueError:
        return None
    return width if profile in _SIMPLE_PROFILES and width <= 16 else None


def _frame_num(slice_nal: bytes, width: int) -> int | None:
    try:
        bits = _Bits(slice_nal[1:24])
        for _ in range(3):  # First macroblock, slice type, picture parameter set.
            bits.exp_golomb()
        return bits.fixed(width)
    except ValueError:
        return None


class AccessUnits:
    """Assembles the pictures of one drone's stream.

    Attributes:
        orphans: Datagrams dropped because they continue nothing.
        repeated: Datagrams dropped because they came twice.
    """

    def __init__(self) -> None:
        self.orphans = 0
        self.repeated = 0
        self._count = 0
        self._lately: deque[bytes] = deque(maxlen=_PIECES_KEPT)
        self._buffer = bytearray()
        self._captured_s = self._newest_s = 0.0
        self._has_slice = False
        self._damaged = True  # Nothing is whole before the first key picture.
        self._width: int | None = None
        self._reference: int | None = None

    def feed(self, datagram: bytes, arrived_s: float) -> list[AccessUnit]:
        """Take one datagram and return the pictures it completes: none, one or rarely two."""
        done: list[AccessUnit] = []
        if len(datagram) >= _UNMISTAKABLE_BYTES:
            if datagram in self._lately:
                self.repeated += 1
                return done
            self._lately.append(datagram)
        begins = datagram.startswith((_START, b"\0" + _START))
        if begins and self._has_slice:
            # The picture before had no short end: a lost end, or just the multiple of the size.
            self._suspect()
            done.append(self._finish())
        if not begins and not self._buffer:
            self.orphans += 1
            self._suspect()
            return done
        if not self._buffer:
            self._captured_s = arrived_s
        self._buffer += datagram
        self._newest_s = arrived_s
        if begins:
            self._has_slice = self._nal_type(datagram) in (_SLICE, _KEY_SLICE)
        elif not self._has_slice:
            # A continuation of parameter sets does not exist: a picture's head was lost.
            self.orphans += 1
            self._suspect()
            self._buffer.clear()
            return done
        if self._has_slice and len(datagram) < PIECE_BYTES:
            done.append(self._finish())
        elif len(self._buffer) > _LARGEST_PICTURE_BYTES:
            self._suspect()
            self._buffer.clear()
            self._has_slice = False
        return done

    def lost(self) -> None:
        """Note from outside that pictures were lost: all is damaged until the next key picture."""
        self._suspect()

    @staticmethod
    def _nal_type(data: bytes) -> int:
        at = data.find(_START) + len(_START)
        return data[at] & 0x1F if at < len(data) else 0

    def _suspect(self) -> None:
        self._damaged = True

    def _finish(self) -> AccessUnit:
        data = bytes(self._buffer)
        self._buffer.clear()
        self._has_slice = False
        kinds: set[int] = set()
        number, is_reference = None, True
        for nal in _nal_units(data):
            kind = nal[0] & 0x1F
            kinds.add(kind)
            if kind == _SPS:
                self._width = _frame_num_bits(nal)
            elif kind in (_SLICE, _KEY_SLICE):
                is_reference = bool(nal[0] & 0x60)
                number = _frame_num(nal, self._width) if self._width is not None else None
        key = _KEY_SLICE in kinds
        if key:
            # A suspicion about this very picture was noted before it was finished: keep that.
            self._damaged = self._ends_suspiciously(data)
        else:
            if _SPS in kinds:
                self._suspect()
            self._check_frame_num(number)
        if is_reference:
            self._reference = number
        has_sets = {_SPS, _PPS} <= kinds
        self._count += 1
        return AccessUnit(
            data, self._captured_s, self._newest_s, key, has_sets, self._damaged, self._count
        )

    @staticmethod
    def _ends_suspiciously(data: bytes) -> bool:
        starts = data.rfind(_START)
        # The slice's own datagrams begin at its start code, with or without a fourth zero byte.
        begin = starts - 1 if starts > 0 and data[starts - 1] == 0 else starts
        return (len(data) - begin) % PIECE_BYTES == 0

    def _check_frame_num(self, number: int | None) -> None:
        if number is None or self._reference is None or self._width is None:
            return
        if number != (self._reference + 1) % (1 << self._width):
            self._suspect()


def _nal_units(data: bytes) -> list[bytes]:
    units: list[bytes] = []
    at = data.find(_START)
    while at >= 0:
        begin = at + len(_START)
        at = data.find(_START, begin)
        unit = data[begin : at if at >= 0 else len(data)].rstrip(b"\0") if at >= 0 else data[begin:]
        if unit:
            units.append(unit)
    return units


def parameter_sets(data: bytes) -> bytes:
    """Return the parameter sets in Annex-B bytes, as such again."""
    found = (nal for nal in _nal_units(data) if nal[0] & 0x1F in (_SPS, _PPS))
    return b"".join(b"\0" + _START + nal for nal in found)
