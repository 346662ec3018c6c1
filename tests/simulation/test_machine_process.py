"""`twin machine` as a process, with a master written by hand: struct and socket, no code of twin."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.slow

PACKET = "<III iiiiii dddddddd ii ii i i"
STATE = "<4sBBBBQdIIIIII"
E_STOP, INIT, PEDAL_UP, PEDAL_DN = range(4)


class Machine:
    """The process, its ports, and the lines that it prints."""

    def __init__(self, *options):
        command = [sys.executable, "-m", "twin", "machine", "raven_left", "--quiet", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        words = self.process.stdout.readline().replace(":", " ").split()
        ports = [int(w) for w in words if w.isdigit()]
        self.udp, self.tcp = ports

    def end(self):
        self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="module")
def shared():
    """One machine for the tests that leave it running; its master's time-out is 0.5 s."""
    machine = Machine("--start", "--master-timeout-ms", "500")
    yield machine
    machine.end()


@pytest.fixture(scope="module")
def patient():
    """A machine whose master keeps it: whatever pause the master makes, no time-out ends its control."""
    machine = Machine("--start", "--master-timeout-ms", "1000000")
    states = States(machine)
    states.until(lambda s: s[0] == PEDAL_UP)
    master = Master(machine)
    yield machine, master, states
    master.socket.close()
    states.socket.close()
    machine.end()


class States:
    """A connection for states and buttons."""

    def __init__(self, machine):
        self.socket = socket.create_connection(("127.0.0.1", machine.tcp), timeout=60)
        self.buffer = b""

    def next(self):
        """Return (level, pedal, tick, t, sequence, accepted, refused, joints, desired joints, DAC)."""
        size = 48 + 24 * 7
        while len(self.buffer) < size:
            more = self.socket.recv(65536)
            if not more:
                raise ConnectionError("the machine has gone")
            self.buffer += more
        data, self.buffer = self.buffer[:size], self.buffer[size:]
        magic, version, level, pedal, n, tick, t, sequence, accepted, refused, *_ = struct.unpack(STATE, data[:48])
        assert (magic, version, n) == (b"TWNM", 1, 7)
        numbers = struct.unpack("<21d", data[48:])
        return level, pedal, tick, t, sequence, accepted, refused, numbers[:7], numbers[7:14], numbers[14:]

    def until(self, condition, seconds=60):
        """Return the first state that meets a condition."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            state = self.next()
            if condition(state):
                return state
        raise AssertionError(f"not within {seconds} s; the last state is {state}")

    def latest(self):
        """Return the newest state: one that was sent after this call began."""
        now = time.monotonic()
        while True:
            state = self.next()
            if not self.buffer and time.monotonic() - now > 0.02:
                return state


class Master:
    """Sends packets as the protocol's documentation says."""

    def __init__(self, machine):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(60)
        self.address, self.sequence = ("127.0.0.1", machine.udp), 0

    def packet(self, dx=0, pedal=1, sequence=None, version=0, wrong=0):
        if sequence is None:
            self.sequence += 1
            sequence = self.sequence
        total = pedal + dx + sequence + wrong
        none = [0.0, 0.0]
        steps = (dx, 0, 0, 0, 0, 0)
        turns = (*none, *none, *none, 1.0, 1.0)
        return struct.pack(PACKET, sequence, 0, version, *steps, *turns, 0, 0, 0, 0, pedal, total)

    def send(self, data):
        self.socket.sendto(data, self.address)


@pytest.fixture
def desk(shared):
    """A master and a connection; the machine is initialised and no other master has it."""
    states = States(shared)
    states.socket.sendall(b"start\n")
    begun = states.until(lambda s: s[0] == PEDAL_UP)
    states.until(lambda s: s[2] > begun[2] + 600)  # the time-out of the last master, in ticks of 1 ms
    master = Master(shared)
    yield master, states
    master.socket.close()
    states.socket.close()


def press(master, states):
    end = time.monotonic() + 60
    while states.latest()[0] != PEDAL_DN:
        master.send(master.packet())
        assert time.monotonic() < end
    for _ in range(20):  # the software reads the level three times before it counts
        master.send(master.packet())
        time.sleep(0.002)
    states.until(lambda s: s[4] == master.sequence)


def test_packets_by_hand_move_the_arm(patient):
    _, master, states = patient
    press(master, states)
    before = states.latest()
    for _ in range(200):
        master.send(master.packet(dx=20))
        time.sleep(0.001)
    after = states.until(lambda s: s[4] == master.sequence)
    assert after[6] == before[6], "a good packet was refused"
    assert after[5] - before[5] == 200
    settled = states.until(lambda s: s[2] > after[2] + 50)
    moved = [abs(a - b) for a, b in zip(settled[7], before[7], strict=True)]
    assert max(moved) > 0.01
    assert max(abs(a - b) for a, b in zip(settled[7][:2], settled[8][:2], strict=True)) < 0.02


@pytest.mark.parametrize("kind", ["checksum", "version", "short", "replay", "older", "second master"])
def test_bad_packets_have_no_effect(patient, kind):
    machine, master, states = patient
    press(master, states)
    good = master.packet(dx=100)
    master.send(good)
    came = states.until(lambda s: s[4] == master.sequence)
    before = states.until(lambda s: s[2] > came[2] + 50)
    other = Master(machine)
    bad = {
        "checksum": lambda: master.send(master.packet(dx=500, wrong=1)),
        "version": lambda: master.send(master.packet(dx=500, version=7)),
        "short": lambda: master.send(master.packet(dx=500)[:100]),
        "replay": lambda: master.send(good),
        "older": lambda: master.send(master.packet(dx=500, sequence=master.sequence - 5)),
        "second master": lambda: other.send(other.packet(dx=500, sequence=master.sequence + 1)),
    }[kind]
    number = master.sequence
    bad()
    after = states.until(lambda s: s[6] == before[6] + 1)
    other.socket.close()
    assert after[5] == before[5]
    assert after[4] == number
    assert max(abs(a - b) for a, b in zip(after[8], before[8], strict=True)) < 1e-9
    assert after[0] == PEDAL_DN


def test_number_0_comes_back_and_moves_nothing(desk):
    master, states = desk
    data = master.packet(dx=500, sequence=0)
    master.send(data)
    assert master.socket.recv(200) == data
    assert states.latest()[0] == PEDAL_UP


def test_the_stop_button_and_the_start_button(desk):
    master, states = desk
    press(master, states)
    states.socket.sendall(b"stop\n")
    stopped = states.until(lambda s: s[0] == E_STOP)
    master.send(master.packet(dx=500))
    later = states.until(lambda s: s[4] == master.sequence)
    assert later[0] == E_STOP
    assert later[9] == (0,) * 7
    assert max(abs(a - b) for a, b in zip(later[7][:3], stopped[7][:3], strict=True)) < 2e-3
    states.socket.sendall(b"start\n")
    states.until(lambda s: s[0] == INIT)


BODY = b"\nstart\n"
FOREIGN = {
    "fetch": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: text/plain\r\nContent-Length: 7\r\n\r\n" + BODY,
    "form": b"POST /start HTTP/1.1\r\nContent-Type: application/x-www-form-urlencoded\r\n\r\nx=" + BODY,
    "image": b"GET /%0Astart%0A HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" + BODY,
    "WebSocket": b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n" + BODY,
    "an old browser": b"GET /\n" + BODY,
    "beacon": b"PUT / HTTP/2\n" + BODY,
    "an empty line": BODY,
    "another word": b"restart" + BODY,
    "no text": b"\x16\x03\x01\xff\n" + BODY,
    "a long line": 100 * b"x" + BODY,
}


@pytest.mark.parametrize("request_", FOREIGN)
def test_a_request_of_another_protocol_presses_no_button(desk, shared, request_):
    _, states = desk
    states.socket.sendall(b"stop\n")
    states.until(lambda s: s[0] == E_STOP)
    for pieces in ([FOREIGN[request_]], FOREIGN[request_].splitlines(keepends=True)):
        stranger = socket.create_connection(("127.0.0.1", shared.tcp), timeout=10)
        with stranger, contextlib.suppress(ConnectionError):
            stranger.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for piece in pieces:
                stranger.sendall(piece)
            while stranger.recv(65536):  # until the machine closes the connection
                pass
    seen = states.latest()
    assert states.until(lambda s: s[2] > seen[2] + 200)[0] == E_STOP
    states.socket.sendall(b"start\n")
    states.until(lambda s: s[0] == INIT)


def test_a_killed_master_is_noticed_and_the_arm_holds(shared, desk):
    """The master is another process, which sends until kill -9."""
    _, states = desk
    code = (
        "import socket, struct, time\n"
        "s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n"
        "for k in range(1, 10**6):\n"
        f"    d = struct.pack({PACKET!r}, k, 0, 0, 2, *[0] * 5, *[0.0] * 6, 1.0, 1.0, 0, 0, 0, 0, 1, 3 + k)\n"
        f"    s.sendto(d, ('127.0.0.1', {shared.udp}))\n"
        "    time.sleep(0.001)\n"
    )
    sender = subprocess.Popen([sys.executable, "-c", code])
    try:
        state = states.until(lambda s: s[0] == PEDAL_DN and s[5] > 50)
    finally:
        os.kill(sender.pid, signal.SIGKILL)
        sender.wait()
    last, begin = state[4], state[3]
    while True:
        state = states.next()
        if state[4] != last:
            last, begin = state[4], state[3]
        if state[0] != PEDAL_DN:
            break
    assert state[0] == PEDAL_UP
    assert 0.49 < state[3] - begin < 0.53  # time of the machine since the last packet
    held = states.latest()
    assert max(abs(a - b) for a, b in zip(held[7][:3], state[7][:3], strict=True)) < 1e-3


def test_a_killed_machine_is_noticed():
    machine = Machine("--start")
    states = States(machine)
    states.next()
    machine.end()
    with pytest.raises(ConnectionError):
        states.until(lambda s: False)
    states.socket.close()


def test_the_summary_counts_what_happened():
    done = subprocess.run(
        [sys.executable, "-m", "twin", "machine", "raven_right", "--start", "--duration", "0.3", "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout)
    assert "packets to 127.0.0.1:" in done.stderr  # port 0: whoever sends packets has to read the port
    assert found["ticks"] == 300
    assert found["level"] == "PEDAL_UP"
    assert 0 <= found["late"] <= 300
    assert found["p50_ms"] <= found["p99_ms"] <= found["max_ms"]


def test_a_port_in_use_is_named(shared):
    done = subprocess.run(
        [sys.executable, "-m", "twin", "machine", "raven_left", "--port", str(shared.udp)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert f"UDP port {shared.udp} of 127.0.0.1" in done.stderr + done.stdout
    assert "give another port" in done.stderr + done.stdout
