"""UDP socket for programs of haptic pens and other input devices: it receives packets and sends forces."""

from __future__ import annotations

import socket
from types import TracebackType
from typing import Self

from numpy.typing import ArrayLike

from twin.core.errors import TwinError
from twin.simulation.devices.packets import HAND, Packets

_MOST = 64
"""Maximum number of packets read in one tick, so that too many packets do not delay the tick."""


class PacketDoor:
    """A UDP socket for a packet device; the caller of `World.step` calls `pump` before each tick.

    Each hand is controlled by the address that first sent a packet for it, until packets for this hand stop. By
    default, only programs on this machine can send packets.

    Attributes:
        port: port on which the socket listens.
        refused: number of packets from addresses that do not control the hand.
    """

    def __init__(self, device: Packets, port: int = 0, host: str = "127.0.0.1") -> None:
        """Listen on a port; 0 means any free port.

        Raises:
            TwinError: the port is in use.
        """
        self.device, self.refused = device, 0
        self._owners: dict[int, tuple[str, int]] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise TwinError(
                f"cannot listen for packets on {host}:{port}: {error.strerror or error}; choose another port, "
                "or 0 for any"
            ) from error
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]

    def pump(self, t: float) -> int:
        """Read the packets that have arrived before the tick at time t in s; return their number."""
        for count in range(_MOST):
            try:
                data, address = self._socket.recvfrom(HAND.size + 1)
            except (BlockingIOError, ConnectionResetError):
                return count
            hand = data[5] if len(data) == HAND.size else -1
            owner = self._owners.get(hand)
            if owner is not None and owner != address and not self.device.silent(hand, t):
                self.refused += 1
                continue
            taken = self.device.take(data)
            if taken is not None:
                self._owners[taken] = address
        return _MOST

    def answer(self, hand: int, force: ArrayLike) -> None:
        """Send a force (3,) in N in frame {H} to the address that controls a hand, if any."""
        if (owner := self._owners.get(hand)) is not None:
            self._socket.sendto(self.device.answer(hand, force), owner)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
