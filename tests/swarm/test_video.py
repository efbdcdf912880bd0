"""Real H.264, cut into datagrams as a drone does, and then mistreated.

The measure is always the same stream without losses: a picture that is not called damaged must be
exactly the picture of that place in the whole stream.
"""

from __future__ import annotations

import asyncio
from fractions import Fraction
from functools import cache

import av
import numpy as np
import pytest
from av.video.frame import PictureType
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from server.stages import Frame
from server.swarm.access_units import PIECE_BYTES, AccessUnit, AccessUnits
from server.swarm.video import VideoDecoder

WIDTH, HEIGHT = 320, 240
PICTURES, KEY_EVERY = 24, 8
START = b"\0\0\0\1"


def picture(number: int) -> np.ndarray:
    """A grey texture that moves and flickers, so that every P picture matters."""
    texture = np.random.default_rng(7).integers(0, 200, (HEIGHT // 4, WIDTH // 4))
    moved = np.roll(texture.repeat(4, 0).repeat(4, 1), (3 * number, 5 * number), (0, 1))
    flicker = np.random.default_rng(number).integers(0, 50, (HEIGHT // 4, WIDTH // 4))
    grey = moved + flicker.repeat(4, 0).repeat(4, 1)
    return np.repeat(grey[:, :, None], 3, axis=2).astype(np.uint8)


def nal_units(stream: bytes) -> list[bytes]:
    return [unit.rstrip(b"\0") for unit in stream.split(b"\0\0\1")[1:]]


@cache
def coded_pictures() -> tuple[tuple[bytes, ...], ...]:
    """Per picture its NAL units (parameter sets, one slice), start codes included."""
    codec = av.CodecContext.create("libx264", "w")
    assert isinstance(codec, av.VideoCodecContext)
    codec.width, codec.height, codec.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    codec.time_base = Fraction(1, 30)
    codec.thread_count = 1
    codec.options = {
        "preset": "ultrafast",
        "tune": "zerolatency",
        "profile": "main",
        "crf": "18",
        "x264-params": (
            "cabac=1:bframes=0:ref=1:slices=1:scenecut=0:repeat-headers=1:keyint=infinite"
        ),
    }
    coded: list[tuple[bytes, ...]] = []
    for number in range(PICTURES):
        frame = av.VideoFrame.from_ndarray(picture(number), format="bgr24").reformat(
            format="yuv420p"
        )
        frame.pts = number
        if number % KEY_EVERY == 0:
            frame.pict_type = PictureType.I
        stream = b"".join(bytes(packet) for packet in codec.encode(frame))
        coded.append(
            tuple(START + unit for unit in nal_units(stream) if unit[0] & 0x1F in (1, 5, 7, 8))
        )
    assert len(coded) == PICTURES
    assert all(len(units) == (3 if n % KEY_EVERY == 0 else 1) for n, units in enumerate(coded))
    return tuple(coded)


def pieces(unit: bytes) -> list[bytes]:
    return [unit[at : at + PIECE_BYTES] for at in range(0, len(unit), PIECE_BYTES)]


@cache
def datagrams() -> tuple[tuple[bytes, int], ...]:
    """The stream as a drone sends it: datagrams with the number of their picture."""
    return tuple(
        (piece, number)
        for number, units in enumerate(coded_pictures())
        for unit in units
        for piece in pieces(unit)
    )


def decoded(stream: list[tuple[bytes, float]]) -> tuple[list[Frame], VideoDecoder]:
    """Feed datagrams with their times and return the pictures that come out."""
    frames: list[Frame] = []

    async def run() -> VideoDecoder:
        async with VideoDecoder("d", frames.append) as decoder:
            for datagram, at_s in stream:
                decoder.feed(datagram, at_s)
                while decoder._waiting:  # noqa: ASYNC110 - The backlog is another test's matter.
                    await asyncio.sleep(0)
        await asyncio.sleep(0)
        return decoder

    decoder = asyncio.run(run())
    return frames, decoder


@cache
def whole_stream() -> tuple[np.ndarray, ...]:
    frames, _ = decoded([(datagram, float(number)) for datagram, number in datagrams()])
    return tuple(frame.image_bgr for frame in frames)


def assert_undamaged_are_true(frames: list[Frame]) -> None:
    for frame in frames:
        if not frame.damaged:
            truth = whole_stream()[int(frame.captured_s)]
            assert np.array_equal(frame.image_bgr, truth), f"picture {frame.captured_s} is wrong"


def test_the_test_stream_is_worth_it() -> None:
    sizes = [sum(map(len, units)) for units in coded_pictures()]
    assert min(sizes) > 2 * PIECE_BYTES, "every picture spans several datagrams"


def test_all_pictures_arrive_in_order_undamaged_and_right() -> None:
    frames, decoder = decoded([(datagram, float(number)) for datagram, number in datagrams()])
    assert [frame.captured_s for frame in frames] == list(range(PICTURES))
    assert [frame.sequence for frame in frames] == list(range(PICTURES))
    assert not any(frame.damaged for frame in frames)
    assert decoder.errors == 0
    for number, frame in enumerate(frames):
        assert frame.image_bgr.shape == (HEIGHT, WIDTH, 3)
        assert frame.drone_id == "d"
        error = frame.image_bgr.astype(float) - picture(number)
        assert np.sqrt((error**2).mean()) < 20


def test_pictures_before_the_first_key_picture_are_not_shown() -> None:
    stream = [(datagram, float(number)) for datagram, number in datagrams() if number >= 3]
    frames, _ = decoded(stream)
    assert frames[0].captured_s == KEY_EVERY
    assert not frames[0].damaged


def test_the_first_picture_comes_with_the_last_piece_of_a_key_picture() -> None:
    """It waits for nothing that follows."""
    stream = [(datagram, 5.0 + at / 100) for at, (datagram, n) in enumerate(datagrams()) if n == 0]
    assert decoded(stream[:-1])[0] == []
    frames, _ = decoded(stream)
    assert len(frames) == 1
    assert not frames[0].damaged
    assert frames[0].captured_s == 5.0, "the time of its first datagram"


def without(lost: set[int]) -> list[Frame]:
    """The pictures of the stream without the datagrams at these places."""
    kept = [(d, float(n)) for at, (d, n) in enumerate(datagrams()) if at not in lost]
    return decoded(kept)[0]


def places(number: int) -> list[int]:
    """Where in the stream the datagrams of a picture are, parameter sets included."""
    return [at for at, (_, n) in enumerate(datagrams()) if n == number]


LOSSES = {
    "SPS": {places(KEY_EVERY)[0]},
    "PPS": {places(KEY_EVERY)[1]},
    "head of a key picture": {places(KEY_EVERY)[2]},
    "end of a key picture": {places(KEY_EVERY)[-1]},
    "a key picture": set(places(KEY_EVERY)),
    "head of a picture": {places(KEY_EVERY + 3)[0]},
    "end of a picture": {places(KEY_EVERY + 3)[-1]},
    "a picture": set(places(KEY_EVERY + 3)),
    "two pictures": {*places(KEY_EVERY + 3), *places(KEY_EVERY + 4)},
}


@pytest.mark.parametrize("loss", LOSSES)
def test_a_loss_marks_damage_until_the_next_key_picture(loss: str) -> None:
    first = datagrams()[min(LOSSES[loss])][1]
    frames = without(LOSSES[loss])
    assert_undamaged_are_true(frames)
    after = [frame for frame in frames if first < frame.captured_s < 2 * KEY_EVERY]
    if loss not in ("SPS", "PPS"):  # These are repeated and rarely missed.
        assert all(frame.damaged for frame in after), "what follows is built on the loss"
    healed = [frame for frame in frames if frame.captured_s >= 2 * KEY_EVERY]
    assert [frame.captured_s for frame in healed] == list(range(2 * KEY_EVERY, PICTURES))
    assert not any(frame.damaged for frame in healed)


@pytest.mark.slow
def test_a_loss_inside_a_picture_is_mostly_noticed_and_heals_at_the_next_key_picture() -> None:
    """The bytes after a gap may happen to decode: no stream without numbers can tell them all.

    This stream is a hard case: few blocks follow a gap, and its noise looks like rubbish anyway.
    """
    inner = [at for number in range(KEY_EVERY) for at in places(number)[:-1][-6:] if at > 2]
    unnoticed = 0
    for lost in inner:
        frames = without({lost})
        healed = [frame for frame in frames if frame.captured_s >= KEY_EVERY]
        assert not any(frame.damaged for frame in healed)
        assert_undamaged_are_true(healed)
        assert len(healed) == PICTURES - KEY_EVERY
        unnoticed += not any(frame.damaged for frame in frames)
    assert unnoticed <= 0.35 * len(inner)


@pytest.mark.slow
def test_pieces_swapped_inside_a_picture_are_mostly_noticed() -> None:
    swaps = unnoticed = 0
    for number in range(KEY_EVERY):
        for at in places(number)[-6:-2]:
            stream = [(datagram, float(n)) for datagram, n in datagrams()]
            if at < 3 or len(stream[at + 1][0]) < PIECE_BYTES:
                continue
            stream[at], stream[at + 1] = stream[at + 1], stream[at]
            frames, _ = decoded(stream)
            swaps += 1
            unnoticed += not any(frame.damaged for frame in frames)
            assert_undamaged_are_true([f for f in frames if f.captured_s >= KEY_EVERY])
    assert swaps > 15
    assert unnoticed <= 0.45 * swaps


def test_a_datagram_that_comes_twice_does_no_harm() -> None:
    """Right away, or after a few others."""
    stream: list[tuple[bytes, float]] = []
    for at, (datagram, number) in enumerate(datagrams()):
        stream.append((datagram, float(number)))
        late = at - 3 * (at % 2)
        again = datagrams()[max(0, late)][0]
        if len(again) > 200 and at % 5 == 0:
            stream.append((again, float(number)))
    assert len(stream) > len(datagrams()) + 20
    frames, decoder = decoded(stream)
    assert decoder._units.repeated == len(stream) - len(datagrams())
    assert [frame.captured_s for frame in frames] == list(range(PICTURES))
    assert not any(frame.damaged for frame in frames)
    assert_undamaged_are_true(frames)


def test_a_datagram_held_back_past_its_picture_marks_damage() -> None:
    at = places(3)[1]
    stream = [(datagram, float(number)) for datagram, number in datagrams()]
    late = stream.pop(at)
    stream.insert(places(4)[0] + 1, late)
    frames, _ = decoded(stream)
    assert all(frame.damaged for frame in frames if 4 <= frame.captured_s < KEY_EVERY)
    assert_undamaged_are_true([f for f in frames if f.captured_s >= KEY_EVERY])


@pytest.mark.slow
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.randoms(use_true_random=False), st.sampled_from([0.01, 0.1, 0.5]))
def test_no_mistreatment_raises_and_the_next_whole_key_picture_heals(
    random: object, share: float
) -> None:
    """Losses, copies, swaps, cuts and rubbish in the first two groups; the third arrives whole."""
    assert hasattr(random, "random")
    rng = np.random.default_rng(random.getrandbits(32))  # pyright: ignore[reportAttributeAccessIssue]
    stream: list[tuple[bytes, float]] = []
    for datagram, number in datagrams():
        if number >= 2 * KEY_EVERY or rng.random() > share:
            stream.append((datagram, float(number)))
            continue
        match rng.integers(5):
            case 0:
                pass
            case 1:
                stream += [(datagram, float(number))] * 2
            case 2:
                stream.insert(max(0, len(stream) - 1), (datagram, float(number)))
            case 3:
                stream.append((datagram[: rng.integers(len(datagram))], float(number)))
            case _:
                damaged = bytearray(datagram)
                damaged[rng.integers(len(damaged))] ^= int(rng.integers(1, 256))
                stream.append((bytes(damaged), float(number)))
                stream.append((rng.bytes(int(rng.integers(1, PIECE_BYTES + 1))), float(number)))
    frames, _ = decoded(stream)
    last = [frame for frame in frames if frame.captured_s >= 2 * KEY_EVERY]
    assert not any(frame.damaged for frame in last[-KEY_EVERY + 1 :])
    assert last[-1].captured_s == PICTURES - 1
    assert_undamaged_are_true(last[-KEY_EVERY + 1 :])


@settings(max_examples=150, deadline=None)
@given(st.lists(st.binary(max_size=60), max_size=30), st.booleans())
def test_assembling_survives_any_bytes(noise: list[bytes], start_codes: bool) -> None:
    units = AccessUnits()
    for number, datagram in enumerate(noise):
        for unit in units.feed(START + datagram if start_codes else datagram, float(number)):
            assert unit.data
    group = assembled(KEY_EVERY, 2 * KEY_EVERY, units)
    assert group[-1].captured_s == 2 * KEY_EVERY - 1
    assert not group[-1].damaged
    assert group[-1].data == coded_pictures()[2 * KEY_EVERY - 1][0]


def assembled(begin: int, end: int, units: AccessUnits) -> list[AccessUnit]:
    done: list[AccessUnit] = []
    for datagram, number in datagrams():
        if begin <= number < end:
            done += units.feed(datagram, float(number))
    return done


def grown_to_whole_pieces(unit: bytes) -> bytes:
    """A slice followed by zero bytes (allowed after any NAL unit) up to a multiple of a piece."""
    return unit + bytes(-len(unit) % PIECE_BYTES)


@pytest.mark.parametrize("number", [KEY_EVERY + 2, KEY_EVERY])
def test_a_picture_of_whole_pieces_is_not_glued_to_the_next(number: int) -> None:
    """Its end shows only at the next start code; nobody can tell that nothing was lost."""
    stream: list[tuple[bytes, float]] = []
    for at, units in enumerate(coded_pictures()):
        *sets, last = units
        if at == number:
            last = grown_to_whole_pieces(last)
        stream += [(piece, float(at)) for unit in (*sets, last) for piece in pieces(unit)]
    frames, _ = decoded(stream)
    assert [frame.captured_s for frame in frames] == list(range(PICTURES))
    for frame, truth in zip(frames, whole_stream(), strict=True):
        assert np.array_equal(frame.image_bgr, truth)
    suspected = [frame.captured_s for frame in frames if frame.damaged]
    assert suspected == list(range(number, 2 * KEY_EVERY))


def test_a_backlog_is_dropped_and_the_rest_is_damaged_until_a_key_picture() -> None:
    frames: list[Frame] = []

    async def run() -> VideoDecoder:
        async with VideoDecoder("d", frames.append) as decoder:
            with decoder._changed:  # The decoder is kept from working, as by a busy machine.
                for datagram, number in datagrams() + datagrams():
                    decoder.feed(datagram, float(number))
                    if decoder.overflows:
                        break
            for datagram, number in datagrams():
                decoder.feed(datagram, float(number))
                while decoder._waiting:  # noqa: ASYNC110
                    await asyncio.sleep(0)
        await asyncio.sleep(0)
        return decoder

    decoder = asyncio.run(run())
    assert decoder.overflows == 1
    assert not frames[-1].damaged
    assert_undamaged_are_true(frames)
