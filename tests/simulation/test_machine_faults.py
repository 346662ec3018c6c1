"""Faults of network, USB reads and control state; findings of the released software; gains; a second robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.api.machine import machine, machine_parts
from twin.cli import main
from twin.core.errors import MechanismError, TwinError, WorldError
from twin.simulation.campaigns.packet_hand import Hand, circle, wander
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine import settings as tables
from twin.simulation.machine.itp import pack, sequence_of, unpack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_faults import LOCATIONS
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.servo import Servo
from twin.simulation.machine.stability import _tick, require_stable
from twin.simulation.machine.wire import Wire

MOVE = np.array([5, 0, 0, 1, 0, 0, 0, 0, 1.0])


@pytest.fixture(scope="module")
def parts():
    return machine_parts(twin.load("raven_left"))


def run(parts, fault, packets=200, start=60):
    """A machine after a number of packets, the fault acting from packet `start` for 20."""
    faults = [Fault(fault.pop("signal"), start, start + fault.pop("length", 20), counts=True, **fault)] if fault else []
    arm = machine(parts, faults=faults)
    arm.step(0.0)
    arm.start()
    for k in range(1, 100 + packets):
        arm.step(k * TICK, [(pack(k - 99, 0, MOVE), "m")] if k >= 100 else [])
    return arm


@pytest.fixture(scope="module")
def free(parts):
    return run(parts, {})


# --------------------------------------------------------------------------------------------------------- network


def carried(*faults, ticks=12):
    """The sequence numbers that arrive in each tick, for one packet sent per tick."""
    wire = Wire(faults)
    out = [wire.carry(k * TICK, [(pack(k, 0, MOVE), "m")]) for k in range(1, ticks)]
    for packets in out:
        for data, _ in packets:
            unpack(data, 0, 0)  # the checksum fits
    return [[sequence_of(data) for data, _ in packets] for packets in out]


def test_the_network_loses_repeats_renumbers_and_delays():
    assert carried() == [[k] for k in range(1, 12)]
    assert carried(Fault("wire", 3, 5, "skip", counts=True), ticks=7) == [[1], [2], [], [], [5], [6]]
    assert carried(Fault("wire", 3, 4, "duplicate", counts=True), ticks=6) == [[1], [2], [3, 3], [4], [5]]
    assert carried(Fault("wire", 3, 4, "add", 100.0, counts=True), ticks=6) == [[1], [2], [103], [4], [5]]
    assert carried(Fault("wire", 1, 2, "add", -2.0, counts=True), ticks=3) == [[2**32 - 1], [2]]
    late = carried(Fault("wire", 3, 5, "delay", 3, counts=True), ticks=10)
    assert late == [[1], [2], [], [], [5], [3, 6], [4, 7], [8], [9]]


def test_a_packet_of_the_wrong_length_passes_the_network_unchanged():
    wire = Wire([Fault("wire", 0, 9, "add", 1.0, counts=True)])
    assert wire.carry(0.0, [(b"x", "m")]) == [(b"x", "m")]


@pytest.mark.parametrize(
    ("fault", "refused", "lost"),
    [
        ({"operation": "skip"}, 1, 21),  # the first packet after the gap is dropped, as released
        ({"operation": "duplicate"}, 20, 0),
        ({"operation": "add", "value": -50.0}, 20, 20),  # below the last number; then there is a gap
        ({"operation": "add", "value": 50.0}, 51, 51),  # all up to the highest number are old
        ({"operation": "delay", "value": 40}, 21, 21),  # overtaken by newer packets, which come after a gap
    ],
)
def test_the_receiver_sees_faults_of_the_network(parts, free, fault, refused, lost):
    arm = run(parts, {"signal": "wire"} | fault)
    assert arm.receiver.refused == pytest.approx(refused, abs=1)
    behind = (parts.kin.forward(free.wanted) - parts.kin.forward(arm.wanted))[0, 3] * 1e6
    assert behind == pytest.approx(5 * lost, abs=5.1)


def test_packets_can_be_repeated_after_they_were_accepted(parts, free):
    arm = run(parts, {"signal": "packet", "operation": "duplicate"})
    ahead = (parts.kin.forward(arm.wanted) - parts.kin.forward(free.wanted))[0, 3] * 1e6
    assert ahead == pytest.approx(20 * 5, abs=0.01)
    assert arm.receiver.refused == 0


@pytest.mark.parametrize("signal", [s for s in LOCATIONS if s not in ("wire", "packet")])
@pytest.mark.parametrize("operation", ["skip", "duplicate"])
def test_only_packets_are_lost_or_repeated(parts, signal, operation):
    with pytest.raises(WorldError, match=f"fault of {signal}: {operation} is possible for packets only; use hold"):
        machine(parts, faults=[Fault(signal, 0, 1, operation)])


# ------------------------------------------------------------------------------------------ reads and control state


def test_a_failed_read_keeps_the_old_counts(parts, free):
    """27 bytes are a packet; anything else, an error code too, is ignored."""
    same = run(parts, {"signal": "usb", "operation": "overwrite", "value": 27.0})
    np.testing.assert_array_equal(same.plant.q, free.plant.q)
    arm = run(parts, {"signal": "usb", "operation": "overwrite", "value": -19.0, "length": 1000}, packets=100)
    late = run(parts, {}, packets=60)
    np.testing.assert_allclose(arm.q, late.q, atol=1e-3)
    assert np.abs(arm.plant.q - arm.q)[:3].max() > np.abs(free.plant.q - free.q)[:3].max()


def test_faults_of_the_control_state(parts, free):
    """The desired tool moves by 2 um in each of 20 cycles; desired joints move while the fault acts; levels change."""
    arm = run(parts, {"signal": "tool", "operation": "add", "value": 2.0, "target": 1})
    moved = (parts.kin.forward(arm.wanted) - parts.kin.forward(free.wanted))[:3, 3] * 1e6
    np.testing.assert_allclose(moved, [0, 40, 0], atol=0.01)
    arm = run(parts, {"signal": "joints", "operation": "add", "value": 0.01, "target": 1, "length": 500})
    assert arm.wanted[1] - free.wanted[1] == pytest.approx(0.01, abs=1e-3)
    arm = run(parts, {"signal": "level", "operation": "overwrite", "value": 2.0, "length": 500})
    assert (arm.level, arm.plc.level) == (Level.PEDAL_UP, Level.PEDAL_DN)
    assert not arm.dac.any()  # nothing holds the arm: the PLC has released its brakes
    assert (arm.plant.physics.coulomb < 10).all()
    arm = run(parts, {"signal": "level", "operation": "overwrite", "value": 0.0})
    assert arm.plc.level in (Level.INIT, Level.PEDAL_UP, Level.PEDAL_DN)  # it initialises the arm again


def test_the_names_of_all_numbers_are_known(parts):
    assert set(parts.places) == set(LOCATIONS)
    assert parts.places["joints"][:3] == ("shoulder", "elbow", "insertion")
    assert parts.places["dac"][0] == "motor_shoulder"


# ---------------------------------------------------------------------------------- findings of the released software


def test_the_counter_of_violations_is_shared_or_one_for_each_motor(parts):
    """Twice seven motors above the limit are 14 in the shared counter, but 2 for each motor."""
    stops = {}
    for shared in (True, False):
        known = parts.settings.model_copy(update={"released": tables.Released(shared_counter=shared)})
        servo = Servo(known, parts.arm.mechanism, parts.arithmetic, "moderate", "hard")
        error = 1.05 * servo.limit / parts.arithmetic.counts_per_effort / np.array([m.kp / m.gear for m in known.motor])
        for _ in range(2):
            servo.counts_of(error, np.zeros(7), np.zeros(7))
        stops[shared] = servo.stop
    assert "14 commands exceed the limit" in stops[True]
    assert stops[False] == ""


@pytest.mark.slow
def test_rates_without_the_coupling_of_the_cables(parts):
    """The insertion motor stands while the shoulder turns: coupled, the carriage moves; its released rate is 0."""
    robot = twin.load("raven_left").with_transmission("coupled")
    rates = {}
    for released in ((), ("rates_without_coupling",)):
        arm = machine(machine_parts(robot, released=released))
        m = arm.parts.arm.mechanism
        rates[released] = arm.software._rate_matrix @ np.array([10.0, 0, 0, 0, 0, 0, 0])
        np.testing.assert_allclose(rates[released][0], 10 / 136.1963, rtol=1e-4)
        jaws = arm.software._rate_matrix @ np.array([0, 0, 0, 0, 0, 1.0, -1.0])
        np.testing.assert_allclose(jaws, m.from_motors(np.array([0, 0, 0, 0, 0, 1.0, -1.0])), atol=1e-15)
    assert abs(rates[()][1]) > 1e-3
    np.testing.assert_allclose(rates[("rates_without_coupling",)][1:], 0, atol=1e-15)


def test_whole_counts_make_angles_too_large(parts):
    """4000 counts a turn are 636.6 per rad; with 636 an angle reads 0.097 % too large."""
    arm = machine(machine_parts(twin.load("raven_left"), released=["whole_counts"]))
    arm.step(0.0)
    np.testing.assert_allclose(arm.q[:3], arm.plant.q[:3] * (4000 / (2 * np.pi)) / 636, rtol=1e-5)


def test_an_unknown_finding_is_named():
    with pytest.raises(TwinError, match=r"fault of the released software 'whole_count'. Did you mean 'whole_counts'"):
        machine_parts(twin.load("raven_left"), released=["whole_count"])


# ------------------------------------------------------------------------------------------------------------ gains


def test_the_eigenvalue_is_the_growth_of_the_simulated_arm(parts):
    """A small deviation of the insertion under a derivative gain that is too high, without Coulomb friction."""
    wild = [m.model_copy(update={"kd": 1.85}) if m.name == "motor_insertion" else m for m in parts.settings.motor]
    known = parts.settings.model_copy(update={"motor": wild})
    growth = np.abs(np.linalg.eigvals(_tick(parts.arm, known, parts.home))).max()
    assert growth > 1.01
    m, free = parts.arm.mechanism, parts.plant.physics
    plant = parts.plant.another(replace(free, coulomb=np.zeros(7), fall=np.zeros(3)))
    plant.reset(parts.home + np.array([0, 0, 1e-9, 0, 0, 0, 0]))
    share, before, rates = parts.arithmetic.share, m.motors(plant.q), np.zeros(7)
    size = []
    gains = [(x.kp / x.gear, x.kd / x.gear, x.ki / x.gear) for x in known.of_motors(m)]
    kp, kd, ki = np.array(gains).T
    total = np.zeros(7)
    for _ in range(60):
        motors = m.motors(plant.q)
        rates, before = rates + share * ((motors - before) / TICK - rates), motors
        error = m.motors(parts.home) - motors
        total = total + TICK * error
        plant.advance(kp * error - kd * rates + ki * total)
        size.append(np.linalg.norm(plant.qd))
    assert (size[59] / size[39]) ** (1 / 20) == pytest.approx(growth, rel=1e-3)


@pytest.mark.parametrize(
    ("motor", "change", "joint"),
    [
        ("motor_insertion", {"kd": 3.0}, "insertion"),
        ("motor_shoulder", {"kp": 3000.0, "kd": 0.0}, "shoulder"),
        ("motor_jaw1", {"kd": 60.0}, "yaw"),
        ("motor_jaw2", {"kd": 60.0}, "yaw"),
    ],
)
def test_gains_that_oscillate_are_refused(parts, motor, change, joint):
    wild = [m.model_copy(update=change) if m.name == motor else m for m in parts.settings.motor]
    message = rf"the gains make {joint} oscillate with \d.* Hz: .* reduce kp = .* of {motor}"
    with pytest.raises(MechanismError, match=message):
        Parts.of(parts.arm, parts.kin, parts.settings.model_copy(update={"motor": wild}))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["raven_left", "raven_right", "pa10"])
def test_the_gains_that_come_with_twin_are_stable(name):
    known = machine_parts(twin.load(name))
    require_stable(known.arm, known.settings, known.home)


def test_a_machine_without_mass_is_refused(capsys):
    assert main(["machine", "raven_left", "--mass-error", "-100", "--duration", "0.01"]) == 2
    assert "the factor of the mass of shoulder is 0; it must be at least 0.001" in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------- hand, second robot


@pytest.mark.parametrize("motion", [circle, wander(3)])
def test_the_packets_of_a_hand_add_up_to_its_motion(parts, motion):
    hand, total = Hand(parts.settings, 0.05, motion), np.zeros(3)
    for k in range(1, 701):
        total += unpack(hand.packet(k), 0, 0).values[:3]
    np.testing.assert_allclose(total * 1e-6, 0.05 * motion(0.7), atol=0.51e-6)
    hand.packet(701, pedal=False)
    assert not unpack(hand.packet(702, pedal=False), 0, 0).values[[0, 1, 2, 8]].any()


def test_the_machine_of_the_pa10_follows_packets():
    """A second robot: no brakes of its own kind, no jaws, motors on the joints; masses of inertia.toml compensate."""
    known = machine_parts(twin.load("pa10"))
    arm = run(known, {}, packets=600)
    assert (arm.plc.level, arm.held) == (Level.PEDAL_DN, 0)
    moved = known.kin.forward(arm.plant.q)[:3, 3] - known.kin.forward(known.home)[:3, 3]
    np.testing.assert_allclose(moved, [599 * 5e-6, 0, 0], atol=6e-4)
