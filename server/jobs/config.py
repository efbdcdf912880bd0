"""Where jobs run beyond this machine."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlsplit


@dataclass(frozen=True, slots=True)
class RayConfig:
    """A Ray cluster that trains, by its Jobs API.

    Attributes:
        address: The cluster's address as Ray's dashboard serves it.
        python: The interpreter on its nodes that has this program installed.
        cpus: Processors that one job asks for, and the threads it uses.
        gpus: GPUs, or parts of one, that one job asks for.
        store: An fsspec URL that console and nodes reach, for pictures and results. None: the run
            folders are at the same path on every node.
        callback_host: Address on which the console hears the workers.
        callback_port: Its port; a fixed one lets workers find a console that was restarted. 0: any.
        callback_url: How the nodes reach it, where that is not ``http://HOST:PORT``.
        silence_s: A job is given up when neither it nor the cluster was heard for so long.
    """

    address: str = "http://127.0.0.1:8265"
    python: str = "python3"
    cpus: int = 2
    gpus: float = 0.0
    store: str | None = None
    callback_host: str = "127.0.0.1"
    callback_port: int = 0
    callback_url: str | None = None
    silence_s: float = 120.0

    def __post_init__(self) -> None:
        for name in ("address", "callback_url"):
            url = getattr(self, name)
            if url is not None and urlsplit(url).scheme not in ("http", "https"):
                raise ValueError(f"{name} must begin with http:// or https://, not {url!r}")
        if self.cpus < 1:
            raise ValueError(f"cpus must be at least 1, not {self.cpus}")
        if self.gpus < 0.0:
            raise ValueError(f"gpus must be at least 0, not {self.gpus}")
        if not 0 <= self.callback_port <= 65535:
            raise ValueError(f"callback_port must be 0 to 65535, not {self.callback_port}")
        if not self.silence_s > 0.0:
            raise ValueError(f"silence_s must be above 0, not {self.silence_s}")
