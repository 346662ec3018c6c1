"""UDP socket for the programs of haptic pens and other input devices; it receives hand states and sends forces."""

from __future__ import annotations

import math
import socket
from collections import deque
from types import TracebackType
from typing import Self

from numpy.typing import ArrayLike

from twin.core.errors import DeviceError, TwinError
from twin.simulation.devices.packets import HAND, Packets
from twin.ui.door.reports import Reports

_MOST = 256
"""Maximum number of waiting packets; a flood of packets then does not delay the ticks."""

_QUIET = 5.0
"""Time in s after a problem during which further problems of the same kind are not reported."""

Address = tuple[str, int]


class PacketDoor:
    """A UDP socket whose packets move the hands of the device `Packets`.

    The caller of `World.step` must call `pump` before each group of ticks. The address that first sends a packet for a
    hand controls this hand; the control ends when the address is silent for longer than `device.patience` s. By
    default, only programs on this machine can send packets.

    Attributes:
        port: port on which the socket listens.
        holder: name of another device that controls the hands; None: no other device. While a name is set, all packets
            are refused.
        refused: number of well-formed packets that were refused. A packet is refused if another address or device
            controls the hand, or if it is the first packet for a hand and its camera pedal is pressed.
        reports: reporter of refused and malformed packets.
    """

    def __init__(self, device: Packets, port: int = 0, host: str = "127.0.0.1") -> None:
        """Listen on a port; 0 means any free port.

        Raises:
            TwinError: the port is in use, or host or port is invalid.
        """
        self.device, self.refused = device, 0
        self.holder: str | None = None
        self.reports = Reports(_QUIET)
        self._owners: dict[int, tuple[Address, float]] = {}
        self._waiting: deque[tuple[bytes, Address]] = deque()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            why = error.strerror if isinstance(error, OSError) and error.strerror else error
            raise TwinError(
                f"cannot listen for packets on {host}:{port}: {why}; choose another port, or 0 for any"
            ) from error
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]

    def pump(self, t: float, parts: int = 1) -> int:
        """Pass received packets to the device before the tick at time t in s; return the number of accepted packets.

        The ticks of a frame may be computed in several groups; `parts` is the number of remaining groups, including
        this one. Each call passes 1 / `parts` of the waiting packets, so that the hands move in every group.
        """
        while len(self._waiting) < _MOST:
            try:
                self._waiting.append(self._socket.recvfrom(HAND.size + 1))
            except (BlockingIOError, ConnectionResetError):
                break
        share = math.ceil(len(self._waiting) / parts)
        return sum(self._take(*self._waiting.popleft(), t) for _ in range(share))

    def _take(self, data: bytes, address: Address, t: float) -> bool:
        """Pass a packet to the device, or refuse it and report why."""
        sender = f"{address[0]}:{address[1]}"
        try:
            state = self.device.read(data)
        except DeviceError as error:
            self.reports.report("malformed", t, f"a packet from {sender} is ignored: {error}")
            return False
        side = self.device.hands[state.hand]
        owner = self.sender(state.hand, t)
        refusal = None
        if self.holder is not None:
            refusal = "held", f"packets from {sender} are ignored: {self.holder} controls the hands; release them there"
        elif owner is not None and owner != address:
            held = f"{owner[0]}:{owner[1]} controls the {side} hand until it is silent for {self.device.patience:g} s"
            refusal = "stranger", f"packets from {sender} are ignored: {held}"
        elif owner is None and state.camera:
            pressed = "the camera pedal was pressed in the first packet; release it once"
            refusal = "pedal", f"packets of the {side} hand from {sender} are ignored: {pressed}"
        if refusal is not None:
            self.refused += 1
            self.reports.report(refusal[0], t, refusal[1])
            return False
        self._owners[state.hand] = address, t
        self.device.give(state)
        return True

    def sender(self, hand: int, t: float) -> Address | None:
        """Return the address that controls a hand at time t in s; None if there is none."""
        address, heard = self._owners.get(hand, (None, -math.inf))
        return address if t - heard <= self.device.patience else None

    @property
    def heard(self) -> float:
        """Time in s of the last accepted packet; minus infinity if no packet has been accepted."""
        return max((t for _, t in self._owners.values()), default=-math.inf)

    def answer(self, hand: int, force: ArrayLike, t: float) -> None:
        """Send a force (3,) in N, in the axes of the endoscope's picture {H}, to the address that controls a hand.

        Nothing is sent if no address controls the hand at time t in s.
        """
        if (owner := self.sender(hand, t)) is None:
            return
        try:
            self._socket.sendto(self.device.answer(hand, force), owner)
        except OSError:  # the sender is gone or its queue is full; its silence will be reported
            return

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
