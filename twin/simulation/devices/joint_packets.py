"""Joint values of any machine by UDP: one datagram for each state.

A packet has 24 + 8 n bytes for n joints, or 24 + 16 n with desired joint values, little-endian:

| byte | type | what |
|---|---|---|
| 0 | 4 bytes | "TWNJ" |
| 4 | uint8 | version: 1 |
| 5 | uint8 | number of joints n, in the order of the robot's active joints |
| 6 | uint16 | 1: measured joints only; 2: desired joints follow |
| 8 | uint64 | number of the packet, which increases |
| 16 | float64 | time of the sender in s, which increases |
| 24 | n float64 | measured joint values, rad or m |
| 24 + 8 n | n float64 | desired joint values, rad or m |
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time

import numpy as np

from twin.core.errors import DeviceError
from twin.core.spatial import Array
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import PATIENCE
from twin.simulation.machine.machine_server import HOST
from twin.simulation.machine.receiver import Sender
from twin.simulation.machine.state_packets import State

HEAD = struct.Struct("<4sBBHQd")

_MAGIC = b"TWNJ"
_VERSION = 1

_LARGEST_BATCH = 256
"""Largest number of packets read at once."""


def pack(number: int, t: float, q: Array, desired: Array | None = None) -> bytes:
    """Return a packet with its number, time t in s, measured joint values (n,), and optionally desired ones (n,)."""
    rows = [q] if desired is None else [q, desired]
    head = HEAD.pack(_MAGIC, _VERSION, len(q), len(rows), number, t)
    return head + np.concatenate(rows).astype("<f8").tobytes()


def unpack(data: bytes, n: int) -> tuple[int, float, Array, Array | None]:
    """Return a packet's number, time in s, measured joint values (n,), and desired joint values (n,) or None.

    Raises:
        DeviceError: the length, the first four bytes, the version, or the number of joints or rows is wrong; or the
            time or a joint value is not finite.
    """
    if len(data) < HEAD.size:
        raise DeviceError(f"the packet has {len(data)} bytes; it must have at least {HEAD.size}")
    magic, version, joints, rows, number, t = HEAD.unpack_from(data)
    if magic != _MAGIC:
        raise DeviceError(f"the packet begins with {magic!r}; it must begin with {_MAGIC!r}")
    if version != _VERSION:
        raise DeviceError(f"the version is {version}; it must be {_VERSION}")
    if joints != n:
        raise DeviceError(f"the packet has {joints} joints; the robot has {n}")
    if rows not in (1, 2):
        raise DeviceError(f"the number of rows is {rows}; it must be 1 (measured) or 2 (measured and desired)")
    size = HEAD.size + 8 * rows * n
    if len(data) != size:
        raise DeviceError(f"the packet has {len(data)} bytes; it must have {size}")
    values = np.frombuffer(data, "<f8", rows * n, HEAD.size).astype(float).reshape(rows, n)
    if not (np.isfinite(values).all() and np.isfinite(t)):
        raise DeviceError(f"a value in packet {number} is not finite")
    desired = values[1] if rows == 2 else None
    return number, t, values[0], desired


class JointPackets:
    """Receives joint values from one sender, until this sender has been silent for `PATIENCE` seconds.

    Attributes:
        port: the UDP port.
        accepted, refused: number of accepted and of refused packets so far.
        reason: why the last refused packet was refused.
    """

    def __init__(self, port: int, n: int) -> None:
        """Open a port (0: any free one) for the packets of a machine of n joints.

        Raises:
            DeviceError: the port is in use or may not be opened.
        """
        self._socket = socket.socket(type=socket.SOCK_DGRAM)
        self._n = n
        try:
            self._socket.bind((HOST, port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(f"UDP port {port} of {HOST}: {error.strerror}; give another port") from error
        self._socket.setblocking(False)  # `newest` is called in every tick and must not wait
        self.port = int(self._socket.getsockname()[1])
        self.accepted = 0
        self.refused = 0
        self.reason = ""
        self._sender: Sender | None = None
        self._last_number = -1
        self._last_time = float("-inf")
        self._last_arrival = float("-inf")
        self._state: State | None = None

    def read(self, data: bytes, sender: Sender, arrival: float) -> None:
        """Read a packet that has arrived at `arrival` in s.

        Raises:
            DeviceError: the packet is refused; it has no effect.
        """
        number, t, q, desired = unpack(data, self._n)
        if arrival - self._last_arrival > PATIENCE:
            # another sender may follow, with its own numbers and clock
            self._sender = None
            self._last_number = -1
            self._last_time = float("-inf")
        if self._sender not in (None, sender):
            raise DeviceError(
                f"{sender} is a second sender; {self._sender} is followed until it has been silent for {PATIENCE:g} s"
            )
        if number <= self._last_number:
            raise DeviceError(f"the packet number {number} is not above the previous one, {self._last_number}")
        if not t > self._last_time:
            if t < self._last_time:
                raise DeviceError(f"the clock went back from {self._last_time:g} s to {t:g} s")
            raise DeviceError(f"the clock did not advance: {self._last_time:g} s was followed by {t:g} s")
        self._sender = sender
        self._last_number = number
        self._last_time = t
        self._last_arrival = arrival
        self.accepted += 1
        counts = (number, self.accepted, self.refused, 0, 0)
        desired_q = q if desired is None else desired
        self._state = State(Level.PEDAL_DN, False, number, t, *counts, q, desired_q, np.zeros_like(q))

    @property
    def newest(self) -> State | None:
        """The newest state, after reading all packets that have arrived; None before the first one."""
        with contextlib.suppress(BlockingIOError):
            # with a limit, because a fast sender could otherwise keep the tick from ending
            for _ in range(_LARGEST_BATCH):
                data, sender = self._socket.recvfrom(1 << 16)
                try:
                    self.read(data, sender, time.monotonic())
                except DeviceError as error:
                    self.refused += 1
                    self.reason = str(error)
        return self._state

    @property
    def answers(self) -> bool:
        """Whether a packet has been accepted within the last `PATIENCE` seconds."""
        return time.monotonic() - self._last_arrival < PATIENCE

    @property
    def problem(self) -> str:
        """Reason why the last packet was refused; "" if a packet was accepted within the last `PATIENCE` seconds."""
        if self.reason and not self.answers:
            return f"packets are refused: {self.reason}"
        return ""

    def close(self) -> None:
        """Close the port."""
        self._socket.close()
