"""The control software of a machine, tick by tick: levels, packets, checks of the DAC, faults."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import twin
from twin.api.machine import machine, machine_parts
from twin.core.errors import DeviceError, TwinError, WorldError
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine import machine_server
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.itp import PACKET, ahead, checksum, number_of, pack, unpack
from twin.simulation.machine.levels import Level, Plc, Reader
from twin.simulation.machine.receiver import Receiver
from twin.simulation.machine.servo import Servo
from twin.simulation.machine.simulated_machine import Machine

STILL = np.array([0, 0, 0, 1, 0, 0, 0, 0, 1.0])


@pytest.fixture(scope="module")
def parts():
    return machine_parts(twin.load("raven_left"))


class Master:
    """Sends one packet a tick."""

    def __init__(self, arm):
        self.arm, self.k, self.sequence = arm, 0, 0

    def tick(self, values=None):
        packets = []
        if values is not None:
            self.sequence += 1
            packets = [(pack(self.sequence, 0, values), "master")]
        self.arm.step(self.k * 1e-3, packets)
        self.k += 1

    def ready(self):
        """Start, home, press the pedal."""
        self.tick()
        self.arm.start()
        while self.arm.plc.level == Level.INIT:
            self.tick()
        for _ in range(50):
            self.tick(STILL)
        return self


@pytest.fixture
def master(parts):
    return Master(machine(parts)).ready()


def step(x=0.0, y=0.0, z=0.0, grasp=0.0, pedal=1.0):
    return np.array([x, y, z, 1, 0, 0, 0, grasp, pedal])


# ------------------------------------------------------------------------------------------ packets and levels


def test_the_layout_of_a_packet_is_the_documented_one():
    data = pack(7, 1, np.array([1, -2, 3, 0.6, 0.8, 0, 0, 5, 1.0]), version=4)
    assert len(data) == PACKET.size == 124
    assert struct.unpack_from("<3I", data) == (7, 0, 4)
    assert struct.unpack_from("<6i", data, 12) == (0, 1, 0, -2, 0, 3)
    assert struct.unpack_from("<2d", data, 36) == (0, 0.8)
    assert struct.unpack_from("<2d", data, 84) == (1, 0.6)
    assert struct.unpack_from("<2i2i2i", data, 100) == (0, 0, 0, 5, 1, 1 + 1 - 2 + 3 + 7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d[:-1], "the packet has 123 bytes; it must have 124"),
        (lambda d: d + b"0", "the packet has 125 bytes"),
        (lambda d: d[:8] + b"\x09" + d[9:], "the version is 9; it must be 0"),
        (lambda d: d[:12] + b"\x01" + d[13:], "the checksum is"),
        (lambda d: d[:116] + b"\x02" + d[117:120] + struct.pack("<i", 13), "the surgeon mode is 2"),
        (lambda d: d[:84] + struct.pack("<d", 0.5) + d[92:], "the quaternion of arm 0 has length 0.5"),
        (lambda d: d[:84] + struct.pack("<d", np.nan) + d[92:], "the quaternion of arm 0 has length nan"),
    ],
)
def test_a_bad_packet_is_refused(change, message):
    with pytest.raises(DeviceError, match=message):
        unpack(change(pack(11, 0, step())), 0, 0)


def test_a_checksum_beyond_32_bits_wraps():
    numbers = [0] * 22
    numbers[3] = numbers[4] = 2**31 - 1
    assert checksum(tuple(numbers)) == -2


def test_numbers_only_go_up_and_a_gap_costs_a_packet():
    receiver = Receiver(0, 0, 5.0)

    def read(sequence, t, sender="a"):
        packet = receiver.read(pack(sequence, 0, step()), sender, t)
        return None if packet is None else packet.sequence

    assert read(5, 0.0) == 5
    for old in (5, 4):
        with pytest.raises(DeviceError, match=f"{old} is not after the last one, 5"):
            read(old, 0.1)
    with pytest.raises(DeviceError, match="2 packets are missing before packet 8"):
        read(8, 0.2)
    assert read(9, 0.3) == 9
    assert read(0, 0.3) is None  # goes back to its sender
    with pytest.raises(DeviceError, match="b is a second master; a controls the machine until"):
        read(10, 0.4, "b")
    assert receiver.pedal(5.3)
    assert not receiver.pedal(5.31)
    assert read(1, 5.4, "b") == 1
    assert (receiver.accepted, receiver.refused) == (3, 4)


def test_numbers_go_on_at_1_after_the_largest():
    receiver, last = Receiver(0, 0, 5.0), 2**32 - 1

    def read(sequence):
        return receiver.read(pack(sequence, 0, step()), "a", 0.0)

    assert [number_of(count) for count in (1, last, last + 1, last + 2, 2 * last + 1)] == [1, last, 1, 2, 1]
    for count in range(last - 2, last + 3):
        packet = read(number_of(count))
        assert packet is not None
        assert packet.sequence == number_of(count)
    with pytest.raises(DeviceError, match="2 packets are missing before packet 5"):
        read(5)
    for old in (2, last, last - 5, 2**31 + 6):  # the last one is nearer behind 5 than before it
        with pytest.raises(DeviceError, match=f"{old} is not after the last one, 5"):
            read(old)
    with pytest.raises(DeviceError, match="2147483646 packets are missing"):
        read(2**31 + 4)
    assert (receiver.accepted, receiver.refused) == (5, 6)


@given(st.integers(1, 2**32 - 1), st.integers(-(2**31) + 1, 2**31 - 1))
def test_a_number_is_ahead_by_the_shorter_way_around(last, by):
    assert ahead(number_of(last + by), last) == by


def test_the_plc_stops_when_the_watchdog_bit_stands():
    plc = Plc(0.05)
    assert plc.step(0.0, False, True, True) == Level.E_STOP
    plc.start(0.0)
    assert plc.step(0.001, True, False, True) == Level.INIT
    assert plc.step(0.002, False, True, False) == Level.PEDAL_UP
    assert plc.step(0.05, False, True, True) == Level.PEDAL_DN
    assert plc.step(0.053, False, True, True) == Level.E_STOP
    assert "50 ms" in plc.reason
    assert plc.step(0.054, True, True, True) == Level.E_STOP


def test_a_level_counts_after_three_equal_cycles_and_the_lowest_wins():
    reader = Reader(3)
    both = [Level.PEDAL_DN, Level.PEDAL_UP]
    assert [reader.read(both) for _ in range(3)] == [Level.E_STOP, Level.E_STOP, Level.PEDAL_UP]
    assert reader.read([Level.INIT]) == Level.PEDAL_UP
    assert reader.read(both) == Level.PEDAL_UP


# ------------------------------------------------------------------------------------------------ the machine


def test_the_machine_homes_from_elsewhere_and_waits_with_brakes(parts):
    q = parts.home + np.array([0.2, -0.2, 0.01, 0.5, 0.2, 0.1, 0.2])
    arm = Machine(parts, q=q)
    master = Master(arm)
    for _ in range(20):
        master.tick()
    np.testing.assert_allclose(arm.plant.q, q, atol=1e-6)  # switched on: brakes hold
    arm.start()
    while arm.plc.level == Level.INIT:
        master.tick()
    assert arm.plc.level == Level.PEDAL_UP
    np.testing.assert_allclose(arm.plant.q, parts.home, atol=0.02)
    at = arm.plant.q.copy()
    for _ in range(200):
        master.tick()
    np.testing.assert_allclose(arm.plant.q[:3], at[:3], atol=1e-3)
    assert not arm.dac.any()


def test_the_tool_follows_the_increments(master):
    arm = master.arm
    kin = arm.parts.kin
    T = kin.forward(arm.plant.q)
    turn = np.array([0, 0, 0, np.cos(1e-4), 0, 0, np.sin(1e-4), 0, 1])
    for _ in range(500):
        master.tick(step(x=20) + turn - [0, 0, 0, 1, 0, 0, 0, 0, 1])
    for _ in range(300):
        master.tick(STILL)
    now = kin.forward(arm.plant.q)
    assert np.linalg.norm(now[:3, 3] - T[:3, 3] - [0.01, 0, 0]) < 1.5e-3
    about = now[:3, :3] @ T[:3, :3].T
    assert np.arctan2(about[1, 0], about[0, 0]) == pytest.approx(0.1, abs=0.02)
    for _ in range(200):
        master.tick(step(grasp=2))
    assert arm.wanted[6] == pytest.approx(0.4, abs=0.02)


def test_a_target_out_of_reach_is_held(master):
    before = master.arm.wanted.copy()
    master.tick(step(x=2e6))
    assert master.arm.held == 1
    np.testing.assert_array_equal(master.arm.wanted, before)
    assert master.arm.plc.level == Level.PEDAL_DN


def test_a_silent_master_holds_the_arm(parts):
    arm = machine(machine_parts(twin.load("raven_left"), master_timeout=0.1))
    master = Master(arm).ready()
    assert arm.plc.level == Level.PEDAL_DN
    for _ in range(99):
        master.tick()
    assert arm.plc.level == Level.PEDAL_DN
    for _ in range(10):
        master.tick()
    assert arm.plc.level == Level.PEDAL_UP
    at = arm.plant.q.copy()
    for _ in range(300):
        master.tick()
    np.testing.assert_allclose(arm.plant.q[:3], at[:3], atol=1e-4)


@pytest.mark.parametrize(
    ("bad", "sender", "message"),
    [
        (lambda k: pack(k + 1, 0, step(x=500), version=7), "master", "the version is 7; it must be 0"),
        (lambda k: pack(k + 1, 0, step(x=500))[:100], "master", "the packet has 100 bytes; it must have 124"),
        (lambda k: pack(k, 0, step(x=500)), "master", "is not after the last one"),
        (lambda k: pack(k + 1, 0, step(x=500)), "other", "other is a second master; master controls the machine"),
    ],
)
def test_a_machine_that_gets_a_bad_packet_goes_on_as_before(master, bad, sender, message):
    arm, number = master.arm, master.sequence
    wanted, accepted = arm.wanted.copy(), arm.receiver.accepted
    arm.step(master.k * 1e-3, [(bad(number), sender)])
    master.k += 1
    assert message in arm.receiver.reason
    assert (arm.receiver.accepted, arm.receiver.refused, arm.receiver.sequence) == (accepted, 1, number)
    np.testing.assert_array_equal(arm.wanted, wanted)
    before = arm.plant.q.copy()
    for _ in range(20):
        master.tick(STILL)
    assert arm.plc.level == Level.PEDAL_DN
    assert np.abs(arm.plant.q - before).max() < 1e-4


def test_a_clock_that_goes_back_stops_the_machine(master):
    master.k -= 10
    master.tick(STILL)
    assert master.arm.plc.level == Level.E_STOP
    assert "the clock went back" in master.arm.reason
    assert not master.arm.dac.any()


@pytest.mark.parametrize("t", [1.0, np.nan])
def test_a_clock_that_does_not_advance_is_not_said_to_go_back(master, t):
    master.arm.t = 1.0
    master.arm.step(t)
    assert master.arm.plc.level == Level.E_STOP
    assert master.arm.reason == f"the clock did not advance: 1 s was followed by {t:g} s"


def test_gains_that_oscillate_stop_the_machine(parts):
    """The proportional gain times 40 and no damping: the arm swings until a check stops it, then brakes hold."""
    table = parts.settings
    wild = [m.model_copy(update={"kp": 40 * m.kp, "kd": 0.0}) for m in table.motor]
    known = table.model_copy(update={"motor": wild})
    arm = machine(replace(parts, settings=known, arithmetic=Arithmetic.of(known, parts.arm.mechanism)))
    master = Master(arm).ready()
    for k in range(4000):
        master.tick(step(x=20 if k // 200 % 2 else -20))
        if arm.plc.level == Level.E_STOP:
            break
    assert arm.plc.level == Level.E_STOP
    assert "limit" in arm.reason
    for _ in range(300):
        master.tick(STILL)
    assert not arm.dac.any()
    assert np.abs(arm.plant.qd[:3]).max() < 1e-6


def test_the_compiled_arithmetic_is_that_of_numpy(parts, rng):
    """To the last bit: the released control law, each operation rounded on its own."""
    a, m = parts.arithmetic, parts.arm.mechanism
    kp, ki, kd = np.array([[x.kp / x.gear, x.ki / x.gear, x.kd / x.gear] for x in parts.settings.of_motors(m)]).T
    for _ in range(200):
        counts, before, w = np.rint(rng.normal(size=7) * 3000), rng.normal(size=7), rng.normal(size=7)
        motors = counts * a.angle
        faster = w + a.share * ((motors - before) / 1e-3 - w)
        np.testing.assert_array_equal(a.sense(counts, before, w), np.append(motors, faster))
        wanted, old, r, q, qd = rng.normal(size=(5, 7))
        rates = r + a.share * ((wanted - old) / 1e-3 - r)
        np.testing.assert_array_equal(a.aim(wanted, old, r, q, qd), [*rates, *(wanted - q), *(rates - qd)])
        e, de, efforts, s = rng.normal(size=(4, 7))
        total = s + e * 1e-3
        asked = np.trunc(((kp * e + ki * total + kd * de) + m.motor_efforts(efforts)) * a.counts_per_effort)
        np.testing.assert_array_equal(a.drive(e, de, efforts, s), np.append(total, asked))


@pytest.mark.parametrize(("policy", "stops"), [("none", False), ("soft", False), ("hard", True)])
def test_overdrive(parts, policy, stops):
    """Twice seven commands above the limit in one tick each: more than 10 in the shared counter, for hard only."""
    servo = Servo(parts.settings, parts.arm.mechanism, parts.arithmetic, "moderate", policy)
    error = (
        1.05
        * servo.limit
        / parts.arithmetic.counts_per_effort
        / np.array([m.kp / m.gear for m in parts.settings.motor])
    )
    rest = np.zeros(7)
    first = servo.counts_of(error, rest, rest)
    assert servo.counted == 7
    assert (np.abs(first) > servo.limit).all() == (policy == "none")
    second = servo.counts_of(error, rest, rest)
    assert servo.counted == 14
    assert bool(servo.stop) == stops
    assert second.any() != stops
    assert "14 commands exceed the limit of mode moderate (10 are allowed)" in servo.stop or not stops


def test_above_the_stop_limit_every_policy_stops(parts):
    servo = Servo(parts.settings, parts.arm.mechanism, parts.arithmetic, "advanced", "none")
    assert not servo.counts_of(np.array([100, 0, 0, 0, 0, 0, 0.0]), np.zeros(7), np.zeros(7)).any()
    assert "the command for motor_shoulder is" in servo.stop
    assert "limit 20000" in servo.stop


def test_a_heavier_machine_is_not_its_model(parts):
    """The same packets, 50 % more mass: the tools end apart, and the software knows nothing of it."""
    ends = []
    for mass in (1.0, 1.5):
        master = Master(machine(parts, mass=mass)).ready()
        for _ in range(300):
            master.tick(step(x=30))
        ends.append(parts.kin.forward(master.arm.plant.q)[:3, 3])
    assert 1e-5 < np.linalg.norm(ends[1] - ends[0]) < 3e-3


# ------------------------------------------------------------------------------------------------------ faults


def test_operations_of_a_fault():
    def values(operation, value=0.0, **more):
        fault = Fault("x", 2, 4, operation, value, **more)
        return [fault.change(t, np.array([10.0 * t, 1.0])).tolist() for t in range(6)]

    assert [v[0] for v in values("hold")] == [0, 10, 10, 10, 40, 50]
    assert [v[0] for v in values("overwrite", 7)] == [0, 10, 7, 7, 40, 50]
    assert [v[0] for v in values("add", 5)] == [0, 10, 25, 35, 40, 50]
    assert [v[0] for v in values("add_once", 5)] == [0, 10, 25, 35, 45, 55]
    assert [v[0] for v in values("delay", 2)] == [0, 10, 0, 10, 40, 50]
    assert values("add", 5, target=1)[2] == [20, 6]
    assert [Fault("x", 2, 4, "skip").copies(t) for t in range(6)] == [1, 1, 0, 0, 1, 1]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"start": 4}, "its stop is 4; it must be after its start, 4"),
        ({"value": np.nan}, "the value is nan"),
        ({"operation": "delay", "value": 0.5}, "a delay of 0.5 steps"),
    ],
)
def test_an_impossible_fault_is_refused(wrong, message):
    with pytest.raises(WorldError, match=message):
        Fault(**{"signal": "x", "start": 2, "stop": 4, "operation": "add", "value": 1.0} | wrong)


def test_an_unknown_signal_of_a_fault_is_refused(parts):
    with pytest.raises(WorldError, match=r"signal of the machine 'dca'. Did you mean 'dac'"):
        machine(parts, faults=[Fault("dca", 0, 1, "add")])


def test_only_packets_can_be_lost(parts):
    with pytest.raises(WorldError, match="skip is possible for packets only; use hold"):
        machine(parts, faults=[Fault("dac", 0, 1, "skip")])


def test_the_start_button_does_nothing_while_the_arm_works(master):
    master.arm.start()
    for _ in range(10):
        master.tick(STILL)
        assert master.arm.plc.level == Level.PEDAL_DN


def test_faults_act_after_the_checks_of_their_layer(parts):
    """A DAC value far above every limit reaches the motor; a packet's increment comes after its checksum."""
    start = Master(machine(parts)).ready().k * 1e-3
    arm = machine(parts, faults=[Fault("dac", start, start + 0.05, "overwrite", 15000.0, target=0)])
    master = Master(arm).ready()
    for _ in range(20):
        master.tick(STILL)
    assert arm.dac[0] == 15000
    arm = machine(parts, faults=[Fault("packet", 60, 61, "add", [200.0, *[0.0] * 8], counts=True)])
    master = Master(arm).ready()
    wanted = parts.kin.forward(arm.wanted)
    for _ in range(20):
        master.tick(STILL)
    moved = parts.kin.forward(arm.wanted)[:3, 3] - wanted[:3, 3]
    np.testing.assert_allclose(moved, [2e-4, 0, 0], atol=1e-9)
    assert arm.receiver.refused == 0


def test_a_wrong_encoder_misleads_the_software(parts):
    start = Master(machine(parts)).ready().k * 1e-3
    arm = machine(parts, faults=[Fault("encoder", start, start + 1, "add", 200.0, target=0)])
    master = Master(arm).ready()
    for _ in range(100):
        master.tick(STILL)
    counted = arm.q[0] - arm.plant.q[0]
    assert counted == pytest.approx(200 * 2 * np.pi / 4000 / 136.1963, rel=0.02)


def test_a_time_out_must_be_above_0():
    with pytest.raises(TwinError, match=r"time-out of the master is 0 s"):
        machine_parts(twin.load("raven_left"), master_timeout=0.0)


def test_the_delays_of_a_long_run_need_constant_memory():
    pace = machine_server.Pace()
    for _ in range(10):
        pace.add(0.005)
    for _ in range(machine_server.RECENT):
        pace.add(0.0)
    assert len(pace.late) == machine_server.RECENT
    found = pace.summary()
    assert (found["ticks"], found["late"], found["max_ms"]) == (machine_server.RECENT + 10, 10, 5.0)
    assert (found["p50_ms"], found["p99_ms"]) == (0.0, 0.0), "those of the recent ticks"


def test_a_connection_that_is_aborted_before_it_is_accepted_does_not_stop_the_machine(parts):
    class Aborted:
        def accept(self):
            raise ConnectionAbortedError(103, "Software caused connection abort")

    one = machine_server.Server(machine(parts))
    tcp, one._tcp = one._tcp, Aborted()
    one.step(0.0)
    one._tcp = tcp
    one.close()
    assert one.machine.tick == 1
