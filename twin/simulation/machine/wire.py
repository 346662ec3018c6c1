"""Simulated network between master and machine: faults drop, repeat, delay or renumber packets on their way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.itp import PACKET, renumbered, sequence_of

SENT = ("sequence",)
"""Names of the numbers of the signal `wire`."""


class Wire:
    """Carries packets from the master to the machine; its faults drop, repeat, delay or renumber packets.

    The checksum of a renumbered packet is computed again, so that only the check of the sequence number can detect the
    fault. A delayed packet arrives `Fault.value` ticks later; packets sent after it can arrive before it.
    """

    def __init__(self, faults: Sequence[Fault]) -> None:
        """Store the faults of the signal `wire`."""
        self._faults, self._tick = faults, 0
        self._late: list[tuple[int, bytes, Any]] = []

    def carry(self, t: float, packets: Iterable[tuple[bytes, Any]]) -> list[tuple[bytes, Any]]:
        """Return the packets (bytes, sender) that arrive in this tick, at t in s."""
        if not self._faults:
            return list(packets)
        self._tick += 1
        out = [(data, sender) for due, data, sender in self._late if due <= self._tick]
        self._late = [late for late in self._late if late[0] > self._tick]
        for data, sender in packets:
            out += self._disturbed(t, data, sender)
        return out

    def _disturbed(self, t: float, data: bytes, sender: Any) -> list[tuple[bytes, Any]]:
        copies, wait, number = 1, 0, sequence_of(data)
        for fault in self._faults:
            at = number if fault.counts else t
            copies *= fault.copies(at)
            if fault.operation == "delay":
                wait += int(np.asarray(fault.value)) if fault.start <= at < fault.stop else 0
            elif len(data) == PACKET.size:
                new = int(fault.change(at, np.array([float(number)]))[0])
                data = renumbered(data, new) if new != number else data
        if wait and copies:
            self._late += [(self._tick + wait, data, sender)] * copies
            return []
        return [(data, sender)] * copies
