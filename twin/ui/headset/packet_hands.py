"""Hands of a console that are moved by UDP packets instead of a client; the senders receive the forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.simulation.devices.packets import Packets
from twin.simulation.world import Signals
from twin.ui.door.packets import PacketDoor

UDP = "udp"
"""Identifier of the owner of the hands if UDP packets move them; the identifiers of clients are c1, c2, ..."""

_GONE = 5.0
"""Time in s without a packet after which the packets no longer own the hands."""


class PacketHands:
    """Hands of a console that are moved by UDP packets.

    Attributes:
        door: UDP socket of the packets.
    """

    def __init__(self, device: Packets, host: str, port: int, tell: Callable[[str], object]) -> None:
        """Listen on an address and a port (0: any free port); `tell` receives each problem as a message.

        Raises:
            TwinError: the port is in use.
        """
        self.door = PacketDoor(device, port, host)
        self.door.reports.tell = tell

    def gone(self, t: float) -> bool:
        """Return whether no packet was accepted in the last `_GONE` s before time t in s."""
        return t - self.door.heard > _GONE

    def answer(self, forces: Sequence[Array], t: float) -> None:
        """Send each hand its force (3,) in N, in the axes of the endoscope's picture {H}, at time t in s."""
        for hand, force in enumerate(forces):
            self.door.answer(hand, force, t)

    def state(self, t: float, signals: Signals) -> JsonObject:
        """Return port, senders at time t in s, and numbers of lost and ignored packets, as an entry of `state`."""
        device = self.door.device
        senders = [self.door.sender(hand, t) for hand in range(len(device.hands))]
        return {
            "port": self.door.port,
            "from": {n: a and f"{a[0]}:{a[1]}" for n, a in zip(device.hands, senders, strict=True)},
            "lost": {n: int(signals[f"{n}.lost"][0]) for n in device.hands},
            "ignored": int(signals[f"{device.device}.ignored"][0]) + self.door.refused,
        }
