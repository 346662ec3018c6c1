"""Signals of a machine that faults can change, and the faults of one machine.

| signal | numbers | where the fault acts |
|---|---|---|
| wire | sequence number | before a packet is checked |
| packet | `itp.FIELDS` | after a packet has been accepted |
| usb | number of bytes of a read | at the USB board; if the number is not `BYTES`, the software keeps the old counts |
| encoder | counts of each motor | before the software reads them |
| level | run level | as the software reads it from the PLC |
| tool | desired position of the tool, x, y, z in base, µm | while the pedal is down |
| joints | desired joint values, rad or m | while the motors are on |
| dac | counts of each motor | after the checks of the software |
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.itp import Packet
from twin.simulation.machine.receiver import Receiver

LOCATIONS = {
    "wire": "network",
    "packet": "network",
    "usb": "USB read",
    "encoder": "USB read",
    "level": "control state",
    "tool": "control state",
    "joints": "control state",
    "dac": "USB write",
}
"""Signals that faults can change, each with its place in the machine."""

LOSABLE = ("wire", "packet")
"""Signals that faults can lose or repeat."""

BYTES = 27
"""Number of bytes of a USB board's packet; the software ignores a read of any other length (uw-biorobotics/raven2)."""


class MachineFaults:
    """The faults of one machine, by the signals that they change."""

    def __init__(self, faults: Iterable[Fault], receiver: Receiver) -> None:
        """Store the faults, and the receiver, by whose packets those are timed that count packets.

        Raises:
            WorldError: a fault has an unknown signal, or loses or repeats a signal that is not a packet.
        """
        self._receiver = receiver
        self._by_signal: dict[str, list[Fault]] = {}
        for signal in LOCATIONS:
            self._by_signal[signal] = []
        for fault in faults:
            if fault.signal not in LOCATIONS:
                raise WorldError(unknown("signal of the machine", fault.signal, LOCATIONS))
            if fault.operation in ("skip", "duplicate") and fault.signal not in LOSABLE:
                raise WorldError(f"fault of {fault.signal}: {fault.operation} is possible for packets only; use hold")
            self._by_signal[fault.signal].append(fault)

    def of(self, signal: str) -> Sequence[Fault]:
        """Return the faults of a signal, in the order in which they act."""
        return self._by_signal[signal]

    def changed(self, signal: str, t: float, value: Array) -> Array:
        """Return the value (n,) of a signal as its faults leave it at t in s."""
        for fault in self._by_signal[signal]:
            time_or_sequence = self._receiver.sequence if fault.counts else t
            value = fault.change(time_or_sequence, value)
        return value

    def changed_packet(self, packet: Packet, t: float) -> list[Packet]:
        """Return an accepted packet as its faults leave it at t in s: none, one, or several."""
        values = packet.values
        copies = 1
        for fault in self._by_signal["packet"]:
            time_or_sequence = packet.sequence if fault.counts else t
            copies *= fault.copies(time_or_sequence)
            values = fault.change(time_or_sequence, values)
        return [packet._replace(values=values)] * copies
