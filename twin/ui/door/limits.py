"""Limits of the servers: rates (token buckets) and numbers of connections."""

from __future__ import annotations

import ipaddress
from collections import OrderedDict

SOCKETS, SOCKETS_OF_ONE = 128, 64
"""Maximum number of simultaneous connections: in total, and from one address."""

CLIENTS, CLIENTS_OF_ONE = 48, 32
"""Maximum number of simultaneous WebSockets: in total, and from one address."""

OPENINGS = (40.0, 160.0)
"""Limit of new connections from one address: (per second, burst); a page needs few connections, as it has few files."""

MESSAGES = (200.0, 400.0)
"""Limit of messages from one client: (per second, burst); dragging sends 60 to 120 messages per second."""

FRAMES = (300.0, 600.0)
"""Limit of WebSocket frames from one client, including pings and fragments: (per second, burst)."""

BYTES = (100_000.0, 200_000.0)
"""Limit of bytes from one client after the handshake: (per second, burst)."""

GARBAGE = (0.1, 5.0)
"""Limit of malformed messages from one client: (per second, burst)."""

ADDRESSES = 4096
"""Maximum number of addresses with stored counts."""


class Bucket:
    """Token bucket for `size` tokens, with `rate` new tokens per second; it is full at the initial time `now` in s."""

    def __init__(self, rate: float, size: float, now: float) -> None:
        self.rate, self.size, self.level, self.last = rate, size, size, now

    def take(self, now: float, amount: float = 1.0) -> bool:
        """Remove `amount` tokens if they are available at the time `now` in s; return whether they were removed."""
        self.level = min(self.size, self.level + self.rate * max(0.0, now - self.last))
        self.last = now
        if self.level < amount:
            return False
        self.level -= amount
        return True


class Doorman:
    """Counter of the connections of each household; a household is an IPv4 address or an IPv6 /64 network.

    Args:
        clients: maximum number of simultaneous WebSockets in total.
        of_one: maximum number of simultaneous WebSockets from one household.
    """

    def __init__(self, clients: int = CLIENTS, of_one: int = CLIENTS_OF_ONE) -> None:
        self._most, self._of_one = clients, of_one
        self._sockets: dict[str, int] = {}
        self._clients: dict[str, int] = {}
        self._openings: OrderedDict[str, Bucket] = OrderedDict()

    def admit(self, address: str, now: float) -> bool:
        """Return whether a household may open a connection at the time `now` in s; if so, count the connection."""
        bucket = self._openings.pop(address, None) or Bucket(*OPENINGS, now)
        self._openings[address] = bucket
        while len(self._openings) > ADDRESSES:
            self._openings.popitem(last=False)
        if not bucket.take(now) or not _room(self._sockets, address, SOCKETS, SOCKETS_OF_ONE):
            return False
        self._sockets[address] = self._sockets.get(address, 0) + 1
        return True

    def leave(self, address: str) -> None:
        """Remove a closed connection of a household from the counts."""
        _give_back(self._sockets, address)

    def join(self, address: str) -> bool:
        """Return whether a household may open a WebSocket; if so, count the WebSocket."""
        if not _room(self._clients, address, self._most, self._of_one):
            return False
        self._clients[address] = self._clients.get(address, 0) + 1
        return True

    def part(self, address: str) -> None:
        """Remove a closed WebSocket of a household from the counts."""
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
    """Return the household of a client's address: the IPv4 address, or the IPv6 /64 network."""
    try:
        address = ipaddress.ip_address(peer.partition("%")[0])
    except ValueError:
        return peer
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is not None:
            return str(address.ipv4_mapped)
        return str(ipaddress.ip_network((int(address) >> 64 << 64, 64)).network_address)
    return str(address)
