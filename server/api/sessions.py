"""Which browsers are signed in, and by which token: in memory, and in a file for the next start.

A console that crashed and is started again must know its operator's browser: drones may be in the
air. Only digests are kept, so whoever reads the file can open nothing with it.
"""

from __future__ import annotations

import json
import logging
import secrets
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from server.api.access import Key, KeyRing, digest
from server.store.atomic import write_atomic

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Session:
    """A signed-in browser.

    Attributes:
        key_id: The key whose token was shown.
        key_digest: That token's digest: another token under the same name opens nothing.
        ends_s: When it runs out, Unix time.
    """

    key_id: str
    key_digest: str
    ends_s: float


class Sessions:
    """The signed-in browsers of one console."""

    def __init__(
        self,
        most: int,
        lasting_s: float,
        file: Path | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Take over what an earlier console left in ``file``; none is no loss but a sign-in."""
        self._most = most
        self._lasting_s = lasting_s
        self._file = file
        self._clock = clock
        self._sessions: dict[str, _Session] = {} if file is None else _read(file)

    def open(self, key: Key) -> str:
        """Return a new session id; the oldest session is forgotten when there are too many."""
        while len(self._sessions) >= self._most:
            del self._sessions[next(iter(self._sessions))]
        session_id = secrets.token_urlsafe(32)
        ends_s = self._clock() + self._lasting_s
        # Only digests are kept and looked up, so timing tells nothing about a valid id.
        self._sessions[digest(session_id)] = _Session(key.id, key.digest, ends_s)
        return session_id

    def key(self, session_id: str, ring: KeyRing) -> Key | None:
        """Return whose session this is; None when it has run out or its token was taken back."""
        session = self._sessions.get(digest(session_id))
        if session is None:
            return None
        if self._clock() >= session.ends_s:
            self.end(session_id)
            return None
        key = ring.get(session.key_id)
        return key if key is not None and key.digest == session.key_digest else None

    def end(self, session_id: str) -> None:
        """Forget a session, if there is such a one."""
        self._sessions.pop(digest(session_id), None)

    def save(self) -> None:
        """Write the file; call it from a thread, for a disk may take its time."""
        if self._file is None:
            return
        told = {name: asdict(session) for name, session in list(self._sessions.items())}
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(self._file, json.dumps(told, indent=1).encode())
            self._file.chmod(0o600)
        except OSError as error:
            logger.warning("browsers will have to sign in again after a restart: %s", error)


def _read(file: Path) -> dict[str, _Session]:
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        return {name: _Session(**session) for name, session in told.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        logger.warning("all browsers have to sign in again: %s: %s", file, error)
        return {}
