"""Check the packets that a machine receives: one master (sender) at a time, increasing sequence numbers, a time-out."""

from __future__ import annotations

from twin.core.errors import DeviceError
from twin.simulation.machine.itp import Packet, ahead, unpack

Sender = str | tuple[str, int]
"""Who sent a packet: in a network the address (host, port), in a simulation a name."""


class Receiver:
    """Reads the packets for one arm.

    As in the released software, a packet with sequence number 0 is sent back. If sequence numbers are missing, the
    first packet after the gap is dropped, and the next one is accepted. Unlike in the released software, the checksum
    must be correct, and each sequence number must be after the previous one (1 is after 2^32 - 1, see `itp.ahead`). In
    the released software, a sequence number more than 1000 below the last one restarts the numbering, so that old
    packets are accepted again. A master controls the machine until this master has been silent for `timeout` s.

    Attributes:
        master: address of the sender whose packets are accepted; None: the next sender is accepted.
        timeout: time-out in s.
        accepted, refused: number of packets so far.
        reason: reason for the latest refusal.
        sequence: sequence number of the master's last packet; 0 before the first one.
    """

    def __init__(self, arm: int, version: int, timeout: float) -> None:
        """Set the number of the arm in a packet (0 or 1), the accepted version of packets, and the time-out in s."""
        self._arm = arm
        self._version = version
        self.timeout = timeout
        self.master: Sender | None = None
        self.accepted = 0
        self.refused = 0
        self.reason = ""
        self.sequence = 0
        self._pedal = False
        self._last_heard = float("-inf")  # time in s of the last packet of the master

    def read(self, data: bytes, sender: Sender, t: float) -> Packet | None:
        """Return the content of a packet that arrives at t in s; None: its number is 0, so the caller sends it back.

        Raises:
            DeviceError: the packet is refused; it has no effect.
        """
        try:
            return self._read(data, sender, t)
        except DeviceError as error:
            self.refused += 1
            self.reason = str(error)
            raise

    def _read(self, data: bytes, sender: Sender, t: float) -> Packet | None:
        packet = unpack(data, self._arm, self._version)
        if self.silent(t):
            self.master = None
            self.sequence = 0
        if self.master not in (None, sender):
            raise DeviceError(
                f"{sender} is a second master; {self.master} controls the machine until it has been silent for "
                f"{self.timeout:g} s"
            )
        if packet.sequence == 0:
            return None
        gap = 0  # a new master begins with any number
        if self.master is not None:
            gap = ahead(packet.sequence, self.sequence) - 1
        if gap < 0:
            raise DeviceError(f"the sequence number {packet.sequence} is not after the last one, {self.sequence}")
        self.sequence = packet.sequence
        self.master = sender
        self._last_heard = t
        if gap:
            raise DeviceError(f"{gap} packets are missing before packet {packet.sequence}, which is dropped, too")
        self.accepted += 1
        self._pedal = bool(packet.values[8] > 0)
        return packet

    def silent(self, t: float) -> bool:
        """Return whether no packet of the master has arrived for longer than the time-out."""
        return t - self._last_heard > self.timeout

    def pedal(self, t: float) -> bool:
        """Return whether the pedal is down; a silent master's pedal counts as up."""
        return self._pedal and not self.silent(t)
