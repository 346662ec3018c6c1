"""Simulated network between master and machine: faults drop, repeat, delay or renumber packets on their way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.itp import PACKET, renumbered, sequence_of
from twin.simulation.machine.receiver import Sender

WIRE_NUMBERS = ("sequence",)
"""Names of the numbers of the signal `wire`."""


class Wire:
    """Carries packets from the master to the machine; its faults drop, repeat, delay or renumber packets.

    The checksum of a renumbered packet is computed again, so that only the check of the sequence number can detect the
    fault. A delayed packet arrives `Fault.value` ticks later; packets sent after it can arrive before it.
    """

    def __init__(self, faults: Sequence[Fault]) -> None:
        """Store the faults of the signal `wire`."""
        self._faults = faults
        self._tick = 0  # number of calls of `carry`
        self._late: list[tuple[int, bytes, Sender]] = []  # (tick of arrival, packet, sender)

    def carry(self, t: float, packets: Iterable[tuple[bytes, Sender]]) -> list[tuple[bytes, Sender]]:
        """Return the packets (bytes, sender) that arrive in this tick, at t in s."""
        if not self._faults:
            return list(packets)
        self._tick += 1
        arrived = []
        waiting = []
        for due, data, sender in self._late:
            if due <= self._tick:
                arrived.append((data, sender))
            else:
                waiting.append((due, data, sender))
        self._late = waiting
        for data, sender in packets:
            arrived += self._disturbed(t, data, sender)
        return arrived

    def _disturbed(self, t: float, data: bytes, sender: Sender) -> list[tuple[bytes, Sender]]:
        """Return the copies of a packet that arrive now, and store those that arrive later."""
        sequence = sequence_of(data)
        copies = 1
        delay = 0  # in ticks; the delays of several faults add up
        for fault in self._faults:
            time_or_sequence = sequence if fault.counts else t
            copies *= fault.copies(time_or_sequence)
            if fault.operation == "delay":
                if fault.start <= time_or_sequence < fault.stop:
                    delay += int(np.asarray(fault.value))
            elif len(data) == PACKET.size:
                (value,) = fault.change(time_or_sequence, np.array([float(sequence)]))
                new_sequence = int(value)
                if new_sequence != sequence:
                    data = renumbered(data, new_sequence)
        if delay and copies:
            self._late += [(self._tick + delay, data, sender)] * copies
            return []
        return [(data, sender)] * copies
