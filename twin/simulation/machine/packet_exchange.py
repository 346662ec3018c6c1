"""Pass the states of the machines to their World, and the World's packets to the machines."""

from __future__ import annotations

from collections.abc import Mapping

from twin.simulation.devices.machine_states import MachineStates
from twin.simulation.machine.machine_link import MachineLink
from twin.simulation.machine.outbox import Outbox


class Exchange:
    """Passes states and packets between one World and its machines.

    Attributes:
        links: connection to each machine; the keys are the names of the robots.
    """

    def __init__(self, links: Mapping[str, MachineLink], states: Mapping[str, MachineStates], outbox: Outbox) -> None:
        """Store the link of each robot, the device that writes its states, and the block that stores packets."""
        self.links = links
        self._states = states
        self._outbox = outbox

    def receive(self) -> None:
        """Pass the newest states of the machines to the World for its next tick."""
        for name, link in self.links.items():
            self._states[name].give(link.state)

    def send(self) -> None:
        """Send the machines the packets of all ticks since the last call."""
        for name, packets in self._outbox.take().items():
            for packet in packets:
                self.links[name].send(packet)
