"""From coded pictures to frames, one after the other; no threads, no clock."""

from __future__ import annotations

import logging

import av
from av.codec.context import Flags
from av.error import FFmpegError

from server.stages import CodedPicture, Frame
from server.swarm.access_units import AccessUnit
from server.swarm.decoded_picture import PictureConverter

_LOG = logging.getLogger(__name__)


class UnitDecoder:
    """Decodes the pictures of one drone; begins at the first key picture.

    Attributes:
        errors: Pictures that the decoder refused or patched up.
    """

    def __init__(self, drone_id: str) -> None:
        self.errors = 0
        self._drone_id = drone_id
        self._codec, self._converter = _open_codec(), PictureConverter()
        self._damaged = True
        self._running = False  # Until the first key picture there is nothing to decode.
        self._sequence = 0

    def decode(self, unit: AccessUnit) -> list[Frame]:
        """Return the frames of one coded picture, usually one; never raises for bad data."""
        if unit.key:
            self._running = True
            if unit.has_sets:
                # What a decoder keeps of a broken picture spoils even the next key picture,
                # unnoticed, and flushing does not help; a new one costs next to nothing.
                self._codec, self._damaged = _open_codec(), False
        if not self._running:
            return []
        self._damaged = self._damaged or unit.damaged
        try:
            decoded = self._codec.decode(av.Packet(unit.data))
            # Converting may fail, too: rubbish can announce any size and pixel format.
            pictures = [self._converter.picture(frame) for frame in decoded]
        except FFmpegError:
            self.errors += 1
            self._damaged = True
            return []
        except Exception:  # noqa: BLE001  # Whoever decodes outlives any one picture.
            _LOG.exception("%s: decoder failed, starts anew", self._drone_id)
            self._codec, self._running, self._damaged = _open_codec(), False, True
            return []
        if len(decoded) != 1 or any(frame.is_corrupt for frame in decoded):
            self.errors += 1
            self._damaged = True
        coded: tuple[CodedPicture, ...] = ()
        if len(pictures) == 1:
            coded = (CodedPicture(unit.data, unit.key and unit.has_sets, unit.number),)
        frames: list[Frame] = []
        for picture in pictures:
            frames.append(
                Frame(
                    self._drone_id,
                    self._sequence,
                    unit.captured_s,
                    picture,
                    self._damaged,
                    unit.completed_s,
                    coded,
                )
            )
            self._sequence += 1
        return frames


def _open_codec() -> av.VideoCodecContext:
    codec = av.CodecContext.create("h264", "r")
    assert isinstance(codec, av.VideoCodecContext)
    codec.thread_count = 1
    # Without this the decoder may hold pictures back: the drone's SPS does not bound reordering.
    codec.flags |= Flags.low_delay
    codec.options = {"err_detect": "crccheck+bitstream+buffer"}
    return codec
