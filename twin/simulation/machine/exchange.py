"""What passes between a World and its machines, outside of the World: states into it, packets out of it."""

from __future__ import annotations

from collections.abc import Mapping

from twin.simulation.devices.machine_states import MachineStates
from twin.simulation.machine.link import MachineLink
from twin.simulation.machine.outbox import Outbox


class Exchange:
    """The machines of one World.

    Attributes:
        links: connection to each machine, by robot.
    """

    def __init__(self, links: Mapping[str, MachineLink], states: Mapping[str, MachineStates], outbox: Outbox) -> None:
        """Connect the device of the states of each machine, and the last block of the World."""
        self.links, self._states, self._outbox = links, states, outbox

    def receive(self) -> None:
        """Give the newest states to the World, for its next tick."""
        for name, link in self.links.items():
            self._states[name].give(link.state)

    def send(self) -> None:
        """Send the packets of the ticks since the last call."""
        for name, packets in self._outbox.take().items():
            for packet in packets:
                self.links[name].send(packet)
