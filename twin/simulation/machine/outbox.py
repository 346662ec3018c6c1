"""Packets of a World for its machines, stored until a program outside of the World sends them."""

from __future__ import annotations

from collections.abc import Mapping

from twin.core.spatial import Array
from twin.simulation.machine.itp import number_of, pack
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.settings import Settings
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_PACKET


class Outbox(Block):
    """Stores the packets of all machines until `take` is called; writes no signal.

    It must come after the blocks that write the packets of the tick: it stores what these have written.
    """

    def __init__(self, parts: Mapping[str, Parts]) -> None:
        """Create an empty queue for each robot in `parts` (compiled parts); sequence numbers begin at 1."""
        self.outputs = {}
        self._settings: dict[str, Settings] = {}
        self._packets: dict[str, list[bytes]] = {}
        for name, part in parts.items():
            self._settings[name] = part.settings
            self._packets[name] = []
        self._count = 0

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Store the packets of this tick."""
        self._count += 1
        sequence = number_of(self._count)
        for name, settings in self._settings.items():
            values = signals.now[ROBOT_PACKET.of(name)]
            self._packets[name].append(pack(sequence, settings.arm, values, settings.packet_version))
        return {}

    def take(self) -> dict[str, list[bytes]]:
        """Return the packets stored since the last call; the keys are the names of the robots."""
        stored = self._packets
        self._packets = {name: [] for name in stored}
        return stored
