"""How much anybody may ask of the server: buckets that fill with time, and places that are taken and given back."""

from __future__ import annotations

import ipaddress
from collections import OrderedDict

SOCKETS, SOCKETS_OF_ONE = 128, 64
"""Connections of any kind at once, in all and from one address."""

CLIENTS, CLIENTS_OF_ONE = 48, 32
"""WebSockets at once, in all and from one address."""

OPENINGS = (40.0, 160.0)
"""New connections of one address: a second, and at once. A page is a handful of files."""

MESSAGES = (200.0, 400.0)
"""Messages of one client: a second, and at once. A hand that drags says 60 to 120."""

FRAMES = (300.0, 600.0)
"""WebSocket frames of one client, pings and fragments too."""

BYTES = (100_000.0, 200_000.0)
"""Bytes of one client after its handshake."""

GARBAGE = (0.1, 5.0)
"""Messages of one client that make no sense."""

ADDRESSES = 4096
"""Addresses that are remembered."""


class Bucket:
    """Holds `size` at most, gains `rate` a second; `take` says whether there was enough."""

    def __init__(self, rate: float, size: float, now: float) -> None:
        self.rate, self.size, self.level, self.last = rate, size, size, now

    def take(self, now: float, amount: float = 1.0) -> bool:
        """Take an amount if it is there."""
        self.level = min(self.size, self.level + self.rate * max(0.0, now - self.last))
        self.last = now
        if self.level < amount:
            return False
        self.level -= amount
        return True


class Doorman:
    """Counts connections by address: an IPv4 address, or an IPv6 network of 64 bits, which is one household.

    Args:
        clients, of_one: WebSockets at once, in all and from one address.
    """

    def __init__(self, clients: int = CLIENTS, of_one: int = CLIENTS_OF_ONE) -> None:
        self._most, self._of_one = clients, of_one
        self._sockets: dict[str, int] = {}
        self._clients: dict[str, int] = {}
        self._openings: OrderedDict[str, Bucket] = OrderedDict()

    def admit(self, address: str, now: float) -> bool:
        """Count a new connection, or say no."""
        bucket = self._openings.pop(address, None) or Bucket(*OPENINGS, now)
        self._openings[address] = bucket
        while len(self._openings) > ADDRESSES:
            self._openings.popitem(last=False)
        if not bucket.take(now) or not _room(self._sockets, address, SOCKETS, SOCKETS_OF_ONE):
            return False
        self._sockets[address] = self._sockets.get(address, 0) + 1
        return True

    def leave(self, address: str) -> None:
        """Forget a connection that was admitted."""
        _give_back(self._sockets, address)

    def join(self, address: str) -> bool:
        """Count a new WebSocket, or say no."""
        if not _room(self._clients, address, self._most, self._of_one):
            return False
        self._clients[address] = self._clients.get(address, 0) + 1
        return True

    def part(self, address: str) -> None:
        """Forget a WebSocket that was counted."""
        _give_back(self._clients, address)


def _room(counts: dict[str, int], address: str, most: int, of_one: int) -> bool:
    return counts.get(address, 0) < of_one and sum(counts.values()) < most


def _give_back(counts: dict[str, int], address: str) -> None:
    left = counts.get(address, 0) - 1
    if left > 0:
        counts[address] = left
    else:
        counts.pop(address, None)


def household(peer: str) -> str:
    """Return what an address is counted as."""
    try:
        address = ipaddress.ip_address(peer.partition("%")[0])
    except ValueError:
        return peer
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is not None:
            return str(address.ipv4_mapped)
        return str(ipaddress.ip_network((int(address) >> 64 << 64, 64)).network_address)
    return str(address)
