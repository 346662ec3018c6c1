"""Number of pages: a client waits until its first valid message, then it is admitted.

Clients that send nothing valid are not admitted. They wait for a limited time, and if too many of one address wait, the
one that has waited longest is disconnected. If the number of pages is reached, a silent page is disconnected for a new
one.
"""

from __future__ import annotations

from typing import Protocol

MAX_PAGES = 32
"""Maximum number of pages in total."""

MAX_PAGES_OF_ADDRESS = 24
"""Maximum number of pages from one address."""

MAX_WAITING_OF_ADDRESS = 24
"""Maximum number of clients from one address that have not yet sent a valid message."""

FIRST_MESSAGE_TIMEOUT = 30.0
"""Maximum time in s until the first valid message of a client; a page sends one when it has drawn the robot."""

IDLE_TIME = 20.0
"""Time in s without a frame after which a page may be disconnected for another; pages answer a ping every 5 s."""


class PageClient(Protocol):
    """Interface of a client.

    Attributes:
        address: address of the client; see `twin.ui.access.rate_limits.counted_address`.
        heard: time in s of the client's last frame.
    """

    address: str
    heard: float

    def cut(self) -> None: ...  # noqa: D102


class Admission:
    """Clients that wait, and clients that are admitted, in the order of their arrival."""

    def __init__(self) -> None:
        self._waiting: list[PageClient] = []
        self._admitted: list[PageClient] = []

    def wait(self, client: PageClient) -> None:
        """Let a new client wait; if too many of its address wait, disconnect the one that has waited longest."""
        self._waiting.append(client)
        same_address = _of_address(self._waiting, client.address)
        if len(same_address) > MAX_WAITING_OF_ADDRESS:
            longest_waiting = same_address[0]
            self.remove(longest_waiting)
            longest_waiting.cut()

    def admit(self, client: PageClient, now: float) -> bool:
        """Admit a waiting client at the time `now` in s, if the numbers allow it; return whether it is admitted."""
        if client in self._admitted:
            return True
        if client not in self._waiting:  # it was disconnected
            return False
        same_address = _of_address(self._admitted, client.address)
        if len(same_address) >= MAX_PAGES_OF_ADDRESS:
            possible = self._disconnect_idle(same_address, now)
        elif len(self._admitted) >= MAX_PAGES:
            possible = self._disconnect_idle(self._admitted, now)
        else:
            possible = True
        if possible:
            self._waiting.remove(client)
            self._admitted.append(client)
        return possible

    def remove(self, client: PageClient) -> None:
        """Remove a client that was disconnected."""
        for clients in (self._waiting, self._admitted):
            if client in clients:
                clients.remove(client)

    def _disconnect_idle(self, clients: list[PageClient], now: float) -> bool:
        """Disconnect the client that has been silent for the longest time, if it is idle; return whether one was."""
        most_silent = min(clients, key=lambda client: client.heard)
        if now - most_silent.heard <= IDLE_TIME:
            return False
        self.remove(most_silent)
        most_silent.cut()
        return True


def _of_address(clients: list[PageClient], address: str) -> list[PageClient]:
    return [client for client in clients if client.address == address]
