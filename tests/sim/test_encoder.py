"""The simulated video against what captures of real drones show."""

from __future__ import annotations

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.sim.encoder import KEY_PERIOD_S, PIECE_BYTES, VideoEncoder
from server.sim.parameter_sets import without_vui

_FPS = 15.0


def noise(rng: np.random.Generator) -> np.ndarray:
    """Pictures that need many datagrams each."""
    small = rng.integers(0, 255, (90, 120, 3), np.uint8)
    return np.ascontiguousarray(small.repeat(8, axis=0).repeat(8, axis=1))


@pytest.fixture(scope="module")
def pictures() -> list[list[bytes]]:
    encoder = VideoEncoder(960, 720, _FPS, 4000)
    rng = np.random.default_rng(0)
    return [encoder.encode(noise(rng), n / _FPS) for n in range(40)]


def kind(datagram: bytes) -> int:
    assert datagram[:4] == b"\0\0\0\1"
    return datagram[4] & 0x1F


def test_pieces_are_full_and_a_short_one_ends_a_picture(pictures: list[list[bytes]]) -> None:
    for picture in pictures:
        slices = [d for d in picture if not (d[:4] == b"\0\0\0\1" and kind(d) in (7, 8))]
        assert len(slices) > 3
        assert all(len(piece) == PIECE_BYTES for piece in slices[:-1])
        assert len(slices[-1]) <= PIECE_BYTES
        assert kind(slices[0]) in (1, 5)
        # One slice: a start code only at the very beginning.
        assert b"".join(slices).count(b"\0\0\0\1") == 1


def test_key_pictures_come_by_themselves_with_their_parameter_sets(
    pictures: list[list[bytes]],
) -> None:
    keys = [n for n, picture in enumerate(pictures) if kind(picture[0]) == 7]
    assert keys == [0, *range(round(KEY_PERIOD_S * _FPS), 40, round(KEY_PERIOD_S * _FPS))]
    for n in keys:
        assert [kind(datagram) for datagram in pictures[n][:3]] == [7, 8, 5]
    for n, picture in enumerate(pictures):
        assert n in keys or kind(picture[0]) == 1


def test_it_is_main_profile_without_b_pictures(pictures: list[list[bytes]]) -> None:
    assert pictures[0][0][4:8] == b"\x67\x4d\x40\x28", "the first bytes of a real drone's"
    assert len(pictures[0][0]) <= 14, "13 bytes on a real drone: nothing on how to show pictures"
    # Every picture comes out at once: nothing is held back for reordering.
    assert all(pictures)


def test_a_decoder_gets_every_picture_whole(pictures: list[list[bytes]]) -> None:
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    stream = b"".join(datagram for picture in pictures for datagram in picture)
    frames = [frame for packet in decoder.parse(stream) for frame in decoder.decode(packet)]
    frames += [frame for packet in decoder.parse(b"") for frame in decoder.decode(packet)]
    frames += decoder.decode(None)
    assert len(frames) == len(pictures)
    rng = np.random.default_rng(0)
    for frame in frames[:3]:
        expected = noise(rng).astype(float)
        got = frame.to_ndarray(format="bgr24").astype(float)
        # Colours are carried at half the resolution; the mean error stays small.
        assert np.abs(got.mean(axis=2) - expected.mean(axis=2)).mean() < 12.0


def test_only_a_sequence_parameter_set_of_a_plain_profile_is_rewritten() -> None:
    real = bytes.fromhex("674d402895a03c05b9")
    assert without_vui(real) == real, "a real drone's has nothing to leave out"
    for unit in (bytes.fromhex("68ee3880"), bytes.fromhex("6764001facd9"), b"\x67\x4d\x40"):
        with pytest.raises(ValueError, match="parameter set"):
            without_vui(unit)


@given(st.binary(min_size=1, max_size=40))
def test_any_bytes_are_rewritten_or_refused(unit: bytes) -> None:
    try:
        rewritten = without_vui(unit)
    except ValueError:
        return
    assert rewritten[:4] == unit[:4]
    assert without_vui(rewritten) == rewritten


def test_a_key_picture_can_be_asked_for() -> None:
    encoder = VideoEncoder(960, 720, _FPS, 4000)
    rng = np.random.default_rng(1)
    asked = [kind(encoder.encode(noise(rng), n / _FPS, key=n == 5)[0]) == 7 for n in range(8)]
    assert asked == [True, False, False, False, False, True, False, False]


def test_a_picture_costs_what_it_costs_on_a_real_drone_however_few_are_rendered() -> None:
    """tello_ros: about 35 kB for a key picture and 10 kB for another, at 2.5 Mbit/s and 30 fps."""
    encoder = VideoEncoder(960, 720, 30.0, 2500)
    floor = noise(np.random.default_rng(2))
    coded = [encoder.encode(np.roll(floor, 6 * n, axis=1), n / 5.0) for n in range(15)]
    sizes: dict[bool, list[int]] = {True: [], False: []}
    for picture in coded:
        sizes[kind(picture[0]) == 7].append(sum(map(len, picture)))
    assert len(sizes[True]) == 3
    assert np.mean(sizes[True]) < 60_000
    assert np.mean(sizes[False]) < 15_000
