"""Who is in command: of several browsers one flies, the others watch and may ask for it.

``Lease`` decides and does no I/O; times are monotonic seconds that come in. A browser names itself
by an id of its own making: all of them hold the same token, so this keeps people out of each
other's way and nobody out. The stops know nothing of it: whoever sees a danger may stop the drones.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Standing:
    """Who is in command and who asks for it, by their ids; None for nobody."""

    holder: str | None = None
    asking: str | None = None


class Lease:
    """The command over the drones, held by one browser as long as it shows signs of life.

    Attributes:
        standing: Who is in command and who asks for it.
    """

    def __init__(self, lapse_s: float) -> None:
        """Make a lease that lapses ``lapse_s`` after its holder's last sign of life."""
        self.standing = Standing()
        self._lapse_s = lapse_s
        self._seen_s = 0.0

    def renew(self, client: str, now_s: float) -> bool:
        """Take a sign of life; return whether it is that of who is in command.

        Nobody else being in command, whoever flies is.
        """
        self.lapse(now_s)
        if self.standing.holder is None:
            self.take(client, now_s)
        if self.standing.holder != client:
            return False
        self._seen_s = now_s
        return True

    def admits(self, client: str, now_s: float) -> bool:
        """Return whether ``client`` may fly: nobody else is in command."""
        self.lapse(now_s)
        return self.standing.holder in (None, client)

    def take(self, client: str, now_s: float) -> None:
        """Put ``client`` in command, whoever was before."""
        self.standing = Standing(client)
        self._seen_s = now_s

    def ask(self, client: str) -> None:
        """Note that ``client`` asks who is in command for it; the last one to ask counts."""
        if self.standing.holder not in (None, client):
            self.standing = Standing(self.standing.holder, client)

    def answer(self, client: str, grant: bool, now_s: float) -> None:
        """Let who is in command hand it over to who asks, or keep it."""
        holder, asking = self.standing.holder, self.standing.asking
        if client != holder or asking is None:
            return
        if grant:
            self.take(asking, now_s)
        else:
            self.standing = Standing(holder)

    def release(self, client: str) -> bool:
        """Let who is in command take leave; return whether it was ``client`` who had it."""
        if client != self.standing.holder:
            return False
        self.standing = Standing()
        return True

    def lapse(self, now_s: float) -> None:
        """Take the command from who has shown no sign of life for too long."""
        if self.standing.holder is not None and now_s - self._seen_s > self._lapse_s:
            self.standing = Standing()
