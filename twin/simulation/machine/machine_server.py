"""A machine in real time: packets by UDP, states and buttons by TCP, both on 127.0.0.1.

Each connection gets every state (`states`), and may send the lines "start" and "stop", which press the buttons of the
machine. A connection that sends any other line is closed at once: a web page can send an HTTP request to this port,
with a line "start" in its body. A connection that reads too slowly, so that its socket is full, is closed.
"""

from __future__ import annotations

import contextlib
import gc
import socket
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from twin.core.errors import DeviceError
from twin.simulation.machine.itp import PACKET
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.simulated_machine import Machine
from twin.simulation.machine.state_packets import State, pack

HOST = "127.0.0.1"

READERS = 32
"""Maximum number of connections for states."""

_NEW = 4
"""Maximum number of connections accepted in one tick, so that many new ones do not delay the tick."""

_PACKETS = 2
"""Maximum number of packets read in one tick, so that waiting packets do not move the arm all at once."""

_ASK = 50
"""Number of ticks between two calls of `ends`."""

RECENT = 600_000
"""Number of the latest ticks (10 minutes) whose delays are stored, so that a long run needs constant memory."""

_LINE = 64
"""Maximum length in bytes of a line from a connection."""

_VERBS = ("GET", "HEAD", "POST", "PUT", "DELETE", "CONNECT", "OPTIONS", "TRACE", "PATCH")
"""Methods of HTTP, with which a request begins."""


class Pace:
    """Counts the ticks and records their delays.

    Attributes:
        ticks, missed: number of all ticks, and number of ticks that began more than one tick late.
        late: delays in s of the starts of the latest `RECENT` ticks.
        largest: largest delay in s of all ticks.
    """

    def __init__(self) -> None:
        self.ticks = 0
        self.missed = 0
        self.late = deque[float](maxlen=RECENT)
        self.largest = 0.0

    def add(self, late: float) -> None:
        """Add a tick that began `late` s after its time."""
        self.ticks += 1
        self.missed += late > TICK
        self.largest = max(self.largest, late)
        self.late.append(late)

    def summary(self) -> dict[str, float]:
        """Return numbers of ticks and of late ticks, and delays in ms: percentiles of recent ticks, maximum of all."""
        late = 1e3 * np.array(self.late or [0.0])
        return {
            "ticks": self.ticks,
            "late": self.missed,
            "p50_ms": float(np.percentile(late, 50)),
            "p99_ms": float(np.percentile(late, 99)),
            "max_ms": 1e3 * self.largest,
        }


class Server:
    """Runs a machine in real time, with sockets for packets and states.

    Attributes:
        machine: the machine.
        port, state_port: ports of the packets (UDP) and of the states (TCP).
        pace: delays of the ticks.
        refusal: why the latest refused connection was closed; "" if none was refused.
    """

    def __init__(self, machine: Machine, port: int = 0, state_port: int = 0) -> None:
        """Open both ports; for port 0, a free port is used.

        Raises:
            DeviceError: a port is in use or may not be opened.
        """
        self.machine = machine
        self.pace = Pace()
        self.refusal = ""
        self._readers: dict[socket.socket, bytes] = {}  # connections, each with the begin of its next line
        self._udp = socket.socket(type=socket.SOCK_DGRAM)
        self._tcp = socket.socket()
        self._tcp.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        for kind, sock, requested_port in (("UDP", self._udp, port), ("TCP", self._tcp, state_port)):
            try:
                sock.bind((HOST, requested_port))
            except OSError as error:
                self.close()
                reason = error.strerror
                raise DeviceError(f"{kind} port {requested_port} of {HOST}: {reason}; give another port") from error
            sock.setblocking(False)
        self._tcp.listen(READERS)
        self.port = self._udp.getsockname()[1]
        self.state_port = self._tcp.getsockname()[1]

    def close(self) -> None:
        """Close all sockets."""
        for sock in (self._udp, self._tcp, *self._readers):
            sock.close()

    def run(
        self,
        seconds: float = float("inf"),
        tell: Callable[[str], None] = lambda text: None,
        ends: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run for a time in s, or until `ends` returns True; `ends` is called 20 times per second.

        `tell` is called with a line of text for each change of the run level, with a reason in E_STOP, and for each new
        reason to refuse a connection.
        """
        gc.freeze()  # without this, garbage collection checks all imported modules, which takes many ticks
        begin = time.monotonic()
        level = None  # as last reported
        refusal = self.refusal
        tick = 0
        while tick * TICK < seconds and not (tick % _ASK == 0 and ends()):
            t = tick * TICK
            due = begin + t
            wait = due - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            self.pace.add(max(time.monotonic() - due, 0.0))
            self.step(t)
            if self.machine.plc.level != level:
                level = self.machine.plc.level
                line = f"{t:.3f} s: {level.name}"
                if self.machine.reason:
                    line += f": {self.machine.reason}"
                tell(line)
            if self.refusal != refusal:
                refusal = self.refusal
                tell(f"{t:.3f} s: {refusal}")
            tick += 1

    def step(self, t: float) -> None:
        """Run one tick at t in s: read packets and buttons, move the machine, send the state."""
        self._buttons()
        for data, sender in self.machine.step(t, self._arrived()):
            with contextlib.suppress(OSError):
                self._udp.sendto(data, sender)
        self._send(self._state())

    def _arrived(self) -> list[tuple[bytes, tuple[str, int]]]:
        packets = []
        with contextlib.suppress(BlockingIOError):
            while len(packets) < _PACKETS:
                # One byte more than a packet, so that a datagram that is too long is refused.
                packets.append(self._udp.recvfrom(PACKET.size + 1))
        return packets

    def _buttons(self) -> None:
        self._accept()
        for reader, text in list(self._readers.items()):
            try:
                received = reader.recv(_LINE)
            except BlockingIOError:
                continue
            except OSError:
                received = b""
            *lines, incomplete_line = (text + received).split(b"\n")
            refused = False
            for line in lines:
                if not self._press(line.strip()):
                    refused = True
                    break
            ended = not received
            if refused or ended or len(incomplete_line) > _LINE:
                self._drop(reader)
            else:
                self._readers[reader] = incomplete_line

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # nobody connects, or a connection was aborted before it was accepted
            for _ in range(_NEW):
                reader, _ = self._tcp.accept()
                if len(self._readers) == READERS:
                    self.refusal = f"a connection was closed: there are {READERS} connections, the maximum"
                    reader.close()
                    continue
                reader.setblocking(False)
                reader.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._readers[reader] = b""

    def _press(self, line: bytes) -> bool:
        """Press the button that a line from a connection names; return False if the line names none."""
        if line == b"start":
            self.machine.start()
        elif line == b"stop":
            self.machine.stop()
        else:
            self.refusal = _refusal(line)
            return False
        return True

    def _drop(self, reader: socket.socket) -> None:
        del self._readers[reader]
        reader.close()

    def _state(self) -> bytes:
        machine = self.machine
        receiver = machine.receiver
        state = State(
            level=machine.plc.level,
            pedal=receiver.pedal(machine.t),
            tick=machine.tick,
            t=machine.t,
            sequence=receiver.sequence,
            accepted=receiver.accepted,
            refused=receiver.refused,
            held=machine.held,
            late=self.pace.missed,
            q=machine.q,
            wanted=machine.wanted,
            dac=machine.dac,
        )
        return pack(state)

    def _send(self, state: bytes) -> None:
        for reader in list(self._readers):
            try:
                is_sent = reader.send(state) == len(state)
            except OSError:
                is_sent = False
            if not is_sent:
                self._drop(reader)


def _refusal(line: bytes) -> str:
    """Return why a line from a connection is refused."""
    text = line[:_LINE].decode("ascii", "backslashreplace")
    verb = text.split(" ")[0]
    what = f"the line {text!r}"
    if verb in _VERBS:
        what = f"an HTTP request ({verb})"
    return f"a connection was closed: it sent {what}; only the lines 'start' and 'stop' are accepted"
