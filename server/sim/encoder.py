"""One drone's video: pictures to H.264 datagrams as a Tello sends them.

Main profile, no B-frames, one slice, one reference; SPS and PPS as datagrams of their own before
each key picture, then the picture in pieces of 1460 bytes of which the last is shorter.
"""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np
from av.video.frame import PictureType
from numpy.typing import NDArray

from server.sim.parameter_sets import without_vui

PIECE_BYTES = 1460
KEY_PERIOD_S = 1.0

_START = b"\0\0\1"
_SEQUENCE_SET = 7
_SENT_KINDS = (1, 5, 7, 8)  # Slices and parameter sets; the encoder's remarks stay here.


class VideoEncoder:
    """Encodes one stream; not shared between threads at the same time.

    Args:
        width: Of the pictures, pixels.
        height: Of the pictures, pixels.
        fps: Pictures per second the rate is meant for. A machine that renders fewer still
            spends no more on each, so that pictures are as large as a real drone's.
        bitrate_kbit_s: Upper bound of the rate, kbit/s.
    """

    def __init__(self, width: int, height: int, fps: float, bitrate_kbit_s: int) -> None:
        codec = av.CodecContext.create("libx264", "w")
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt = width, height, "yuv420p"
        codec.time_base = Fraction(1, 90000)
        codec.framerate = Fraction(fps).limit_denominator(100)
        codec.thread_count = 1
        codec.options = {
            "preset": "superfast",
            "tune": "zerolatency",
            "profile": "main",
            "crf": "21",
            "x264-params": (
                "level=4.0:bframes=0:ref=1:slices=1:sliced-threads=0:scenecut=0:repeat-headers=1:"
                f"keyint=infinite:vbv-maxrate={bitrate_kbit_s}:vbv-bufsize={bitrate_kbit_s // 2}"
            ),
        }
        self._codec = codec
        self._key_s = -1e9
        self._last_pts = -1

    def encode(self, image_bgr: NDArray[np.uint8], at_s: float, key: bool = False) -> list[bytes]:
        """Return the datagrams of one picture.

        Args:
            image_bgr: ``(height, width, 3)``.
            at_s: Its time in seconds, any zero; pictures come in order of time.
            key: True to make it a key picture whatever its turn.
        """
        picture = av.VideoFrame.from_ndarray(image_bgr, format="bgr24").reformat(format="yuv420p")
        self._last_pts = max(self._last_pts + 1, round(at_s * 90000))
        picture.pts = self._last_pts
        picture.time_base = self._codec.time_base
        if key or at_s - self._key_s >= KEY_PERIOD_S:
            picture.pict_type = PictureType.I
            self._key_s = at_s
        datagrams: list[bytes] = []
        for packet in self._codec.encode(picture):
            datagrams += datagrams_from_stream(bytes(packet))
        # Of the parameter sets, only the sequence's says more than a real drone's does.
        if datagrams and datagrams[0][4] & 0x1F == _SEQUENCE_SET:
            datagrams[0] = datagrams[0][:4] + without_vui(datagrams[0][4:])
        return datagrams


def datagrams_from_stream(stream: bytes) -> list[bytes]:
    """Cut Annex-B bytes into the datagrams a drone would send: every NAL unit starts a new one."""
    datagrams: list[bytes] = []
    at = stream.find(_START)
    while at >= 0:
        begin = at + len(_START)
        at = stream.find(_START, begin)
        unit = stream[begin : at if at >= 0 else len(stream)]
        if at >= 0:
            unit = unit.rstrip(b"\0")  # The zero byte of a four-byte start code that follows.
        if unit and unit[0] & 0x1F in _SENT_KINDS:
            whole = b"\0" + _START + unit
            datagrams += [whole[i : i + PIECE_BYTES] for i in range(0, len(whole), PIECE_BYTES)]
    return datagrams
