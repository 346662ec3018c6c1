"""The machine of a robot with closed loops (SILS): equations, plant, brakes, limits, against other programs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import twin
from twin.api.machine import machine, machine_parts
from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.units import MM
from twin.exchange.formats.mjcf.write import mjcf_text
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.model.body import Body
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.reference.dynamics import Dynamics
from twin.simulation.dynamics.effort_plants import MujocoPlant
from twin.simulation.machine.equations_of_motion import motion
from twin.simulation.machine.itp import pack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.loop_plant import JAM_MARGIN, LARGEST_STEP, LoopPlant
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import TICK, Physics

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


def gaps_of(parts):
    """Return (index of the lower carriage, index of the upper one, minimum distance in m) of all rails."""
    names = [joint.name for joint in parts.arm.mechanism.active]
    return [(names.index(lower), names.index(upper), least) for lower, upper, least in parts.gaps]


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


def test_a_body_that_is_fixed_to_a_robot_with_loops_has_its_mass(parts):
    """An instrument on the platform, tilted and heavy, against Pinocchio."""
    mechanism = parts.arm.mechanism
    T = spatial.pose(spatial.exp_so3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.05, -0.2]))
    inertia = Inertia(3.0, np.array([0.02, 0.0, 0.1]), np.diag([0.02, 0.03, 0.01]))
    platform = mechanism.frame(mechanism.tool).body
    mechanism = replace(
        mechanism,
        bodies=(*mechanism.bodies, Body("load", inertia=inertia)),
        joints=(*mechanism.joints, Joint("mount", "fixed", platform, "load", T)),
        rest={**mechanism.rest, "load": mechanism.rest[platform] @ T},
    )
    solver = LoopSolver(mechanism)
    e, dynamics = motion(mechanism, solver), Dynamics(mechanism)
    f = ca.Function("f", [e.q, e.states, e.qd, e.factors, e.fall], [e.M, e.b])
    q, qd = parts.home + 0.01, np.linspace(-0.5, 0.5, 6)
    at = dynamics.near(q, dynamics.model.solve(parts.home))
    states = solver.forward_many(q[None]).states[0]
    M, b = f(q, states, qd, 1.0, np.array(mechanism.gravity))
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
def test_no_target_beyond_a_joint_limit_is_followed(parts):
    driven = Driven(parts)
    driven.run(100)
    driven.run(3000, moved(z=20))  # upwards, where carriage 4 reaches its limit
    machine = driven.machine
    assert machine.held > 0
    assert machine.level == Level.PEDAL_DN
    low, high = parts.arm.mechanism.limits.T
    assert (low <= machine.wanted).all()
    assert (machine.wanted <= high).all()
    assert machine.wanted[3] - low[3] < 1 * MM


def test_no_target_near_a_singularity_is_followed(parts):
    """The last pose is within all limits, and no carriages come too close: only the equations' alarm refuses it."""
    driven = Driven(parts)
    driven.run(100)
    driven.run(50, STILL)
    machine = driven.machine
    start = parts.kin.forward(parts.home)
    held = []
    for part in (0.5, 1.0):
        turn = spatial.exp_so3(part * np.array([-0.545, 0.557, 0.027]))
        T = spatial.pose(turn @ start[:3, :3], start[:3, 3] + part * np.array([-3.9, 85.8, -64.5]) * MM)
        q = parts.kin.inverse(T, machine.wanted)
        low, high = parts.arm.mechanism.limits.T
        assert (low <= q).all()
        assert (q <= high).all()
        for i, k, least in gaps_of(parts):
            assert q[k] - q[i] > least
        machine.software.reach(T, machine.wanted)
        held.append(machine.held)
    assert held == [0, 1]


@pytest.mark.slow
def test_carriages_that_meet_touch_and_go_on_together(parts):
    """Two carriages are pushed towards each other; springs and gravity compensation hold the others."""
    plant = parts.plant.another(Physics.of(parts.arm))
    i, k, least = gaps_of(parts)[1]
    plant.reset(parts.home)
    gravity = parts.arm.dynamics().gravity(parts.home)
    together = 0
    for _ in range(900):
        springs = -3000 * (plant.q - parts.home)
        springs[i], springs[k] = 20, -20
        plant.advance(gravity + springs - 100 * plant.qd)
        distance = plant.q[k] - plant.q[i]
        assert distance >= least - 1e-12
        if distance < least + 1e-12:
            assert plant.qd[i] == plant.qd[k]
            together += abs(plant.qd[i]) > 0.01
    assert plant.jams == 0
    assert together > 200


def test_wild_torques_leave_carriages_within_stops_and_the_linkage_in_its_assembly(parts):
    """Between wild efforts, the linkage jams, but never jumps; it moves again when the efforts are turned round."""
    plant = parts.plant.another(Physics.of(parts.arm))
    solver = LoopSolver(parts.arm.mechanism)
    low, high = parts.arm.mechanism.limits.T
    rng = np.random.default_rng(0)
    for _ in range(4):
        plant.reset(parts.home)
        states = solver.forward_many(parts.home[None]).states[0]
        jams = plant.jams
        turned = 0
        efforts = rng.uniform(-400, 400, 6)
        for tick in range(110):
            plant.advance(efforts if tick < 100 else -efforts)
            turned += tick >= 100 and np.abs(plant.qd).max() > 0
            assert (low <= plant.q).all()
            assert (plant.q <= high).all()
            for i, k, least in gaps_of(parts):
                assert plant.q[k] - plant.q[i] >= least - 1e-12
            assert np.abs(plant.qd).max() <= LARGEST_STEP / TICK
            states = solver.close(plant.q, states, JAM_MARGIN)
            assert states is not None
        assert plant.jams > jams
        assert turned > 5


def test_torques_that_are_no_numbers_are_refused(parts):
    plant = parts.plant.another()
    before = plant.q.copy()
    with pytest.raises(MechanismError, match="rates after a tick are not finite"):
        plant.advance(np.array([np.nan, 0, 0, 0, 0, 0]))
    assert (plant.q == before).all()
    assert plant.jams == 0


class Rail(LoopPlant):
    """Carriages on one rail, without links and motors."""

    def __init__(self, gaps, stops):
        self._count = 3
        self._gaps = gaps
        self.physics = SimpleNamespace(stops=np.array(stops, float))


@pytest.mark.parametrize(
    ("old", "new", "rates", "expected"),
    [
        ([0.1, 0.3, 0.5], [0.2, 0.23, 0.5], [1, -1, 0], [0.195, 0.235, 0.5]),  # the first two touch
        ([0.1, 0.3, 0.5], [0.0, 0.02, 0.5], [1, -1, 0], [0.0, 0.04, 0.5]),  # the first is at its hard stop
        ([0.1, 0.3, 0.5], [0.47, 0.46, 0.5], [1, 0, 0], [0.436667, 0.476667, 0.516667]),  # the last is pushed, too
        ([0.1, 0.3, 0.5], [0.9, 0.97, 1.0], [1, 1, 0], [0.9, 0.96, 1.0]),  # the last is at its hard stop
        ([0.1, 0.14, 0.5], [0.1, 0.14, 0.17], [0, 0, -1], [0.096667, 0.136667, 0.176667]),  # the first is pushed
    ],
)
def test_carriages_keep_their_distances_also_at_hard_stops_and_in_a_row(old, new, rates, expected):
    gaps = [(0, 1, 0.04), (1, 2, 0.04)]
    rail = Rail(gaps, [[0] * 3, [1] * 3])
    moved = np.array([*new, *rates], float)
    kept = rail._keep_apart(moved, np.array([*old, 0, 0, 0.0]))
    assert kept
    np.testing.assert_allclose(moved[:3], expected, atol=1e-6)
    assert (np.diff(moved[:3]) >= 0.04 - 1e-11).all()
    assert ((moved[:3] >= 0) & (moved[:3] <= 1)).all()


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
