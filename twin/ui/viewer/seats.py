"""The seats of the pages: a client waits until its first valid message, then it takes a seat.

Clients that send nothing valid take no seat. They wait for a limited time, and if too many of one household wait, the
one that has waited longest is disconnected. If all seats are taken, a silent client loses its seat to a new client.
"""

from __future__ import annotations

from typing import Protocol

SEATS, SEATS_OF_ONE = 32, 24
"""Maximum number of pages: in total, and from one address."""

WAITING_OF_ONE = 24
"""Maximum number of clients from one address that have not yet sent a valid message."""

FIRST = 30.0
"""Maximum time in s until the first valid message of a client; a page sends one when it has drawn the robot."""

IDLE = 20.0
"""Time in s without a frame after which a client loses its seat if another needs it; pages answer a ping every 5 s."""


class Holder(Protocol):
    """Interface of a client.

    Attributes:
        household: address of the client; see `twin.ui.door.limits.household`.
        heard: time in s of the client's last frame.
    """

    household: str
    heard: float

    def cut(self) -> None: ...  # noqa: D102


class Seats:
    """Clients that wait, and clients that have a seat, in the order of their arrival."""

    def __init__(self) -> None:
        self._waiting: list[Holder] = []
        self._seated: list[Holder] = []

    def enter(self, client: Holder) -> None:
        """Let a new client wait; if too many of its household wait, disconnect the one that has waited longest."""
        self._waiting.append(client)
        same = _of(self._waiting, client.household)
        if len(same) > WAITING_OF_ONE:
            self.leave(same[0])
            same[0].cut()

    def sit(self, client: Holder, now: float) -> bool:
        """Give a seat to a waiting client at the time `now` in s; return whether it has one."""
        if client in self._seated:
            return True
        if client not in self._waiting:  # it was disconnected
            return False
        same = _of(self._seated, client.household)
        if len(same) >= SEATS_OF_ONE:
            free = self._vacate(same, now)
        elif len(self._seated) >= SEATS:
            free = self._vacate(self._seated, now)
        else:
            free = True
        if free:
            self._waiting.remove(client)
            self._seated.append(client)
        return free

    def leave(self, client: Holder) -> None:
        """Remove a client that was disconnected."""
        for clients in (self._waiting, self._seated):
            if client in clients:
                clients.remove(client)

    def _vacate(self, clients: list[Holder], now: float) -> bool:
        """Disconnect the client that has been silent for the longest time, if it is idle; return whether one was."""
        silent = min(clients, key=lambda client: client.heard)
        if now - silent.heard <= IDLE:
            return False
        self.leave(silent)
        silent.cut()
        return True


def _of(clients: list[Holder], household: str) -> list[Holder]:
    return [client for client in clients if client.household == household]
