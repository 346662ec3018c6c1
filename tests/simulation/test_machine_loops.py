"""The machine of a robot with closed loops (SILS): equations, plant, brakes, limits, against other programs."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import twin
from twin.api.machine import machine, machine_parts
from twin.core.errors import MechanismError
from twin.core.units import MM
from twin.exchange.formats.mjcf.write import mjcf_text
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.simulation.dynamics.effort_plants import MujocoPlant
from twin.simulation.machine.equations_of_motion import motion
from twin.simulation.machine.itp import pack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.motor_plant import TICK, MotorPlant, Physics

STILL = np.array([0, 0, 0, 1.0, 0, 0, 0, 0, 1])
"""A packet with the pedal down, without motion."""


@pytest.fixture(scope="module")
def robot():
    return twin.load("sils")


@pytest.fixture(scope="module")
def parts(robot):
    return machine_parts(robot)


class Driven:
    """A machine that has been started, moved by packets in simulated time."""

    def __init__(self, parts, **options):
        self.machine = machine(parts, **options)
        self.machine.start()
        self.ticks = 0
        self.packets = 0

    def run(self, ticks, values=None):
        for _ in range(ticks):
            packets = []
            if values is not None:
                self.packets += 1
                packets.append((pack(self.packets, 0, values, 0), "master"))
            self.machine.step(self.ticks * TICK, packets)
            self.ticks += 1


def moved(x=0, y=0, z=0):
    """Return a packet with increments in µm and the pedal down."""
    values = STILL.copy()
    values[:3] = x, y, z
    return values


def test_compiled_dynamics_with_loops_agree_with_the_reference(parts):
    """Mass matrix and bias, with the rates and accelerations of the passive joints, against Pinocchio."""
    arm = parts.arm
    solver = LoopSolver(arm.mechanism)
    e, dynamics = motion(arm.mechanism, solver), arm.dynamics()
    f = ca.Function("f", [e.q, e.states, e.qd, e.factors, e.fall], [e.M, e.b])
    rng = np.random.default_rng(1)
    home = dynamics.model.solve(parts.home)
    start = solver.forward_many(parts.home[None]).states[0]
    for _ in range(5):
        q, qd = parts.home + rng.uniform(-0.01, 0.01, 6), rng.uniform(-0.5, 0.5, 6)
        states = solver.close(q, start)
        assert states is not None
        M, b = f(q, states, qd, 1.0, Physics.of(arm).fall)
        at = dynamics.near(q, home)
        expected = dynamics.mass_matrix(at) - dynamics.rotor
        assert np.abs(np.array(M) - expected).max() <= 1e-11 * np.abs(expected).max()
        bias = dynamics.bias(at, qd)
        assert np.abs(np.array(b).ravel() - bias).max() <= 1e-11 * np.abs(bias).max()


@pytest.mark.slow
def test_the_plant_moves_as_mujoco_does(parts):
    """Free motion for 0.1 s; MuJoCo moves the exported MJCF, in steps of 0.25 ms instead of 1 ms."""
    arm = parts.arm
    plant = parts.plant.another(Physics.of(arm))
    rest = plant.q.copy()
    efforts = arm.dynamics().gravity(rest) + np.array([1.5, 2.0, 2.0, -1.0, -1.0, 1.0])
    other = MujocoPlant(mjcf_text(arm.mechanism), [joint.name for joint in arm.mechanism.active], 0.0, 0.0)
    plant.reset(rest)
    other.reset(rest, np.zeros(6))
    for _ in range(100):
        plant.advance(efforts)
        other.advance(efforts, TICK)
    way = np.abs(other.q - rest).max()
    assert way > 10 * MM
    # a tick is of first order: after 100 of them, the way is longer by about one part in 100
    assert np.abs(plant.q - other.q).max() < 0.015 * way
    assert np.abs(plant.qd - other.qd).max() < 2e-3 * np.abs(other.qd).max()


def test_increments_move_the_platform_of_the_independent_model(robot, parts):
    driven = Driven(parts)
    driven.run(100)
    assert driven.machine.level == Level.PEDAL_UP
    reference = robot.reference()
    before = reference.solve(driven.machine.plant.q)
    driven.run(50, STILL)
    start = reference.solve(driven.machine.plant.q, before).T_base_tool
    driven.run(1000, moved(x=12, y=-6, z=-9))
    driven.run(500, STILL)
    assert (driven.machine.level, driven.machine.held) == (Level.PEDAL_DN, 0)
    T = reference.solve(driven.machine.plant.q, before).T_base_tool
    # the friction of a carriage divided by its gain, 0.1 mm, until the integral has overcome it
    np.testing.assert_allclose(T[:3, 3] - start[:3, 3], np.array([12, -6, -9]) * MM, atol=0.1 * MM)
    np.testing.assert_allclose(T[:3, :3], start[:3, :3], atol=5e-4)


@pytest.mark.slow
def test_brakes_hold_the_platform_in_spite_of_its_strongly_coupled_joints(parts):
    """Three sweeps of the friction law, as for a serial arm, would let it creep by 2 mm in 1.5 s."""
    driven = Driven(parts)
    driven.run(100)
    q = driven.machine.plant.q.copy()
    driven.machine.stop()
    driven.run(1500)
    assert np.abs(driven.machine.plant.q - q).max() < 1e-6


@pytest.mark.slow
def test_no_target_beyond_a_singularity_or_a_gap_is_followed(parts):
    driven = Driven(parts)
    driven.run(100)
    driven.run(3000, moved(z=20))  # upwards, until carriages 3 and 4 or a limit are near
    machine = driven.machine
    assert machine.held > 0
    assert machine.level == Level.PEDAL_DN
    T = machine._target
    assert T is not None
    assert not any(alarm.any() for alarm in parts.kin.singularity_alarm(Ts=T[None]).values())
    names = [joint.name for joint in parts.arm.mechanism.active]
    for lower, upper, least in parts.gaps:
        assert machine.wanted[names.index(upper)] - machine.wanted[names.index(lower)] >= least


@pytest.mark.slow
def test_carriages_that_meet_touch_and_go_on_together(parts):
    plant = parts.plant.another(Physics.of(parts.arm))
    names = [joint.name for joint in parts.arm.mechanism.active]
    lower, upper, least = parts.gaps[0]
    i, k = names.index(lower), names.index(upper)
    plant.reset(parts.home)
    efforts = np.zeros(6)
    efforts[i], efforts[k] = 60, -60
    closest = np.inf
    for _ in range(600):
        plant.advance(efforts)
        closest = min(closest, plant.q[k] - plant.q[i])
    assert closest >= least - 1e-12


@pytest.mark.slow
def test_a_fast_carriage_stops_the_machine(parts):
    driven = Driven(parts)
    driven.run(100)
    driven.run(50, STILL)
    plant = driven.machine.plant
    plant.reset(plant.q, [0.5, 0.5, 0, 0, 0.5, 0.5])
    driven.run(20, STILL)
    assert driven.machine.level == Level.E_STOP
    assert "m/s (limit 0.2)" in driven.machine.reason


@pytest.mark.slow
def test_two_machines_of_the_same_parts_do_not_disturb_each_other(parts):
    """Each remembers how its loops were closed: one alone gives the same bytes as one beside another."""
    alone, beside, other = Driven(parts), Driven(parts), Driven(parts, mass=1.2)
    for values in (None, STILL, moved(x=10)):
        alone.run(150, values)
        for _ in range(150):
            beside.run(1, values)
            other.run(1, values)
    assert alone.machine.plant.q.tobytes() == beside.machine.plant.q.tobytes()
    assert alone.machine.plant.q.tobytes() != other.machine.plant.q.tobytes()


def test_a_serial_plant_refuses_loops(parts):
    with pytest.raises(MechanismError, match="sils has loops: use a LoopPlant"):
        MotorPlant(parts.arm)


def test_joint_values_that_open_the_loops_are_refused(parts):
    with pytest.raises(MechanismError, match="the loops cannot be closed at q"):
        parts.plant.another().reset(parts.home + np.array([0.3, 0, 0, 0, 0, 0]))
