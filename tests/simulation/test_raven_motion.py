"""Dynamics of the Raven-II: the published closed form, the mechanism's dynamics, and MuJoCo."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import twin
from twin.core.errors import MechanismError, TwinError
from twin.core.units import DEG
from twin.exchange.formats.mjcf.write import mjcf_text
from twin.reference import inertia
from twin.robots import _raven_motion
from twin.simulation.dynamics.arm import arm
from twin.simulation.dynamics.effort_plants import ModelPlant, MujocoPlant
from twin.validation.closed_form import judge

DATA = tomllib.loads((Path(__file__).parents[1] / "data/raven.toml").read_text())
FORM = _raven_motion.MOTION
MIRROR = np.array([1, 1, 1, -1, 1, -1, 1.0])


@pytest.fixture(scope="module", params=[n for n in twin.names() if n.startswith("raven_")])
def robot(request):
    return twin.load(request.param)


@pytest.fixture(scope="module")
def left():
    return of(twin.load("raven_left"))


def of(robot):
    return arm(robot.mechanism, inertia.of_robot(robot.files.cad))


def joints(row):
    return np.array(row["joints"]) * [DEG, DEG, 1]


def states(count, seed=0):
    rng = np.random.default_rng(seed)
    low, high = np.array([0, 0.8, 0.25, -1, -1, -1, 0]), np.array([1.5, 2.3, 0.55, 1, 1, 1, 1])
    return [(rng.uniform(low, high), rng.uniform(-1, 1, 7) * [1, 1, 0.2, 2, 2, 2, 2]) for _ in range(count)]


def test_the_closed_form_has_the_published_values():
    at = FORM.compiled()(joints(DATA["motion"]), np.zeros(3))
    np.testing.assert_allclose(at.M, DATA["motion"]["M"], atol=1e-5)
    np.testing.assert_allclose(at.g, DATA["motion"]["g"], atol=1e-5)


def test_the_released_gravity_compensation_has_its_values():
    form = replace(FORM, parameters=_raven_motion.COMPENSATION)
    at = form.compiled()(joints(DATA["compensation"]), np.zeros(3))
    np.testing.assert_allclose(at.g, DATA["compensation"]["g"], atol=1e-6)


def test_the_mechanism_has_the_published_values(robot):
    """M and g of both arms at home; the mirror image changes neither. Rotors are not in the publication."""
    dynamics = of(robot).dynamics()
    q = np.zeros(7)
    q[:3] = joints(DATA["motion"])
    np.testing.assert_allclose((dynamics.mass_matrix(q) - dynamics.rotor)[:3, :3], DATA["motion"]["M"], atol=1e-5)
    np.testing.assert_allclose(dynamics.gravity(q)[:3], DATA["motion"]["g"], atol=1e-5)


def test_closed_form_and_mechanism_agree(robot):
    found = twin.equations_of_motion(robot, states=60)
    assert found.verdict == "agree"
    assert found.judged.cause == ""
    assert max(r.worst for r in found.judged.rows) < 1e-8
    assert found.judged.balance < 1e-9
    assert found.judged.least > 0.07


def changed(name, by):
    kept = [replace(p, value=p.value + by) if p.name == name else p for p in FORM.parameters]
    assert kept != list(FORM.parameters)
    return replace(FORM, parameters=tuple(kept))


def edited(edit):
    return replace(FORM, terms=lambda q, qd, p: edit(*(ca.SX(x) for x in FORM.terms(q, qd, p))))


def turned(M, C, g):
    g[1] = -g[1]
    return M, C, g


def dropped(M, C, g):
    M[0, 1] = M[1, 0] = 0
    return M, C, g


SEEDS = {
    "mass": (changed("link3.m", 0.01), "link3.m = 0.407 kg instead of 0.417", {"inertia insertion", "gravity elbow"}),
    "product": (changed("link3.Ixz", 1e-3), "link3.Ixz = -0.011433 kg m2 instead of -0.010433", {"inertia shoulder"}),
    "moment": (changed("link2.my", 0.01), "link2.my = -0.129524 kg m instead of -0.119524", {"gravity elbow"}),
    "Coriolis": (edited(lambda M, C, g: (M, -C, g)), "the sign of the Coriolis effort", {"Coriolis shoulder"}),
    "gravity": (edited(lambda M, C, g: (M, C, -g)), "the sign of gravity", {"gravity shoulder"}),
    "one sign": (edited(turned), "the sign of gravity of elbow", {"gravity elbow"}),
    "one term": (edited(dropped), "the term inertia shoulder-elbow", {"inertia shoulder-elbow"}),
    "transposed": (edited(lambda M, C, g: (M, C.T, g)), "C is inconsistent with M", {"Coriolis elbow"}),
}


@pytest.mark.parametrize("name", SEEDS)
def test_a_seeded_fault_is_located_and_named(left, name):
    form, cause, terms = SEEDS[name]
    found = judge(form, left.dynamics(), 30)
    located = {f.where for f in found.findings if f.code == "motion.differs"}
    assert terms <= located
    assert located == {r.term for r in found.rows if not r.agrees}
    assert found.cause == cause
    assert {f.cause for f in found.findings if f.code == "motion.differs"} == {cause}


def test_parameters_that_cannot_be_told_apart_are_all_named(left):
    found = judge(changed("link2.mz", 0.002), left.dynamics(), 30)
    assert {f.where for f in found.findings} == {"gravity shoulder"}
    assert "link2.mz = -0.106395" in found.cause
    assert " or link1.my" in found.cause or "link1.my" in found.cause.split(" or ")[0]


def test_two_faults_at_once_are_not_given_one_cause(left):
    parameters = list(changed("link3.m", 0.01).parameters)
    both = [replace(p, value=p.value + 2e-3) if p.name == "link3.Ixz" else p for p in parameters]
    found = judge(replace(FORM, parameters=tuple(both)), left.dynamics(), 30)
    assert found.findings
    assert found.cause == ""


def test_a_robot_without_equations_of_motion_says_so():
    with pytest.raises(TwinError, match="pa10 has no published equations of motion"):
        twin.equations_of_motion(twin.load("pa10"))


def test_power_balance_of_all_joints(robot):
    """qd (dM/dt - 2 C) qd = 0, with dM/dt along the motion by differences of fourth order."""
    dynamics = of(robot).dynamics()
    h = 1e-3
    for q, qd in states(20):
        M = [dynamics.mass_matrix(q + k * h * qd) for k in (-2, -1, 1, 2)]
        change = (M[0] - 8 * M[1] + 8 * M[2] - M[3]) / (12 * h)
        kinetic, centrifugal = qd @ change @ qd, qd @ dynamics.coriolis(q, qd)
        size = np.abs(np.outer(qd, qd) * dynamics.mass_matrix(q)).max()
        assert abs(kinetic - 2 * centrifugal) <= 1e-9 * size


def test_the_arms_are_mirror_images_in_their_dynamics():
    left, right = (of(twin.load(f"raven_{side}")).dynamics() for side in ("left", "right"))
    for q, qd in states(20):
        efforts = left.inverse(q, qd, 0.3 * qd)
        np.testing.assert_allclose(
            right.inverse(MIRROR * q, MIRROR * qd, MIRROR * 0.3 * qd), MIRROR * efforts, atol=1e-7
        )


def test_coupled_cables_change_the_motors_and_the_rotors(robot):
    coupled = robot.with_transmission("coupled")
    one = coupled.mechanism.motors(np.eye(7)).T
    np.testing.assert_allclose(one[:3, :3], DATA["coupled"]["matrix"], atol=1e-6)
    np.testing.assert_array_equal(one[3:], robot.mechanism.motors(np.eye(7)).T[3:])
    plain, other = of(robot).dynamics().rotor, of(coupled).dynamics().rotor
    J, A = 2.1e-5, np.array(DATA["coupled"]["matrix"])
    np.testing.assert_allclose(other[:3, :3], J * A.T @ A, rtol=1e-6)
    np.testing.assert_allclose(plain[:3, :3], np.diag(J * np.array([136.1963, 121.5221, 2158.59]) ** 2), rtol=1e-6)
    with pytest.raises(MechanismError, match="variant of a transmission 'cupled'"):
        robot.with_transmission("cupled")


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('frame = "frame3"', 'frame = "frame2"', "frame2.*Known: .*frame3"),
        ("value = 0.372", "value = 0", "mass"),
        ("tensor = { value = [", "tensor = { value = [-", "tensor"),
    ],
)
def test_an_inertia_file_that_is_wrong_is_refused(robot, tmp_path, old, new, match):
    text = (robot.files.cad / "inertia.toml").read_text()
    assert old in text
    (tmp_path / "inertia.toml").write_text(text.replace(old, new))
    with pytest.raises(TwinError, match=match):
        inertia.weighed(inertia.of_robot(tmp_path), robot.mechanism)


def simulated(arm, seconds, friction, closed, step=1e-3):
    """Largest difference of the joints of both plants; both get the same efforts, or efforts by their own state."""
    dynamics = arm.dynamics(friction=friction)
    ours = ModelPlant(dynamics, step)
    foreign = MujocoPlant(mjcf_text(arm.mechanism), [j.name for j in arm.mechanism.active], 0.0, friction, step)
    middle = np.array([30 * DEG, 90 * DEG, 0.4, 0, 0, 0, 0.3])
    sway = np.array([8 * DEG, 6 * DEG, 0.01, 0.5, 0.3, 0.3, 0.1])
    w = 2 * np.pi * np.array([0.25, 0.2, 0.15, 0.3, 0.2, 0.25, 0.3])
    kp = np.array([454, 361, 5.7e4, 0.7, 1, 1, 1])
    kd = np.array([12, 9.6, 4564, 0.01, 0.02, 0.02, 0.02])

    def efforts(t, plant):
        q, qd = middle + sway * (1 - np.cos(w * t)) / 2, sway * w * np.sin(w * t) / 2
        feed = dynamics.inverse(q, qd, sway * w**2 * np.cos(w * t) / 2)
        return feed + kp * (q - plant.q) + kd * (qd - plant.qd)

    ours.reset(middle, np.zeros(7))
    foreign.reset(middle, np.zeros(7))
    worst = 0.0
    for k in range(round(seconds / 1e-3)):
        tau = efforts(k * 1e-3, ours)
        foreign.advance(efforts(k * 1e-3, foreign) if closed else tau, 1e-3)
        ours.advance(tau, 1e-3)
        worst = max(worst, np.abs(ours.q - foreign.q).max())
    return worst


@pytest.mark.slow
def test_mujoco_moves_as_the_model_does(left):
    """From efforts to joints at 1 kHz, without friction; efforts of our run are given to MuJoCo without feedback."""
    assert simulated(left, 0.5, np.zeros(7), closed=False) < 1e-8


@pytest.mark.nightly
def test_mujoco_moves_as_the_model_does_for_ten_seconds(left):
    """Both by Runge-Kutta of fourth order in steps of 1 ms. Without friction and feedback the arm is unstable under
    gravity, and rounding errors grow; so the run without feedback has viscous friction, and the other has none."""
    assert simulated(left, 10, np.zeros(7), closed=True) < 1e-9
    assert simulated(left, 10, left.friction, closed=False) < 1e-6
