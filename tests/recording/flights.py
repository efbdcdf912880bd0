"""Things to record: coded pictures as a drone sends them, and ways to read a file back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from server.recording.config import RecordingConfig
from server.sim.encoder import VideoEncoder

SMALL = RecordingConfig(
    max_bytes=1 << 20, min_free_bytes=1, chunk_bytes=8 << 10, flush_s=0.02, close_s=5.0
)
WIDTH, HEIGHT = 320, 240


def pictures(count: int, fps: float = 10.0, seed: int = 0) -> list[tuple[float, list[bytes]]]:
    """Return time and datagrams of pictures of a bright square that wanders."""
    rng = np.random.default_rng(seed)
    encoder = VideoEncoder(WIDTH, HEIGHT, fps, 2000)
    floor = rng.integers(0, 60, (HEIGHT, WIDTH, 3), np.uint8)
    shot: list[tuple[float, list[bytes]]] = []
    for number in range(count):
        image = floor.copy()
        image[80:160, 40 + 4 * number : 120 + 4 * number] = (40, 200, 240)
        shot.append((number / fps, encoder.encode(image, number / fps)))
    return shot


def read_officially(path: Path) -> list[tuple[str, str, Any]]:
    """Return topic, schema and decoded message of everything, by the official reader."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = []
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            decoder = DecoderFactory().decoder_for(channel.message_encoding, schema)
            found.append(
                (channel.topic, schema.name, decoder(message.data) if decoder else message.data)
            )
        return found
