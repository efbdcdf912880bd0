"""Streams that change size or colour form in flight, as a command or rubbish may make them."""

from __future__ import annotations

import asyncio
from fractions import Fraction

import av
import numpy as np
import pytest
from av.video.frame import PictureType

from server.sim.encoder import datagrams_from_stream
from server.stages import Frame
from server.swarm.video import VideoDecoder

PICTURES = 4
FORMS = {
    "usual": (320, 240, "yuv420p", "main"),
    "larger": (640, 480, "yuv420p", "main"),
    "tiny": (16, 16, "yuv420p", "main"),
    "odd": (162, 122, "yuv420p", "main"),
    "full colour": (320, 240, "yuv444p", "high444"),
    "full range": (320, 240, "yuvj420p", "main"),
    "ten bits": (320, 240, "yuv420p10le", "high10"),
    "grey": (320, 240, "gray", "high"),
}


def group(form: str, shade: int) -> list[bytes]:
    """Return a key picture and some that follow, as datagrams."""
    width, height, colours, profile = FORMS[form]
    codec = av.CodecContext.create("libx264", "w")
    assert isinstance(codec, av.VideoCodecContext)
    codec.width, codec.height, codec.pix_fmt = width, height, colours
    codec.time_base = Fraction(1, 30)
    codec.thread_count = 1
    codec.options = {
        "preset": "ultrafast",
        "tune": "zerolatency",
        "profile": profile,
        "x264-params": "bframes=0:slices=1:repeat-headers=1:keyint=infinite",
    }
    found: list[bytes] = []
    for number in range(PICTURES):
        image = np.full((height, width, 3), shade, np.uint8)
        picture = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format=colours)
        picture.pts = number
        if number == 0:
            picture.pict_type = PictureType.I
        for packet in codec.encode(picture):
            found += datagrams_from_stream(bytes(packet))
    return found


def decoded(stream: list[bytes]) -> tuple[list[Frame], VideoDecoder]:
    frames: list[Frame] = []

    async def run() -> VideoDecoder:
        async with VideoDecoder("d", frames.append) as decoder:
            for number, datagram in enumerate(stream):
                decoder.feed(datagram, float(number))
                while decoder._waiting:  # noqa: ASYNC110 - The decoder is a thread.
                    await asyncio.sleep(0)
        await asyncio.sleep(0)
        return decoder

    decoder = asyncio.run(run())
    return frames, decoder


@pytest.mark.parametrize("form", FORMS)
def test_every_picture_that_comes_out_can_be_searched_shown_and_kept(form: str) -> None:
    frames, _ = decoded(group(form, 120))
    width, height, *_ = FORMS[form]
    assert len(frames) == PICTURES
    for frame in frames:
        assert not frame.damaged
        assert frame.size_px == (width, height)
        assert frame.image_bgr.shape == (height, width, 3)
        for size in ((640, 480), (240, 180)):
            reduced = frame.reduced_bgr(*size)
            assert reduced.shape == (size[1], size[0], 3)
            assert reduced.mean() == pytest.approx(120, abs=6)


def test_a_stream_may_change_its_form_at_a_key_picture() -> None:
    forms = ["usual", "larger", "full colour", "usual", "grey", "odd", "usual"]
    stream = [d for number, form in enumerate(forms) for d in group(form, 40 + 20 * number)]
    frames, decoder = decoded(stream)
    sizes = [FORMS[form][:2] for form in forms for _ in range(PICTURES)]
    assert [frame.size_px for frame in frames] == sizes
    assert decoder.errors == 0
    for place, frame in enumerate(frames):
        assert frame.reduced_bgr(80, 60).mean() == pytest.approx(40 + 20 * (place // 4), abs=6)


def test_pictures_that_lie_about_their_form_are_damaged_until_the_next_key_picture() -> None:
    """Parameter sets of one form before the pictures of another."""
    small, large = group("usual", 90), group("larger", 90)
    lying = large[:2] + small[2:]
    frames, _ = decoded([*small, *lying, *small])
    assert all(not frame.damaged for frame in frames[:PICTURES])
    assert all(frame.damaged for frame in frames[PICTURES:-PICTURES])
    healed = frames[-PICTURES:]
    assert [frame.size_px for frame in healed] == [(320, 240)] * PICTURES
    assert not any(frame.damaged for frame in healed)
    for frame in frames:
        assert frame.reduced_bgr(80, 60).shape == (60, 80, 3)
