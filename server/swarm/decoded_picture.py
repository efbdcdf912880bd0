"""Pictures as the decoder leaves them (YUV 4:2:0), converted to BGR as far as somebody needs it.

Most pictures are only searched and shown, both smaller than they were sent. Reducing the three
planes first costs a third to a half of converting them first.
"""

from __future__ import annotations

import threading

import av
import cv2
import numpy as np
from av.video.reformatter import Interpolation, VideoReformatter
from numpy.typing import NDArray

from server.stages import Picture

_PLANAR = "yuv420p"
_EXACT = Interpolation.AREA | Interpolation.FULL_CHR_H_INT
# Sizes in use at the same time: searched, shown.
_SIZES_KEPT = 4


class PictureConverter:
    """Converts the pictures of one stream; may be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # A reformatter prepares itself for one size, so each size has its own.
        self._reducing: dict[tuple[int, int], VideoReformatter] = {}

    def picture(self, decoded: av.VideoFrame) -> Picture | NDArray[np.uint8]:
        """Return ``decoded`` as a picture whose conversion cannot fail later.

        Raises:
            av.FFmpegError: If it is of a kind that cannot be converted at all.
        """
        even = decoded.width % 2 == 0 and decoded.height % 2 == 0
        if decoded.format.name == _PLANAR and even:
            return DecodedPicture(decoded, self)
        # No camera of ours sends another kind, but rubbish may announce anything.
        whole = decoded.reformat(format="bgr24", threads=1).to_ndarray()
        return np.ascontiguousarray(whole, np.uint8)

    def reduced_bgr(
        self, decoded: av.VideoFrame, width_px: int, height_px: int
    ) -> NDArray[np.uint8]:
        """Return the picture ``(height_px, width_px, 3)``, each pixel the mean of its area."""
        size = (width_px, height_px)
        # From half the size on, the colour planes have all the detail there is room for, and who
        # searches wants it. A picture to be shown may have its colours coarser, for a third.
        exact = 2 * width_px <= decoded.width
        with self._lock:
            if size not in self._reducing and len(self._reducing) >= _SIZES_KEPT:
                self._reducing.clear()
            reformatter = self._reducing.setdefault(size, VideoReformatter())
            reduced = reformatter.reformat(
                decoded,
                *size,
                "bgr24" if exact else _PLANAR,
                interpolation=_EXACT if exact else Interpolation.AREA,
                threads=1,
            )
        return reduced.to_ndarray().astype(np.uint8, copy=False) if exact else _bgr(reduced)


def _bgr(planes: av.VideoFrame) -> NDArray[np.uint8]:
    """Return planar YUV 4:2:0 as BGR ``(h, w, 3)``."""
    # Not by the reformatter: its result is a level too dark.
    converted = cv2.cvtColor(planes.to_ndarray(), cv2.COLOR_YUV2BGR_I420)
    return converted.astype(np.uint8, copy=False)


class DecodedPicture:
    """A ``Picture`` over a decoder's frame, planar YUV 4:2:0."""

    __slots__ = ("_bgr", "_converter", "_decoded")

    def __init__(self, decoded: av.VideoFrame, converter: PictureConverter) -> None:
        self._decoded = decoded
        self._converter = converter
        self._bgr: NDArray[np.uint8] | None = None

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self._decoded.width, self._decoded.height

    def bgr(self) -> NDArray[np.uint8]:
        """Return the whole picture ``(h, w, 3)``; converted at the first call."""
        if self._bgr is None:
            self._bgr = _bgr(self._decoded)
        return self._bgr

    def reduced_bgr(self, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """Return the picture ``(height_px, width_px, 3)``, both even, by means over areas."""
        return self._converter.reduced_bgr(self._decoded, width_px, height_px)
