"""Connection to a machine: sends packets by UDP, one per millisecond, and receives states by TCP.

Two threads send and receive, so that the packets have equal intervals even if the calling program is late: packets that
arrive together would make the machine jump.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from twin.core.errors import DeviceError
from twin.simulation.machine.machine_server import HOST
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.state_packets import State, size, unpack

PATIENCE = 0.5
"""Time in s without a new state after which the machine counts as disconnected (ASSUMED)."""

_CONNECT = 5.0
"""Maximum time in s to connect."""

_WAITING = 200
"""Maximum number of packets that wait to be sent; if there are more, the oldest are dropped."""

_BEHIND = 20
"""Number of waiting packets above which two packets are sent in each millisecond."""

_REFUSED = 50
"""Number of successive refused packets after which another master (sender of packets) is reported."""


@dataclass(frozen=True)
class Address:
    """Address of a machine: host, port of packets (UDP) and port of states (TCP)."""

    host: str
    port: int
    state_port: int

    @classmethod
    def parse(cls, text: str) -> Address:
        """Return the address for a text "HOST:PORT:STATEPORT" or "PORT:STATEPORT".

        Raises:
            DeviceError: the text has another form, or a port is not 1 to 65535.
        """
        parts = text.rsplit(":", 2)
        if len(parts) == 2:
            parts = [HOST, *parts]
        if len(parts) != 3 or not parts[0] or not all(map(_is_number, parts[1:])):
            raise DeviceError(
                f"'{text}' is not the address of a machine: give HOST:PORT:STATEPORT, such as 127.0.0.1:36000:36001"
            )
        port = int(parts[1])
        state_port = int(parts[2])
        for number in (port, state_port):
            if not 0 < number < 65536:
                raise DeviceError(f"'{text}': the port {number} must be 1 to 65535")
        return cls(parts[0], port, state_port)


def _is_number(text: str) -> bool:
    """Return whether a text has 1 to 9 digits; other digits than 0 to 9, such as "²", cannot be converted by `int`."""
    return text.isascii() and text.isdigit() and len(text) < 10


class StateReader:
    """Reads the states of a machine in a thread.

    Attributes:
        newest: the newest state; None before the first one.
        problem: reason why no more states are read; "": states are read.
        heard: function that the thread calls with each state; None: none.
    """

    def __init__(self, host: str, port: int, n: int) -> None:
        """Connect to the port at which a machine of n joints sends its states.

        Raises:
            DeviceError: nothing answers at this address.
        """
        self.newest: State | None = None
        self.problem = ""
        self.heard: Callable[[State], None] | None = None
        self._address = f"{host}:{port}"
        self._n = n
        self._silent = False
        try:
            self._socket = socket.create_connection((host, port), _CONNECT)
        except (OSError, UnicodeError) as error:  # UnicodeError: a name that no host can have, such as "a..b"
            reason = getattr(error, "strerror", None) or error
            raise DeviceError(
                f"no machine sends states at {host}:{port}: {reason}; start the machine, for example with `twin "
                f"machine raven_left --state-port {port}`"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(PATIENCE)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def answers(self) -> bool:
        """Whether a state has arrived since the thread last waited `PATIENCE` seconds in vain.

        The thread measures the silence, not the caller: after a pause of the whole program, the states that arrived in
        the pause wait in the socket, and the machine was never silent.
        """
        return not self.problem and self.newest is not None and not self._silent

    def press(self, button: str) -> None:
        """Press the button "start" or "stop" of the machine."""
        with contextlib.suppress(OSError):
            self._socket.sendall(button.encode() + b"\n")

    def close(self) -> None:
        """Close the connection."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(1.0)
        self._socket.close()

    def _run(self) -> None:
        buffer = b""
        length = size(self._n)
        try:
            while True:
                try:
                    received = self._socket.recv(1 << 16)
                except TimeoutError:
                    self._silent = True
                    continue
                if not received:
                    raise DeviceError("the machine has closed the connection: start it again, and connect again")
                buffer += received
                while len(buffer) >= length:
                    self._read(buffer[:length])
                    buffer = buffer[length:]
        except (DeviceError, OSError) as error:
            self.problem = f"states from {self._address}: {error}"

    def _read(self, data: bytes) -> None:
        state = unpack(data, self._n)
        last = self.newest
        if last is not None and not (state.t > last.t and state.tick > last.tick):
            raise DeviceError(
                f"the clock of the machine went back from {last.t:g} s (tick {last.tick}) to {state.t:g} s "
                f"(tick {state.tick}): connect again"
            )
        self.newest = state
        self._silent = False
        if self.heard is not None:
            self.heard(state)


class MachineLink:
    """Controls a machine as its master (sender of packets), and stores the newest state of the machine.

    Attributes:
        reader: reads the states of the machine, and presses its buttons.
        sent: number of packets sent so far.
        dropped: number of packets dropped because too many were waiting.
    """

    def __init__(self, address: Address, n: int) -> None:
        """Connect to a machine of n joints.

        Raises:
            DeviceError: nothing answers at this address.
        """
        self.reader = StateReader(address.host, address.state_port, n)
        self._address = (address.host, address.port)
        self._waiting = deque[bytes]()
        self._udp = socket.socket(type=socket.SOCK_DGRAM)
        self._ends = threading.Event()
        self.sent = 0
        self.dropped = 0
        self._accepted = -1  # packets that the machine had accepted in its newest state
        self._refused = 0  # packets that it had refused when it last accepted one
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def room(self) -> int:
        """Number of packets that may be added while the link still sends only one per millisecond."""
        return max(_BEHIND - 1 - len(self._waiting), 0)

    def send(self, packet: bytes) -> None:
        """Add a packet to the queue, from which one packet is sent per millisecond; two, if there is no `room`."""
        if len(self._waiting) >= _WAITING:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(packet)

    @property
    def state(self) -> State | None:
        """The newest state; None: the machine does not answer."""
        if not self.reader.answers:
            return None
        return self.reader.newest

    @property
    def problem(self) -> str:
        """Reason why the machine cannot be controlled; "" if it can."""
        if self.reader.problem:
            return self.reader.problem
        state = self.state
        if state is None:
            return f"no state has come for {PATIENCE:g} s: the machine is stopped or busy"
        if state.accepted > self._accepted:
            self._accepted = state.accepted
            self._refused = state.refused
        elif state.refused - self._refused > _REFUSED:
            return (
                "the machine refuses all packets, because another program controls it. End that program; the machine "
                "accepts another sender after `master_timeout` seconds without packets (machine.toml)"
            )
        return ""

    def close(self) -> None:
        """End both threads, and close all sockets."""
        self._ends.set()
        self._thread.join(1.0)
        self._udp.close()
        self.reader.close()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ends.is_set():
            # After a pause, at most ten packets are sent in quick succession.
            due = max(due + TICK, time.monotonic() - 10 * TICK)
            self._send_one()
            if len(self._waiting) >= _BEHIND:  # the queue grows if its program runs faster than real time
                self._send_one()
            time.sleep(max(due - time.monotonic(), 0))

    def _send_one(self) -> None:
        if not self._waiting:
            return
        with contextlib.suppress(OSError):
            self._udp.sendto(self._waiting.popleft(), self._address)
            self.sent += 1
