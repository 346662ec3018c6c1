"""Equations of motion of any mechanism: energy, power, a foreign engine on the exported file, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import twin
from made import column, gripper, mechanisms, transmissions
from made.lanes import thinned
from twin.core import spatial
from twin.core.errors import MechanismError
from twin.exchange.formats.mjcf.write import mjcf_text
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.model.body import Body
from twin.model.joint import Joint
from twin.reference.dynamics import Dynamics, SharedLoops
from twin.reference.holding_efforts import holding_efforts
from twin.simulation.dynamics.arm import arm, without_fixed
from twin.simulation.dynamics.computed_torque import EXACT_LIMIT, Conditions, DesiredMotion, run, side_by_side
from twin.simulation.dynamics.effort_plants import ModelPlant, MujocoPlant

MADE = {  # serial, with a coupling, with a loop, with motors on cables, with a lead screw
    "column": lambda path: column.mechanism(path / "column.urdf"),
    "gripper": lambda path: gripped(path / "gripper.urdf"),
    "bars": lambda path: mechanisms.four_bar(),
    "raven": lambda path: transmissions.raven(),
    "screwed": lambda path: transmissions.screwed(),
}


def gripped(path):
    path.write_text(gripper.urdf())
    return close(read(path)).mechanism


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    known = {}

    def made(name):
        if name not in known:
            path = tmp_path_factory.mktemp("made")
            mechanism = MADE[name](path) if name in MADE else twin.load(name).weighed().mechanism
            known[name] = Dynamics(mechanism)
        return known[name]

    return made


# The masses of a drawn robot take seconds; one of them stands for all in the default suite.
@pytest.fixture(params=[*MADE, *thinned(reversed(twin.names()), 9, slow=99)])
def dynamics(request, make):
    return make(request.param)


def states(d, count=2):
    """Yield solved states near home, with rates and accelerations that are large there."""
    rng = np.random.default_rng(1)
    size = sizes(d)
    for _ in range(count):
        state = d.model.solve(d.model.home().q + size * rng.uniform(-1, 1, d.n), d.model.home())
        yield state, 10 * size * rng.normal(size=d.n), 50 * size * rng.normal(size=d.n)


def sizes(d):
    return np.where([j.is_angle for j in d.mechanism.active], 0.1, 2e-3)


@pytest.mark.slow
def test_energy_and_its_slopes_are_mass_gravity_and_coriolis(dynamics):
    d = dynamics
    for state, qd, _ in states(d):
        M = d.mass_matrix(state)
        assert pytest.approx(M.T, abs=1e-14) == M
        assert np.linalg.eigvalsh(M)[0] > 0
        assert d.energy(state, qd)[0] == pytest.approx(0.5 * qd @ M @ qd, rel=1e-10)
        holding = np.array(list(holding_efforts(d.model, state).values()))
        assert d.gravity(state) == pytest.approx(holding, abs=1e-6 * np.abs(holding).max())
        slopes = []
        for i, h in enumerate(1e-3 * sizes(d)):
            step = h * np.eye(d.n)[i]
            ahead, behind = (d.mass_matrix(d.model.solve(state.q + s, state)) for s in (step, -step))
            slopes.append((ahead - behind) / (2 * h))
        slopes = np.array(slopes)
        lagrange = np.einsum("kij,k,j->i", slopes, qd, qd) - 0.5 * np.einsum("kij,i,j->k", slopes, qd, qd)
        scale = np.abs(lagrange).max()
        assert d.coriolis(state, qd) == pytest.approx(lagrange, abs=2e-6 * scale + 1e-12)
        # dM/dt - 2 C takes no power, whatever C is written as.
        assert qd @ (0.5 * np.einsum("kij,k->ij", slopes, qd) @ qd - d.coriolis(state, qd)) == pytest.approx(
            0, abs=2e-6 * np.abs(qd).max() * scale + 1e-12
        )


def test_forward_undoes_inverse_and_efforts_of_motors_do_the_same_work(dynamics):
    d = dynamics
    for state, qd, qdd in states(d):
        efforts = d.inverse(state, qd, qdd)
        assert d.forward(state, qd, efforts) == pytest.approx(qdd, rel=1e-8, abs=1e-9 * np.abs(qdd).max())
        assert efforts == pytest.approx(
            d.mass_matrix(state) @ qdd + d.coriolis(state, qd) + d.gravity(state),
            rel=1e-9, abs=1e-10 * np.abs(efforts).max(),
        )  # fmt: skip
        motors = d.mechanism.motor_efforts(d.inverse(state, qd, qdd))
        assert motors @ d.mechanism.motors(qd) == pytest.approx(efforts @ qd, rel=1e-9)


@pytest.mark.slow
def test_power_of_the_efforts_is_the_rise_of_energy(make):
    """Moves on by the equations, loops and friction included, and compares what went in with what is there."""
    for name in ("bars", "column", "raven"):
        base = make(name)
        d = Dynamics(base.mechanism, friction=0.02 * np.ones(base.n))
        plant, work = ModelPlant(d, 0.5e-3), 0.0
        q = d.model.home().q
        plant.reset(q, np.zeros(d.n))
        at = d.near(q)
        start, hold = sum(d.energy(at, plant.qd)), d.gravity(at)
        for i in range(40):
            effort = hold + 0.5 * sizes(d) * np.sin(0.3 * i + np.arange(d.n)) * np.abs(hold).max()
            power = []
            for _ in range(3):  # Simpson's rule over two steps
                power.append((effort - d.friction * plant.qd) @ plant.qd)
                if len(power) < 3:
                    plant.advance(effort, 0.5e-3)
            work += 0.5e-3 / 3 * (power[0] + 4 * power[1] + power[2])
        end = sum(d.energy(d.near(plant.q), plant.qd))
        assert end - start == pytest.approx(work, rel=1e-5)
        assert abs(work) > 1e-6


# -- a foreign engine on the exported file -------------------------------------------------------------


def test_mujoco_has_the_same_inverse_dynamics_on_the_exported_file(dynamics):
    mechanism = without_fixed(dynamics.mechanism)
    d = Dynamics(mechanism)
    plant = MujocoPlant(mjcf_text(mechanism), [j.name for j in mechanism.active], 0.0, 0.0)
    model, data = plant.model, plant.data
    for body in range(model.nbody):
        if model.body(body).name.endswith("_carrier"):  # 1 g that the file adds for a slide that closes a loop
            model.body_mass[body], model.body_inertia[body] = 1e-9, 1e-13
    for state, qd, qdd in states(d):
        plant.reset(state.q, qd)
        mujoco.mj_forward(model, data)
        M = np.array([column_of(model, data, unit) for unit in np.eye(model.nv)])
        bias, V = data.qfrc_bias.copy(), data.qvel.copy()
        G, drift = projection(plant), np.zeros(model.nv)
        if model.neq:
            h, qpos = 1e-6, data.qpos.copy()
            ends = []
            for sign in (h, -h):
                data.qpos[:] = qpos
                mujoco.mj_integratePos(model, data.qpos, V, sign)
                ends.append(rows(plant))
            data.qpos[:] = qpos
            J = rows(plant)
            drift[plant._free] = -np.linalg.pinv(J[:, plant._free], rcond=1e-9) @ ((ends[0] - ends[1]) @ V / (2 * h))
            assert pytest.approx(V, abs=1e-9) == G @ qd
        expected = G.T @ (M @ (G @ qdd + drift) + bias)
        assert d.mass_matrix(state) == pytest.approx(G.T @ M @ G, rel=1e-6, abs=1e-9 * np.abs(M).max())
        assert d.inverse(state, qd, qdd) == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def column_of(model, data, unit):
    out = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, out, unit)
    return out


def rows(plant):
    mujoco.mj_fwdPosition(plant.model, plant.data)
    J = np.zeros((plant.data.nefc, plant.model.nv))
    for i in range(len(J)):
        unit = np.eye(len(J))[i]
        mujoco.mj_mulJacTVec(plant.model, plant.data, J[i], unit)
    return J


def projection(plant):
    G = np.zeros((plant.model.nv, len(plant._rates)))
    G[plant._rates] = np.eye(len(plant._rates))
    if plant.model.neq:
        J = rows(plant)
        G[plant._free] = -np.linalg.pinv(J[:, plant._free], rcond=1e-9) @ J[:, plant._rates]
    return G


# -- rotors, and what has no answer ----------------------------------------------------------------------


def test_rotors_turn_with_the_motors_and_joints_feel_them_together():
    m = transmissions.screwed()
    bare = replace(m, actuators=tuple(replace(a, rotor_inertia=None) for a in m.actuators))
    d, without = Dynamics(m), Dynamics(bare)
    inertias = {a.name: a.rotor_inertia for a in m.actuators}
    rng = np.random.default_rng(2)
    for _ in range(5):
        q, qd = 0.05 * rng.normal(size=(2, d.n))
        motors = m.motors(qd)
        energy = 0.5 * sum(inertias[n] * v * v for n, v in zip(m.motor_names, motors, strict=True))
        assert d.energy(q, qd)[0] - without.energy(q, qd)[0] == pytest.approx(energy, rel=1e-9)
    felt = d.mass_matrix(q) - without.mass_matrix(q)
    assert np.abs(felt - np.diag(np.diag(felt))).max() > 1e-3  # cables: who moves one joint turns several motors
    assert felt[0, 0] == pytest.approx(transmissions.SCREW.rotor_inertia * (2 * np.pi / 0.002) ** 2, rel=1e-9)


def test_a_mass_that_nothing_leads_is_refused_and_a_massless_branch_is_left_out():
    m = transmissions.raven()
    hanging = Joint("swing", "revolute", "fore", "bob", spatial.pose(p=[0, 0, 0.1]))
    light = replace(m, bodies=(*m.bodies, Body("bob")), joints=(*m.joints, hanging), rest={})
    heavy = replace(light, bodies=(*m.bodies, Body("bob", (), mechanisms.solid(0.1, (0, 0, 0.1), (0.1, 0.1, 0.1)))))
    q = np.zeros(4)
    assert Dynamics(light).mass_matrix(q) == pytest.approx(Dynamics(m).mass_matrix(q), abs=1e-12)
    assert {b.name for b in without_fixed(light).bodies} == {b.name for b in m.bodies}
    with pytest.raises(
        MechanismError, match=r"no drive and no loop determines the motion of joint 'swing'.*drive the joint"
    ):
        Dynamics(heavy).inverse(q, q, q)
    with pytest.raises(MechanismError, match="friction: 4 finite numbers"):
        Dynamics(m, friction=[1.0, 2.0])
    with pytest.raises(MechanismError, match=r"q has shape \(3,\)"):
        Dynamics(m).gravity(np.zeros(3))
    unweighed = replace(m, bodies=tuple(replace(b, inertia=None) if b.name == "fore" else b for b in m.bodies))
    with pytest.raises(MechanismError, match="body 'fore' has no mass: give its parts a material with a density"):
        arm(unweighed)
    bare = replace(unweighed, bodies=tuple(replace(b, meshes=()) for b in unweighed.bodies))
    with pytest.raises(MechanismError, match="no body with a mass is moved by q3"):
        arm(bare)


# -- computed torque on all kinds ------------------------------------------------------------------------


def sweep(d, seconds=0.2):
    """Return a motion from home and back, from rest to rest."""
    k = round(1000 * seconds)
    t = np.arange(k + 1) / 1000
    phase = 2 * np.pi * t / seconds
    s, v, a = (1 - np.cos(phase)) / 2, np.sin(phase) * np.pi / seconds, np.cos(phase) * 2 * (np.pi / seconds) ** 2
    way = sizes(d) * np.cos(np.arange(d.n))
    return DesiredMotion(t, d.model.home().q + s[:, None] * way, v[:, None] * way, a[:, None] * way)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["column", "bars", "raven", "screwed"])
def test_any_of_them_follows_a_motion(make, name):
    whole = arm(make(name).mechanism)
    whole = replace(whole, mjcf=mjcf_text(whole.mechanism), limit=np.full(len(whole.limit), np.inf))
    motion = sweep(whole.dynamics())
    exact = run(whole, motion)
    assert exact.tip_max < EXACT_LIMIT / 2
    wrong = run(whole, motion, Conditions().realistic(0.05))
    assert 5 * exact.tip_max < wrong.tip_max < 1e-3
    if not whole.mechanism.loops:  # which the engine closes with springs
        ours = run(whole, motion, Conditions(plant="pinocchio"))
        assert ours.tip_error == pytest.approx(exact.tip_error, abs=1e-9)


@pytest.mark.parametrize("name", ["bars", "raven"])
def test_efforts_of_states_side_by_side_are_those_of_each_state_alone(make, name):
    """Loops are closed for all at once, continued from before; alone, each is solved from the rest poses."""
    base = make(name)
    light = Dynamics(base.mechanism, friction=0.02 * np.ones(base.n))
    heavy = Dynamics(base.mechanism, friction=0.05 * np.ones(base.n), rotor=0.1)
    models, rng = [light, heavy, light], np.random.default_rng(1)
    loops = SharedLoops(models)
    q = np.tile(base.model.home().q, (3, 1))
    # far steps, which Newton's method solves, then ticks, which are predicted and corrected
    for stride in (0.3, 0.3, *[0.003] * 4, *[1e-4] * 4):
        q = q if stride < 0.1 else np.tile(base.model.home().q, (3, 1))
        q = q + stride * sizes(base) * rng.uniform(-1, 1, (3, base.n))
        qd, qdd = rng.normal(size=(2, 3, base.n))
        found = loops.efforts(q, qd, qdd)
        for k, model in enumerate(models):
            alone = model.inverse(model.near(q[k]), qd[k], qdd[k])
            assert found[k] == pytest.approx(alone, rel=1e-8, abs=1e-9 * np.abs(alone).max())


def test_runs_side_by_side_do_not_affect_each_other(make):
    whole = arm(make("bars").mechanism)
    whole = replace(whole, mjcf=mjcf_text(whole.mechanism), limit=np.full(len(whole.limit), np.inf))
    motion = sweep(whole.dynamics(), 0.04)
    cases = [Conditions(), Conditions().realistic(0.05), Conditions().realistic(0.05, 3)]
    runs = side_by_side(whole, motion, cases)
    assert [made.conditions for made in runs] == cases
    for case, found in zip(cases, runs, strict=True):
        alone = run(whole, motion, case)
        assert found.effort == pytest.approx(alone.effort, rel=1e-8, abs=1e-9 * np.abs(alone.effort).max())
        assert found.tip_error == pytest.approx(alone.tip_error, abs=1e-11)
    assert not np.allclose(runs[0].effort, runs[1].effort)


@pytest.mark.slow
def test_motors_stop_at_their_limits_each_at_its_own(make):
    """One motor of three on cables gives less than is asked: all joints that it leads to are off."""
    whole = arm(make("raven").mechanism)
    motion = sweep(whole.dynamics())
    free = run(replace(whole, limit=np.full(4, np.inf)), motion, Conditions(plant="pinocchio"))
    limit = np.array([np.inf, np.inf, np.inf, 0.9 * np.abs(free.effort[:, 3]).max()])
    weak = run(replace(whole, limit=limit), motion, Conditions(plant="pinocchio"))
    assert weak.saturated.any(axis=0).tolist() == [False, False, False, True]
    assert np.abs(weak.effort[:, 3]).max() == pytest.approx(limit[3])
    assert whole.motors == ("lift", "m1", "m2", "m3")
    assert whole.effort_units == ("N", "N m", "N m", "N m")
    assert whole.joint_efforts(np.eye(4)) @ whole.mechanism.motor_matrix == pytest.approx(np.eye(4))
