"""Tip and trocar of the PA-10 by Levenberg-Marquardt on elbow and wrist, beside two other methods."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twin
from made.srs import SrsArm
from twin.core.errors import KinematicsError, TwinError
from twin.core.units import DEG
from twin.kinematics import Pose, Tip, Trocar, compile_formula, solve
from twin.kinematics.point_search import PointSolver, point_solver
from twin.kinematics.solve import TOLERANCE, descend
from twin.robots import load_formula, pa10
from twin.validation.case import Case
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.residual_rows import Tolerances
from twin.validation.result import Residual
from twin.validation.trocar_methods import HEADING, SEARCHES, compare_three_methods

RANGE = np.array([177, 94, 174, 137, 255, 165, 255]) * DEG
LIMITS = np.stack([-RANGE, RANGE], axis=1)
LENGTHS = {"RL3": 0.45, "RL5": 0.48, "RL7": 0.07, "RL8": 0.33}
SHAFT = (0.0, 0.0, 1.0)
EXACT = 1e-12  # m
COUNT = 300


@pytest.fixture(scope="module")
def kin():
    return compile_formula(load_formula("pa10"))


@pytest.fixture(scope="module")
def solver(kin):
    return point_solver(kin)


@pytest.fixture(scope="module")
def problems(kin):
    """Poses of random postures within the limits, and a trocar on the shaft of each: every problem has a solution."""
    rng = np.random.default_rng(0)
    Ts = kin.forward_many(rng.uniform(LIMITS[:, 0], LIMITS[:, 1], (COUNT, 7)))
    depth = rng.uniform(0.05, 0.35, (COUNT, 1))
    return Ts, Ts[:, :3, 3] - depth * Ts[:, :3, 2]


@pytest.fixture(scope="module")
def postures():
    """Random postures to start from."""
    return np.random.default_rng(1).uniform(LIMITS[:, 0], LIMITS[:, 1], (COUNT, 7))


def test_random_starts_are_within_limits_on_one_side_only(solver):
    limits = np.tile([-np.inf, np.inf], (7, 1))
    limits[0] = [4.0, np.inf]
    limits[1] = [-np.inf, -4.0]
    starts = np.array(list(solver.starts(12, limits)))[len(solver.kin.formula.seeds) :]
    assert np.all((starts >= limits[:, 0]) & (starts <= limits[:, 1]))


def task(tip, trocar):
    return Tip(tip) + Trocar(trocar, axis=SHAFT)


def wrists(tips, trocars):
    """The wrist by construction: on the shaft, behind the tip by the length of hand and instrument."""
    u = (trocars - tips) / np.linalg.norm(trocars - tips, axis=1)[:, None]
    return tips + (LENGTHS["RL7"] + LENGTHS["RL8"]) * u


def misses(kin, qs, tips, trocars):
    """Errors of the tip and of the shaft, and distance of the tip beyond the trocar, in m: (k,) each."""
    Ts = kin.forward_many(qs)
    back = trocars - Ts[:, :3, 3]
    tip = np.linalg.norm(Ts[:, :3, 3] - tips, axis=1)
    shaft = np.linalg.norm(np.cross(back, Ts[:, :3, 2]), axis=1)
    return tip, shaft, -np.einsum("ki,ki->k", back, Ts[:, :3, 2])


def within(qs):
    return ((qs >= LIMITS[:, 0] - 1e-9) & (qs <= LIMITS[:, 1] + 1e-9)).all(axis=1)


def test_three_methods_agree_on_300_problems(kin, solver, problems):
    Ts, trocars = problems
    tips = Ts[:, :3, 3]
    points = solver.solve_many(tips, trocars, LIMITS)
    # 100: the joint-space search then ends at 1e-14 of the arm's length; the wrist magnifies its errors
    joints = [
        solve(kin, 100 * task(tip, trocar), limits=LIMITS, any_branch=True, rng=i).q
        for i, (tip, trocar) in enumerate(zip(tips, trocars, strict=True))
    ]
    closed = solver.closed(Ts)
    true = wrists(tips, trocars)
    np.testing.assert_allclose(closed[:, 1], true, rtol=0, atol=EXACT)
    np.testing.assert_allclose(points.points[:, 1], true, rtol=0, atol=EXACT)
    np.testing.assert_allclose(solver.places(np.array(joints))[:, 1], true, rtol=0, atol=EXACT)
    for qs in (points.q, np.array(joints)):
        tip, shaft, beyond = misses(kin, qs, tips, trocars)
        assert max(tip.max(), shaft.max()) <= EXACT
        assert beyond.min() > 0.04
        assert within(qs).all()
    # the lengths of the arm, and the points as the forward equations have them at these joints
    elbows, hands = points.points[:, 0], points.points[:, 1]
    np.testing.assert_allclose(np.linalg.norm(elbows, axis=1), LENGTHS["RL3"], rtol=0, atol=EXACT)
    np.testing.assert_allclose(np.linalg.norm(hands - elbows, axis=1), LENGTHS["RL5"], rtol=0, atol=EXACT)
    np.testing.assert_allclose(solver.places(points.q), points.points, rtol=0, atol=EXACT)


def test_the_elbow_is_that_of_a_closed_form_of_the_tests(solver, problems):
    """made.srs shares no code with the equations of the robot."""
    arm = SrsArm(LENGTHS["RL3"], LENGTHS["RL5"], LENGTHS["RL7"] + LENGTHS["RL8"], LIMITS[:6])
    Ts, trocars = problems
    found = solver.places(solver.inverse_many(Ts[:40]))
    for T, trocar, (elbow, wrist) in zip(Ts, trocars, found, strict=False):
        true = arm.at(T[:3, 3], trocar)
        np.testing.assert_allclose(elbow, true.elbow, rtol=0, atol=EXACT)
        np.testing.assert_allclose(wrist, true.wrist, rtol=0, atol=EXACT)


def test_one_start_fails_often_and_is_counted_by_how_it_fails(kin, solver, problems, postures):
    """From one random posture: solved, converged with the arm beyond the tip, or not converged."""
    Ts, trocars = problems
    tips = Ts[:, :3, 3]
    begin = solver.places(postures)
    found = solver.descend(begin, tips, trocars)
    mirrored = found.converged & ~found.solved
    np.testing.assert_allclose(
        found.points[mirrored, 1], 2 * tips[mirrored] - wrists(tips, trocars)[mirrored], rtol=0, atol=EXACT
    )
    stuck = found.residual[~found.converged]
    assert stuck.min() > 1e-5  # a minimum that is no solution, not a search that was ended too early
    assert 190 <= found.solved.sum() <= 240
    assert 30 <= mirrored.sum() <= 75
    assert 15 <= len(stuck) <= 55
    outside = solver.descend(solver.starts_outside(begin, tips, trocars), tips, trocars)
    assert outside.solved.sum() >= 285
    assert not (outside.converged & ~outside.solved).any()
    starts = zip(tips, trocars, postures, strict=True)
    joints = [descend(kin, task(tip, trocar), q, LIMITS).residual <= TOLERANCE for tip, trocar, q in starts]
    assert 230 <= sum(joints) < COUNT


def test_residuals_fall_from_start_to_end(solver, problems, postures):
    Ts, trocars = problems
    found = solver.descend(solver.places(postures), Ts[:, :3, 3], trocars)
    for row, residual, steps in zip(found.history, found.residual, found.iterations, strict=True):
        known = row[~np.isnan(row)]
        assert len(known) == steps + 1
        assert (np.diff(known) <= 0).all()
        assert known[-1] == residual


@pytest.mark.parametrize(
    "values",
    [{}, {"swivel": 0.7}, {"swivel": -2.5}, {"RL5": 0.5, "RL7": 0.08}, {"RL8": 0.25, "swivel": np.pi / 2}],
    ids=str,
)
def test_whole_poses_have_the_joints_of_the_equations(values):
    kin = compile_formula(load_formula("pa10"), parameters=values)
    rng = np.random.default_rng(3)
    Ts = kin.forward_many(rng.uniform(LIMITS[:, 0], LIMITS[:, 1], (100, 7)))
    qs = point_solver(kin).inverse_many(Ts)
    turned = np.angle(np.exp(1j * (qs - kin.inverse_many(Ts))))
    assert np.abs(turned).max() < 1e-10
    np.testing.assert_allclose(kin.forward_many(qs), Ts, rtol=0, atol=EXACT)


def test_what_is_out_of_reach_or_no_number_has_no_joints(solver):
    Ts = np.tile(np.eye(4), (3, 1, 1))
    Ts[0, :3, 3] = 0.3, 0.4, 0.2
    Ts[1, :3, 3] = 2.0, 0.0, 0.0
    Ts[2] = np.nan
    qs = solver.inverse_many(Ts)
    assert np.isfinite(qs[0]).all()
    assert np.isnan(qs[1:]).all()


def test_a_robot_solves_by_points_when_it_is_told():
    robot = twin.load("pa10")
    tip, trocar = np.array([0.34, 0.48, 0.0]), np.array([0.32, 0.48, 0.10])
    found = robot.solve(task(tip, trocar), method="points")
    assert found.residual < 1e-14
    assert max(x[0] for x in misses(robot.kinematics(), found.q[None], tip[None], trocar[None])[:2]) < EXACT
    # A seed is continued: a nearby target has a nearby solution.
    near = robot.solve(task([0.341, 0.48, 0.0], trocar), seed=found.q, method="points")
    assert np.abs(near.q - found.q).max() < 0.02


@pytest.fixture(scope="module")
def robot():
    return twin.load("pa10").with_inverse("points")


@pytest.fixture(scope="module")
def trajectory(robot):
    return twin.plan(robot, "circle")


def test_a_plan_is_the_same_by_points_and_by_the_equations(robot, trajectory):
    by_equations = robot.kinematics().inverse_many(trajectory.Ts_base_tool)
    np.testing.assert_allclose(trajectory.q, by_equations, rtol=0, atol=1e-12)
    assert np.nanmax(trajectory.rcm_error) < EXACT


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        (Pose(np.eye(4)), r"solves only Tip\(p\) \+ Trocar\(c, axis=\(0, 0, 1\)\)"),
        (Tip([0.3, 0.4, 0.1]), "solves only Tip"),
        (Tip([0.3, 0.4, 0.1]) + Trocar([0.3, 0.4, 0.2]), "solves only Tip"),  # the shaft points the other way
        (Tip([0.3, 0.4, 0.1], [0, 0, 0.1]) + Trocar([0.3, 0.4, 0.2], SHAFT), "tip in the origin of the tool frame"),
        (Tip([0.3, 0.4, 0.1]) + Trocar([0.3, 0.4, 0.2], SHAFT, depth=0.1), "free depth"),
        (task([0.3, 0.4, 0.1], [0.3, 0.4, 0.1]), "are the same point"),
        (task([1.5, 0.4, 0.1], [1.5, 0.4, 0.2]), "no P_c and P_m with the trocar between arm and tip in 48 starts"),
        (task([0.3, 0.4, -0.4], [0.3, 0.4, 0.1]), "no P_c and P_m"),  # 500 mm deep: the instrument has 400 mm
    ],
)
def test_other_tasks_and_targets_out_of_reach_are_refused(solver, wanted, text):
    with pytest.raises(KinematicsError, match=text):
        solver.solve(wanted, limits=LIMITS)


def test_limits_that_no_found_posture_keeps_are_named(solver):
    narrow = LIMITS.copy()
    narrow[3] = [-10 * DEG, 10 * DEG]
    with pytest.raises(KinematicsError, match=r"exceed a joint limit, at best by 1\.35") as refused:
        solver.solve(task([0.34, 0.48, 0.0], [0.32, 0.48, 0.10]), limits=narrow)
    assert refused.value.best.q[3] == pytest.approx(87.37881 * DEG, abs=1e-6)  # the elbow does not depend on the start


def test_robots_without_such_an_optimisation_say_so():
    robot = twin.load("lapbot")
    with pytest.raises(TwinError, match="has no search for points"):
        robot.with_inverse("points")
    with pytest.raises(KinematicsError, match="has no optimisation of points"):
        robot.solve(task([0, 0, 0], [0, 0, 0.1]), method="points")
    with pytest.raises(TwinError, match=r"there is no method 'point'\. Did you mean 'points'"):
        robot.solve(task([0, 0, 0], [0, 0, 0.1]), method="point")


def test_an_unknown_that_no_equation_gives_is_a_fault_of_the_formula():
    formula = load_formula("pa10")
    wrong = replace(formula, point_search=replace(formula.point_search, unknowns=("P_c", "P_w")))
    with pytest.raises(KinematicsError, match="no inverse equation gives its unknown 'P_w'"):
        compile_formula(wrong)


def test_a_start_in_the_redundant_direction_moves_little(kin, solver):
    """Damping keeps rounding from moving the elbow along its circle: the solution stays near the start."""
    q = np.array([61.41389, 8.88466, 0, 87.37881, -10.12347, 78.44788, 0]) * DEG
    tip = kin.forward(q)[:3, 3]
    trocar = tip - 0.1 * kin.forward(q)[:3, 2]
    begin = solver.places(q[None])
    found = PointSolver(kin, kin.formula.point_search).descend(begin, tip[None], trocar[None])
    np.testing.assert_allclose(found.points, begin, rtol=0, atol=EXACT)


# -- validation -------------------------------------------------------------------------------------------


def compared(robot, trajectory, formula=None, number=COUNT):
    """Compare the three methods as `twin validate pa10` does, with a faulty formula if one is given."""
    kin = robot.kinematics() if formula is None else compile_formula(formula)
    case = Case(kin, robot.cad, robot.protocol("circle"), trajectory, Path("unused"), Tolerances())
    out = EquationsComparison(coarse=np.arange(0, len(trajectory.t), 100))
    compare_three_methods(case, out, number)
    return out


def test_validation_compares_the_three_methods_and_counts_failures(robot, trajectory):
    out = compared(robot, trajectory)
    assert out.findings == []
    limits = {(r.pair, r.name): r.tolerance for r in out.residuals}
    own = ("P_m by points", "P_m by joints", "P_c along the protocol", "P_m along the protocol")
    assert limits == {("A", n): EXACT for n in own} | {("A-B", f"{n} by points"): 1e-9 for n in ("tip", "shaft")}
    assert max(r.worst for r in out.residuals) <= EXACT
    samples = {r.name: r.samples for r in out.residuals}
    assert samples["P_m by points"] == samples["P_m by joints"] == COUNT
    assert samples["P_c along the protocol"] == len(out.coarse)
    (table,) = out.tables.values()
    counts = [[int(cell) for cell in row[1:4]] for row in table.rows[:3]]
    assert [sum(row) for row in counts] == [COUNT] * 3
    assert counts[0][0] < counts[2][0] < counts[1][0]  # what fails from one start is counted, not hidden
    assert [row[5] for row in table.rows[1:3]] == [str(COUNT)] * 2
    for key in SEARCHES:
        history, outcome = out.series[key], out.series[f"{key}.outcome"]
        last = np.array([row[~np.isnan(row)][-1] for row in history])
        assert (last[outcome == 2] > 1e-6).all()
        assert (last[outcome < 2] <= (EXACT if key != "search.joints" else 1e-10)).all()


def wrong_forearm(P_c, P_m, P_d, P_tr, RL3, RL5, RL7, RL8):
    """Seeded: the forearm is 0.1 mm too long."""
    return pa10.collinear(P_c, P_m, P_d, P_tr, RL3, RL5 + 1e-4, RL7, RL8)


def wrong_instrument(P_c, P_m, P_d, P_tr, RL3, RL5, RL7, RL8):
    """Seeded: the instrument without the last micrometre."""
    return pa10.collinear(P_c, P_m, P_d, P_tr, RL3, RL5, RL7, RL8 - 1e-6)


def wrong_swivel(P_c, P_m, swivel):
    """Seeded: the elbow a thousandth of a degree beside its half-plane."""
    return pa10.at_swivel(P_c, P_m, swivel + 1e-3 * DEG)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"residual": wrong_forearm}, {"tip by points", "P_c along the protocol"}),
        ({"residual": wrong_instrument}, {"P_m by points", "P_m along the protocol", "P_c along the protocol"}),
        ({"redundant": wrong_swivel}, {"P_c along the protocol"}),
    ],
    ids=("forearm", "instrument", "swivel"),
)
def test_a_fault_of_the_optimisation_is_found_where_it_is(robot, trajectory, change, found):
    formula = robot.formula
    out = compared(robot, trajectory, replace(formula, point_search=replace(formula.point_search, **change)), 40)
    assert found <= {r.name for r in out.residuals if not r.agrees}
    assert "P_m by joints" not in {r.name for r in out.residuals if not r.agrees}
    assert {f.severity for f in out.findings} == {"disagreement"}


def test_the_methods_are_not_compared_after_another_disagreement(robot, trajectory):
    case = Case(robot.kinematics(), robot.cad, robot.protocol("circle"), trajectory, Path("unused"), Tolerances())
    first = Residual("A-B", "driven", "q3", "rad", 0.1, 0.1, 1e-8, 0.0, "circle")
    out = EquationsComparison([first], coarse=np.arange(0, len(trajectory.t), 100))
    compare_three_methods(case, out)
    assert out.residuals == [first]
    assert out.facts[HEADING] == {"compared": "no, because other rows disagree"}
