"""Who may do what: tokens, each with a role, kept as digests in one file.

A viewer looks, an operator flies as well, an admin also deletes captures and hands out tokens. The
console's own token is an admin's and is in no file here. All other tokens are random and long, so
a plain digest keeps them: there is nothing to guess from it.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import logging
import secrets
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, get_args

from server.store.atomic import write_atomic

logger = logging.getLogger(__name__)

Role = Literal["viewer", "operator", "admin"]
ROLES: tuple[Role, ...] = get_args(Role)
CONSOLE = "console"
_MOST_KEYS = 200


def digest(text: str) -> str:
    """Return the SHA-256 of ``text`` in hexadecimal."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def allows(role: Role, needed: Role) -> bool:
    """Return whether who has ``role`` may do what needs ``needed``."""
    return ROLES.index(role) >= ROLES.index(needed)


@dataclass(frozen=True, slots=True)
class Key:
    """A token as it is kept.

    Attributes:
        id: Names it where it is listed and taken back.
        name: Whose it is, for people.
        role: What it allows.
        digest: SHA-256 of the token, hexadecimal.
        made_at: ISO 8601 with UTC offset.
    """

    id: str
    name: str
    role: Role
    digest: str
    made_at: str

    def __post_init__(self) -> None:
        if self.role not in ROLES:
            raise ValueError(f"there is no role {self.role!r}")
        if not all(isinstance(each, str) for each in (self.id, self.name, self.digest)):
            raise ValueError("a key's fields are texts")


class KeyRing:
    """The tokens that open the console: its own, and those in a file.

    The file is read again when it has changed, so that one command line takes a token back from a
    console that runs. A file that cannot be read opens nothing.
    """

    def __init__(self, token: str, file: Path | None = None) -> None:
        """Make a ring of the console's own ``token`` and the tokens in ``file``, if any.

        Raises:
            ValueError: If the token is empty or holds anything but visible ASCII characters.
        """
        if not token or not all("!" <= character <= "~" for character in token):
            raise ValueError("the token must be visible ASCII characters without spaces")
        self._own = Key(CONSOLE, CONSOLE, "admin", digest(token), "")
        self._store = None if file is None else KeyFile(file)

    @property
    def own(self) -> Key:
        """The console's own token."""
        return self._own

    def all(self) -> list[Key]:
        """Return all keys, the console's own first."""
        return [self._own, *(self._store.all() if self._store is not None else [])]

    def find(self, token: str) -> Key | None:
        """Return the key of ``token``; every known digest is compared, in constant time."""
        shown = digest(token)
        found = None
        for key in self.all():
            if hmac.compare_digest(shown, key.digest):
                found = key
        return found

    def get(self, key_id: str) -> Key | None:
        """Return the key with this id, None once it was taken back."""
        return next((key for key in self.all() if key.id == key_id), None)

    def add(self, name: str, role: Role) -> tuple[Key, str]:
        """Make a token; it is returned beside its key and can never be read again.

        Raises:
            ValueError: If there is no file to keep it in, it is damaged, or holds too many.
            OSError: If the file cannot be written.
        """
        if self._store is None:
            raise ValueError("this console keeps no tokens")
        return self._store.add(name, role)

    def remove(self, key_id: str) -> bool:
        """Take a token back; return whether there was such a one. The console's own stays."""
        return self._store is not None and self._store.remove(key_id)


class KeyFile:
    """Tokens in a file, readable by its owner alone."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._read: tuple[object, list[Key]] = (None, [])

    def all(self) -> list[Key]:
        """Return the keys as the file holds them now; none when there is no readable file."""
        try:
            status = self._file.stat()
        except OSError:
            return []
        mark = (status.st_mtime_ns, status.st_ino, status.st_size)
        if self._read[0] != mark:
            try:
                keys = self._parse()
            except ValueError as error:
                logger.error("none of its tokens is let in: %s", error)
                keys = []
            self._read = (mark, keys)
        return self._read[1]

    def add(self, name: str, role: Role) -> tuple[Key, str]:
        """Make a token and keep its digest; see ``KeyRing.add``."""
        token = f"dronerf_{secrets.token_urlsafe(32)}"
        made_at = datetime.now(UTC).isoformat(timespec="seconds")
        key = Key(secrets.token_hex(6), name, role, digest(token), made_at)
        keys = self._parse()
        if len(keys) >= _MOST_KEYS:
            raise ValueError(f"there are {_MOST_KEYS} tokens already; take one back first")
        self._write([*keys, key])
        return key, token

    def remove(self, key_id: str) -> bool:
        """Take a token back; return whether there was such a one."""
        keys = self._parse()
        kept = [key for key in keys if key.id != key_id]
        if len(kept) < len(keys):
            self._write(kept)
        return len(kept) < len(keys)

    def _write(self, keys: list[Key]) -> None:
        text = json.dumps({"tokens": [asdict(key) for key in keys]}, indent=1) + "\n"
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(self._file, text.encode())
        self._file.chmod(0o600)
        self._read = (None, [])

    def _parse(self) -> list[Key]:
        """Return the keys in the file; raises ValueError when it is damaged."""
        try:
            tokens = json.loads(self._file.read_text(encoding="utf-8"))["tokens"]
            return [Key(**each) for each in tokens]
        except FileNotFoundError:
            return []
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ValueError(f"{self._file} is no file of tokens: {error}") from error
