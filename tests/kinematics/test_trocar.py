"""Tip and trocar: the closed form of S-R-S arms, the general solver, and each as the other's oracle."""

from __future__ import annotations

import numpy as np
import pytest

from made.srs import SrsArm
from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.units import DEG
from twin.kinematics import Tip, Trocar, compile_formula, solve
from twin.robots import load_formula

RANGE = np.array([177, 94, 174, 137, 255, 165, 255]) * DEG
LIMITS = np.stack([-RANGE, RANGE], axis=1)
LENGTHS = (0.45, 0.48, 0.40)
TIP_TOL = 1e-9  # m
SHAFT = (0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def kin():
    return compile_formula(load_formula("pa10"))


@pytest.fixture(scope="module")
def arm():
    return SrsArm(*LENGTHS, LIMITS[:6])


def problems(kin, count, seed=0):
    """Tip and trocar of random postures within the limits: each problem has a solution."""
    rng = np.random.default_rng(seed)
    qs = rng.uniform(LIMITS[:, 0], LIMITS[:, 1], (count, 7))
    Ts = kin.forward_many(qs)
    depth = rng.uniform(0.05, 0.35, (count, 1))
    return Ts[:, :3, 3], Ts[:, :3, 3] - depth * Ts[:, :3, 2]


def misses(kin, q, tip, trocar):
    """Tip error, trocar error, and how far the trocar is behind the tip, all in m."""
    T = kin.forward(np.append(q[:6], 0.0))
    back = trocar - T[:3, 3]
    return np.linalg.norm(T[:3, 3] - tip), np.linalg.norm(np.cross(back, T[:3, 2])), -back @ T[:3, 2]


# -- closed form ---------------------------------------------------------------------------------------


def test_the_worked_example_to_its_printed_digits(arm):
    """facts: P_tr = (0.32, 0.48, 0.10), P_d = (0.34, 0.48, 0), swivel 0."""
    found = arm.at([0.34, 0.48, 0.0], [0.32, 0.48, 0.10])
    np.testing.assert_allclose(found.q / DEG, [61.41389, 8.88466, 0, 87.37881, -10.12347, 78.44788], atol=5.1e-6)
    np.testing.assert_allclose(found.elbow, [0.03325, 0.06103, 0.44460], atol=5.1e-6)
    np.testing.assert_allclose(found.wrist, [0.26155, 0.48000, 0.39223], atol=5.1e-6)
    assert np.linalg.norm(found.wrist) == pytest.approx(0.672797, abs=5.1e-7)


def test_every_reachable_problem_is_solved_within_the_limits(kin, arm):
    for tip, trocar in zip(*problems(kin, 2000), strict=True):
        found = arm.solve(tip, trocar)
        tip_off, shaft_off, behind = misses(kin, found.q, tip, trocar)
        assert max(tip_off, shaft_off) < TIP_TOL
        assert behind > 0  # never with the tip on the wrong side
        assert ((found.q >= LIMITS[:6, 0]) & (found.q <= LIMITS[:6, 1])).all()


def test_the_equations_of_the_arm_give_the_same_joints(kin, arm):
    """The formula's own inverse at the pose that the closed form reaches, at swivel 0."""
    tips, trocars = problems(kin, 300, 5)
    same = 0
    for tip, trocar in zip(tips, trocars, strict=True):
        q = arm.at(tip, trocar).q
        back = kin.inverse(kin.forward(np.append(q, 0.3)))
        np.testing.assert_allclose(kin.forward(back), kin.forward(np.append(q, 0.3)), atol=1e-12)
        same += np.allclose(back[:6], q, atol=1e-9)
    assert same > 60  # the others are another of the eight postures


@pytest.mark.slow
def test_the_best_swivel_is_the_best_of_a_fine_scan(kin, arm):
    for tip, trocar in zip(*problems(kin, 15, 2), strict=True):
        margins = [arm.at(tip, trocar, s).margin for s in np.linspace(-np.pi, np.pi, 721)]
        assert arm.best(tip, trocar).margin > max(margins) - 0.08


def test_a_circle_closes_in_the_joints_at_one_swivel(kin, arm):
    a = np.linspace(0, 2 * np.pi, 1000)
    tips = np.array([0.32, 0.48, 0.0]) + 0.02 * np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    trocar = np.array([0.32, 0.48, 0.10])
    path = arm.along(tips, trocar)
    qs = np.array([p.q for p in path])
    assert len({p.swivel for p in path}) == 1
    assert np.abs(qs[0] - qs[-1]).max() < 1e-12
    assert np.abs(np.diff(qs, axis=0)).max() < 0.02
    assert max(max(misses(kin, q, t, trocar)[:2]) for q, t in zip(qs, tips, strict=True)) < TIP_TOL
    assert min(p.margin for p in path) > 0.15


def test_tip_to_the_right_is_wrist_to_the_left(arm):
    trocar = np.array([0.32, 0.48, 0.10])
    left, right = (arm.at([0.32 + dx, 0.48, 0.0], trocar) for dx in (-0.02, 0.02))
    assert right.wrist[0] < left.wrist[0]
    below, outside = 0.1, np.hypot(0.02, 0.1)
    lever = (0.40 - outside) / outside  # what is outside of the trocar to what is inside
    assert (left.wrist - right.wrist)[0] == pytest.approx(0.04 * lever, rel=1e-9)
    assert below < outside


@pytest.mark.parametrize(
    ("tip", "trocar", "text"),
    [
        ((0.3, 0.4, 0.1), (0.3, 0.4, 0.1), "tip is in the trocar at .300.0, 400.0, 100.0. mm"),
        ((0.3, 0.4, -0.4), (0.3, 0.4, 0.1), "500.0 mm from the tip, beyond the wrist: the instrument is 400.0 mm long"),
        ((1.2, 0.4, 0.0), (1.2, 0.4, 0.1), r"the arm reaches up to 930.0 mm.*No depth on this line is within reach"),
        (
            (0.84, 0.0, 0.1),
            (0.84, 0.0, 0.2),
            r"up to 930.0 mm. On the same line the tip can be at \(840.0, 0.0, -0.9\) mm, a depth of 200.9 mm",
        ),
        ((0.0, 0.0, 0.1), (0.0, 0.0, 0.2), "on the vertical through the shoulder"),
        ((0.3, 0.4, np.nan), (0.3, 0.4, 0.1), "three finite numbers"),
    ],
)
def test_what_cannot_be_is_said_with_what_would_do(arm, tip, trocar, text):
    with pytest.raises(KinematicsError, match=text):
        arm.solve(np.array(tip), np.array(trocar))


def test_narrow_limits_and_a_thick_arm_are_named():
    with pytest.raises(KinematicsError, match="no lower limit may exceed its upper limit"):
        SrsArm(*LENGTHS, LIMITS[:6, ::-1])
    with pytest.raises(KinematicsError, match="must be above 0"):
        SrsArm(0.45, 0.0, 0.4, LIMITS[:6])
    narrow = LIMITS[:6].copy()
    narrow[3] = [-10 * DEG, 10 * DEG]
    with pytest.raises(KinematicsError, match=r"no swivel of the elbow keeps.*q4 = .* outside -10 .. 10 deg"):
        SrsArm(*LENGTHS, narrow).solve([0.34, 0.48, 0.0], [0.32, 0.48, 0.10])
    with pytest.raises(KinematicsError, match="is inside the arm, 300 mm about its centre lines"):
        SrsArm(*LENGTHS, LIMITS[:6], body=0.3).solve([0.2, 0.1, 0.0], [0.2, 0.1, 0.10])


# -- the general solver ----------------------------------------------------------------------------------


def trocar_task(tip, trocar):
    return Tip(tip) + Trocar(trocar, axis=SHAFT)


def check_solver(kin, arm, count, seed):
    for i, (tip, trocar) in enumerate(zip(*problems(kin, count, seed), strict=True)):
        found = solve(kin, trocar_task(tip, trocar), limits=LIMITS, any_branch=True, rng=i)
        tip_off, shaft_off, behind = misses(kin, found.q, tip, trocar)
        assert max(tip_off, shaft_off) < TIP_TOL
        assert behind > 0
        assert ((found.q >= LIMITS[:, 0]) & (found.q <= LIMITS[:, 1])).all()
        np.testing.assert_allclose(
            found.T_base_tool[:3, 3] - 0.4 * found.T_base_tool[:3, 2], arm.wrist(tip, trocar), atol=1e-8
        )


def test_the_solver_solves_what_the_closed_form_solves(kin, arm):
    check_solver(kin, arm, 100, 11)


@pytest.mark.slow
def test_the_solver_solves_2000_random_problems(kin, arm):
    check_solver(kin, arm, 2000, 0)


def test_a_path_is_continued_near_its_last_posture(kin):
    """Warm starts: smooth and exact, but the elbow is elsewhere after a closed circle."""
    a = np.linspace(0, 2 * np.pi, 181)
    trocar, q = np.array([0.32, 0.48, 0.10]), np.array([61.41389, 8.88466, 0, 87.37881, -10.12347, 78.44788, 0]) * DEG
    rows = []
    for x in a:
        tip = np.array([0.32 + 0.02 * np.cos(x), 0.48 + 0.02 * np.sin(x), 0.0])
        found = solve(kin, trocar_task(tip, trocar), seed=q, limits=LIMITS)
        q = found.q
        rows.append(q)
        assert max(misses(kin, q, tip, trocar)[:2]) < TIP_TOL
    rows = np.array(rows)
    assert np.abs(np.diff(rows, axis=0)).max() < 0.02
    drift = np.abs(rows[-1] - rows[0]).max()
    assert 1e-4 < drift < 0.05  # what a fixed swivel does away with (see the closed form)


def test_the_usual_residual_accepts_the_wrong_side_and_ours_does_not(kin, at_pose):
    """u x (P_m - P_tr) vanishes with the wrist beyond the tip as well; w + |w| a is then 2 |w|."""
    tip, trocar = np.array([0.5, 0.2, 0.2]), np.array([0.5, 0.2, 0.3])
    q = solve(kin, trocar_task(tip, trocar), limits=LIMITS, any_branch=True).q
    T = kin.forward(q)
    wrong = spatial.pose(T[:3, :3] @ np.diag([1.0, -1.0, -1.0]), tip)
    cross = np.cross(trocar - tip, wrong[:3, 2])
    assert np.linalg.norm(cross) < 1e-9
    (_, term) = trocar_task(tip, trocar).terms
    assert np.linalg.norm(at_pose(term, wrong)[0]) == pytest.approx(0.2, rel=1e-6)


def test_the_shaft_outside_is_on_the_other_side_of_the_tip():
    from types import SimpleNamespace

    from twin.validation.report_curves import OUTER_POINT_DISTANCE, sideways_motion

    tilt = np.linspace(-0.3, 0.3, 7)
    R = np.array([spatial.exp_so3([0.0, a, 0.0]) for a in tilt])
    port, depth = np.array([0.1, 0.2, 0.3]), 0.08
    Ts = spatial.pose(R, port + depth * R[:, :, 2])
    rcm = np.array([[np.nan] * 3, *[port] * 6])
    plan = SimpleNamespace(rcm=rcm, depth=np.full(7, depth), Ts_base_frame=Ts, shaft_axis=np.array([0, 0, 2.0]))
    tip, outside = sideways_motion(plan).T
    assert np.isnan([tip[0], outside[0]]).all()
    np.testing.assert_allclose(outside[1:], -OUTER_POINT_DISTANCE / depth * tip[1:], atol=1e-12)
    np.testing.assert_allclose(tip[1:], depth * np.sin(tilt[1:] - tilt[1:].mean()), atol=1e-12)
