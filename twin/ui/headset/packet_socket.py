"""UDP socket for the programs of haptic pens and other input devices; it receives hand states and sends forces."""

from __future__ import annotations

import math
import socket
from collections import deque
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from numpy.typing import ArrayLike

from twin.core.errors import DeviceError, TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.simulation.devices.packets import HAND, Packets
from twin.simulation.devices.received_hands import HandState
from twin.simulation.world import Signals
from twin.simulation.world.signal_kinds import DEVICE_IGNORED, HAND_LOST
from twin.ui.headset.problem_reports import ProblemReports

UDP_OWNER = "udp"
"""Identifier of the owner of the hands if UDP packets move them; the identifiers of clients are c1, c2, ..."""

_MAX_WAITING_PACKETS = 256
"""Maximum number of waiting packets; a flood of packets then does not delay the ticks."""

_REPORT_PAUSE = 5.0
"""Time in s after a problem during which further problems of the same kind are not reported."""

_SILENCE_TIMEOUT = 5.0
"""Time in s without a packet after which the packets no longer own the hands."""

Address = tuple[str, int]


class PacketSocket:
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
        self.device = device
        self.refused = 0
        self.holder: str | None = None
        self.reports = ProblemReports(_REPORT_PAUSE)
        # Of each hand that was moved: the address that controls it, and the time in s of its last packet.
        self._owners: dict[int, tuple[Address, float]] = {}
        self._waiting: deque[tuple[bytes, Address]] = deque()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:  # OverflowError: the port is outside 0 to 65535
            self._socket.close()
            reason: object = error
            if isinstance(error, OSError) and error.strerror:
                reason = error.strerror
            raise TwinError(
                f"cannot listen for packets on {host}:{port}: {reason}; choose another port, or 0 for any"
            ) from error
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]

    def pump(self, t: float, parts: int = 1) -> int:
        """Pass received packets to the device before the tick at time t in s; return the number of accepted packets.

        The ticks of a frame may be computed in several groups; `parts` is the number of remaining groups, including
        this one. Each call passes 1 / `parts` of the waiting packets, so that the hands move in every group.
        """
        while len(self._waiting) < _MAX_WAITING_PACKETS:
            try:
                # One byte more than a packet has: a longer packet is then seen to be too long.
                packet = self._socket.recvfrom(HAND.size + 1)
            except BlockingIOError:  # no packet waits
                break
            except ConnectionResetError:  # Windows: an earlier answer reached no socket
                break
            self._waiting.append(packet)
        share = math.ceil(len(self._waiting) / parts)
        accepted = 0
        for _ in range(share):
            data, address = self._waiting.popleft()
            accepted += self._accept(data, address, t)
        return accepted

    def _accept(self, data: bytes, address: Address, t: float) -> bool:
        """Pass a packet to the device, or refuse it and report why; return whether it was passed."""
        sender = _address_text(address)
        try:
            state = self.device.read(data)
        except DeviceError as error:
            self.reports.report("malformed", t, f"a packet from {sender} is ignored: {error}")
            return False
        refusal = self._refusal(state, address, t)
        if refusal is not None:
            self.refused += 1
            kind, text = refusal
            self.reports.report(kind, t, text)
            return False
        self._owners[state.hand] = (address, t)
        self.device.give(state)
        return True

    def _refusal(self, state: HandState, address: Address, t: float) -> tuple[str, str] | None:
        """Return kind and text of the reason to refuse a packet from an address; None if it is accepted."""
        sender = _address_text(address)
        side = self.device.hands[state.hand]
        owner = self.sender(state.hand, t)
        if self.holder is not None:
            return "held", f"packets from {sender} are ignored: {self.holder} controls the hands; release them there"
        if owner is not None and owner != address:
            until = f"until it is silent for {self.device.patience:g} s"
            return (
                "other",
                f"packets from {sender} are ignored: {_address_text(owner)} controls the {side} hand {until}",
            )
        if owner is None and state.camera:
            pressed = "the camera pedal was pressed in the first packet; release it once"
            return "pedal", f"packets of the {side} hand from {sender} are ignored: {pressed}"
        return None

    def sender(self, hand: int, t: float) -> Address | None:
        """Return the address that controls a hand at time t in s; None if there is none."""
        address, heard = self._owners.get(hand, (None, -math.inf))
        if t - heard > self.device.patience:
            return None
        return address

    @property
    def heard(self) -> float:
        """Time in s of the last accepted packet; minus infinity if no packet has been accepted."""
        latest = -math.inf
        for _, t in self._owners.values():
            latest = max(latest, t)
        return latest

    def answer(self, hand: int, force: ArrayLike, t: float) -> None:
        """Send a force (3,) in N, in the axes of the endoscope's picture {H}, to the address that controls a hand.

        Nothing is sent if no address controls the hand at time t in s.
        """
        owner = self.sender(hand, t)
        if owner is None:
            return
        try:
            self._socket.sendto(self.device.answer(hand, force), owner)
        except OSError:  # the sender has ended or its queue is full; its silence will be reported
            return

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


class PacketHands:
    """Hands of a console that are moved by UDP packets; the senders receive the forces.

    Attributes:
        socket: UDP socket of the packets.
    """

    def __init__(self, device: Packets, host: str, port: int, tell: Callable[[str], object]) -> None:
        """Listen on an address and a port (0: any free port); `tell` receives each problem as a message.

        Raises:
            TwinError: the port is in use.
        """
        self.socket = PacketSocket(device, port, host)
        self.socket.reports.tell = tell

    def silent(self, t: float) -> bool:
        """Return whether no packet was accepted in the last `_SILENCE_TIMEOUT` s before time t in s."""
        return t - self.socket.heard > _SILENCE_TIMEOUT

    def answer(self, forces: Sequence[Array], t: float) -> None:
        """Send each hand its force (3,) in N, in the axes of the endoscope's picture {H}, at time t in s."""
        for hand, force in enumerate(forces):
            self.socket.answer(hand, force, t)

    def state(self, t: float, signals: Signals) -> JsonObject:
        """Return port, senders at time t in s, and numbers of lost and ignored packets, as an entry of `state`."""
        device = self.socket.device
        senders: dict[str, str | None] = {}
        lost_packets: dict[str, int] = {}
        for hand, name in enumerate(device.hands):
            sender = self.socket.sender(hand, t)
            senders[name] = None if sender is None else _address_text(sender)
            lost_packets[name] = int(signals[HAND_LOST.of(name)][0])
        ignored = int(signals[DEVICE_IGNORED.of(device.device)][0])
        return {
            "port": self.socket.port,
            "from": senders,
            "lost": lost_packets,
            "ignored": ignored + self.socket.refused,
        }


def _address_text(address: Address) -> str:
    host, port = address
    return f"{host}:{port}"
