"""Draws what the cameras of a flown capture saw, through the drone's own video coding."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext
from numpy.typing import NDArray

from server.bench.poses_flight import FlownCapture
from server.nerf.flight import read_pictures
from server.sim.camera import SimulatedCamera, canvas_intrinsics
from server.sim.encoder import VideoEncoder
from server.sim.scenes.catalogue import load_object
from server.sim.scenes.surroundings import ORDINARY, Surroundings
from server.sim.world import World

Image = NDArray[np.uint8]

_SUPERSAMPLE = 2
_FPS = 30.0
_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 95]


def draw_pictures(capture: FlownCapture, surroundings: Surroundings = ORDINARY) -> None:
    """Write every picture of ``capture`` into its run folder.

    Args:
        capture: A flight.
        surroundings: The room it flew in.
    """
    sim = capture.sim
    pictures = read_pictures(capture.run)
    cameras = {sim.drone_id(i): SimulatedCamera(sim.camera, sim.seed, i) for i in range(sim.drones)}
    coders: dict[str, _Coder] = {}
    world = World(
        load_object(sim.scene),
        intrinsics=canvas_intrinsics(sim.camera),
        supersample=_SUPERSAMPLE,
        seed=sim.seed,
        surroundings=surroundings,
    )
    try:
        for picture, view in zip(pictures, capture.truth, strict=True):
            drawn = world.render(view.T_world_cam, view.others)
            image = cameras[picture.drone_id].take(drawn, view.motion, picture.at_s)
            coder = coders.setdefault(picture.drone_id, _Coder(image, sim.bitrate_kbit_s))
            _write(capture.run / picture.file, coder.code(image, picture.at_s))
    finally:
        world.close()


def _write(file: Path, image_bgr: Image) -> None:
    if not cv2.imwrite(str(file), image_bgr, _QUALITY):
        raise OSError(f"cannot write {file}")


class _Coder:
    """One drone's encoder and a decoder behind it.

    Kept pictures are seconds apart, and a picture of a stream is coded from the one before it:
    each is sent twice, as a key picture and then as the difference to it.
    """

    def __init__(self, image: Image, bitrate_kbit_s: int) -> None:
        height, width = image.shape[:2]
        self._encoder = VideoEncoder(width, height, _FPS, bitrate_kbit_s)
        decoder = av.CodecContext.create("h264", "r")
        assert isinstance(decoder, VideoCodecContext)
        decoder.thread_count = 1
        self._decoder = decoder

    def code(self, image_bgr: Image, at_s: float) -> Image:
        """Return the picture as it arrives."""
        for behind_s, key in ((0.0, True), (1.0 / _FPS, False)):
            datagrams = self._encoder.encode(image_bgr, at_s + behind_s, key)
            frames = self._decoder.decode(av.Packet(b"".join(datagrams)))
        frames = frames or self._decoder.decode(None)
        return np.ascontiguousarray(frames[-1].to_ndarray(format="bgr24"), np.uint8)
