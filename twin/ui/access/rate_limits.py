"""Limits of the servers: rates (token buckets) and numbers of connections."""

from __future__ import annotations

import ipaddress
from collections import OrderedDict

MAX_CONNECTIONS, MAX_CONNECTIONS_OF_ADDRESS = 128, 64
"""Maximum number of simultaneous connections: in total, and from one address."""

MAX_WEBSOCKETS, MAX_WEBSOCKETS_OF_ADDRESS = 48, 32
"""Maximum number of simultaneous WebSockets: in total, and from one address."""

OPENING_LIMIT = (40.0, 160.0)
"""Limit of new connections from one address: (per second, burst); a page needs few connections, as it has few files."""

MESSAGE_LIMIT = (200.0, 400.0)
"""Limit of messages from one client: (per second, burst); dragging sends 60 to 120 messages per second."""

FRAME_LIMIT = (300.0, 600.0)
"""Limit of WebSocket frames from one client, including pings and fragments: (per second, burst)."""

BYTE_LIMIT = (100_000.0, 200_000.0)
"""Limit of bytes from one client after the handshake: (per second, burst)."""

MALFORMED_LIMIT = (0.1, 5.0)
"""Limit of malformed messages from one client: (per second, burst)."""

MAX_ADDRESSES = 4096
"""Maximum number of addresses with stored counts."""


class Bucket:
    """Token bucket for `size` tokens, with `rate` new tokens per second; it is full at the initial time `now` in s."""

    def __init__(self, rate: float, size: float, now: float) -> None:
        self.rate = rate
        self.size = size
        self.level = size
        self.last = now

    def take(self, now: float, amount: float = 1.0) -> bool:
        """Remove `amount` tokens if they are available at the time `now` in s; return whether they were removed."""
        elapsed = max(0.0, now - self.last)  # a clock that goes back gives no tokens
        self.level = min(self.size, self.level + self.rate * elapsed)
        self.last = now
        if self.level < amount:
            return False
        self.level -= amount
        return True


class ConnectionCounter:
    """Counter of the connections of each address; an address is an IPv4 address or an IPv6 /64 network.

    Args:
        clients: maximum number of simultaneous WebSockets in total.
        of_one: maximum number of simultaneous WebSockets from one address.
    """

    def __init__(self, clients: int = MAX_WEBSOCKETS, of_one: int = MAX_WEBSOCKETS_OF_ADDRESS) -> None:
        self._connections = _Count(MAX_CONNECTIONS, MAX_CONNECTIONS_OF_ADDRESS)
        self._clients = _Count(clients, of_one)
        self._openings: OrderedDict[str, Bucket] = OrderedDict()

    def open_connection(self, address: str, now: float) -> bool:
        """Return whether an address may open a connection at the time `now` in s; if so, count the connection."""
        bucket = self._openings.pop(address, None)
        if bucket is None:
            bucket = Bucket(*OPENING_LIMIT, now)
        self._openings[address] = bucket  # at the end, so that the address that was silent longest is forgotten first
        while len(self._openings) > MAX_ADDRESSES:
            self._openings.popitem(last=False)
        if not bucket.take(now):
            return False
        return self._connections.add(address)

    def close_connection(self, address: str) -> None:
        """Remove a closed connection of an address from the counts."""
        self._connections.remove(address)

    def open_client(self, address: str) -> bool:
        """Return whether an address may open a WebSocket; if so, count the WebSocket."""
        return self._clients.add(address)

    def close_client(self, address: str) -> None:
        """Remove a closed WebSocket of an address from the counts."""
        self._clients.remove(address)


class _Count:
    """Number of open connections of each address, with a limit in total and a limit for one address."""

    def __init__(self, most: int, of_one: int) -> None:
        self._most = most
        self._of_one = of_one
        self._counts: dict[str, int] = {}

    def add(self, address: str) -> bool:
        """Count one more connection of an address; return False if a limit does not allow it."""
        count = self._counts.get(address, 0)
        if count >= self._of_one or sum(self._counts.values()) >= self._most:
            return False
        self._counts[address] = count + 1
        return True

    def remove(self, address: str) -> None:
        count = self._counts.get(address, 0) - 1
        if count > 0:
            self._counts[address] = count
        else:
            self._counts.pop(address, None)


def counted_address(peer: str) -> str:
    """Return the address under which a client is counted: its IPv4 address, or its IPv6 /64 network.

    A provider gives one customer a whole /64 network: a count of single IPv6 addresses would limit nobody.
    """
    try:
        address = ipaddress.ip_address(peer.partition("%")[0])
    except ValueError:
        return peer
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    network_bits = int(address) >> 64 << 64
    network = ipaddress.ip_network((network_bits, 64))
    return str(network.network_address)
