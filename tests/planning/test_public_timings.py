"""Public inputs on which solvers of the timing failed, or gave a wrong duration without failing.

toppra "as it comes" is called with times in s, as its users do; twin makes every problem dimensionless first. The
numbers are those of the reports. Where a report has its numbers in a file that was not at hand, or none at all, the row
has the same kind of input, and `source` says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from twin.core.errors import TimingError
from twin.planning import toppra_solver
from twin.planning.timing import time_path

FAILS = "fails"


@dataclass(frozen=True)
class Input:
    """Waypoints (k, n), evenly spaced over a cubic spline, with limits (n,) of speed and acceleration.

    `points` is the number of grid points; `duration` in s is known if all joints move on one straight line; `plain` is
    what toppra gives as it comes: a duration in s, or `FAILS`. `dt` is the sampling time in s.
    """

    source: str
    waypoints: list
    speed: list
    acceleration: list
    points: int
    plain: float | str
    duration: float | None = None
    dt: float = 1e-5


def steps(size: float, noise: float, seed: int) -> list:
    """Return ten waypoints in even steps on a line, up to a noise that `numpy.allclose` does not see."""
    rng = np.random.default_rng(seed)
    one = size * rng.normal(size=(1, 6))
    return np.cumsum(np.concatenate([np.zeros((1, 6)), one + noise * rng.normal(size=(9, 6))]), axis=0).tolist()


def rising(first: float, last: float) -> list:
    return [[x] * 3 for x in np.linspace(first, last, 10)]


NEARLY_THERE = [
    [-9.089468271438139e-07, -0.46400441351211447, -0.5760014655483718],
    [0.0, -0.464, -0.576],
]
"""The first three joints of hungpham2511/toppra issue 17; the others follow in the row."""

INPUTS = {
    "toppra 17": Input(
        "hungpham2511/toppra issue 17: two waypoints a few micrometres or microradians apart",
        [
            [*NEARLY_THERE[0], -3.9375206752326924e-07, -1.6999970211081608, 5.429519493702008e-06],
            [*NEARLY_THERE[1], 0.0, -1.7, 0.0],
        ],
        [3] * 6,
        [4] * 6,
        101,
        FAILS,
        2 * np.sqrt(5.429519493702008e-06 / 4),
    ),
    "toppra 17, problem suite": Input(
        "hungpham2511/toppra, tests/retime_robustness/problem_suite_1.yaml: two_points_2",
        [[0, 0, 0], [0, 1e-4, 0]],
        [100] * 3,
        [100] * 3,
        1001,
        FAILS,
        0.002,
    ),
    "toppra 14": Input(
        "kind of hungpham2511/toppra issue 14: waypoints changed by less than 1e-8; 2 k + 1 grid points",
        steps(0.01, 1e-9, seed=0),
        [2] * 6,
        [5] * 6,
        21,
        FAILS,
    ),
    "toppra 14, other noise": Input(
        "kind of hungpham2511/toppra issue 14: toppra as it comes solves this one",
        steps(0.01, 1e-9, seed=1),
        [2] * 6,
        [5] * 6,
        21,
        0.306312,
    ),
    "toppra 226": Input(
        "kind of hungpham2511/toppra issue 226 (numerical failure of a feasible path): problem suite, small_joint_2",
        [[0, 0, 0], [0, 1e-5, 0], [0, 0, 0]],
        [100, 10000, 100],
        [100, 10000, 100],
        101,
        FAILS,
    ),
    "toppra 226, no failure but five times too long": Input(
        "kind of hungpham2511/toppra issue 226: problem suite, small_joint_3",
        [[0, 0, 0], [0, 1e-7, 0], [0, 0, 0]],
        [100, 1000, 100],
        [100, 1000, 100],
        101,
        2.0e-4,
    ),
    "toppra 26": Input(
        "hungpham2511/toppra issue 26, problem suite",
        rising(-3.85929168e-04, 1.16383433e-03),
        [1000] * 3,
        [1000, 2000, 10000],
        101,
        FAILS,
        2 * np.sqrt((1.16383433e-03 + 3.85929168e-04) / 1000),
    ),
    "toppra 21": Input(
        "hungpham2511/toppra pull request 21: there and back by 1e-8",
        [[0], [1e-8], [0]],
        [10],
        [4],
        101,
        FAILS,
    ),
    "drake 20619": Input(
        "kind of RobotLocomotion/drake issue 20619: cubic with continuous second derivatives, 5000 grid points",
        np.random.default_rng(20619).normal(size=(10, 7)).tolist(),
        [1] * 7,
        [3] * 7,
        5000,
        28.02968,
        dt=1e-3,
    ),
}


def spline_of(given: Input) -> CubicSpline:
    s = np.linspace(0, 1, len(given.waypoints))
    return CubicSpline(s, given.waypoints, bc_type="natural" if len(s) == 2 else "not-a-knot")


@pytest.mark.parametrize("name", INPUTS)
def test_both_solvers_time_a_public_input(name):
    given, path = INPUTS[name], spline_of(INPUTS[name])
    limits = np.array(given.speed, float), np.array(given.acceleration, float)
    grid = {"knots": given.points, "finest": given.points}
    ours, theirs = (time_path(path, *limits, dt=given.dt, solver=solver, **grid) for solver in ("passes", "toppra"))
    assert ours.optimal == pytest.approx(theirs.optimal, rel=1e-5)
    assert ours.knots == theirs.knots == given.points
    if given.duration is not None:
        assert ours.optimal == pytest.approx(given.duration, rel=1e-4)
    for found in (ours, theirs):
        v = path(found.s, 1) * found.sd[:, None]
        a = path(found.s, 1) * found.sdd[:, None] + path(found.s, 2) * found.sd[:, None] ** 2
        assert np.max(np.abs(v) / limits[0]) <= 1.001
        assert np.max(np.abs(a) / limits[1]) <= 1.001


@pytest.mark.parametrize("name", INPUTS)
def test_toppra_as_it_comes_fails_where_the_reports_say(name):
    """If this fails, toppra has changed: the row then no longer shows why problems are made dimensionless."""
    given, path = INPUTS[name], spline_of(INPUTS[name])
    grid, speed, acceleration = np.linspace(0, 1, given.points), np.array(given.speed), np.array(given.acceleration)
    problem = grid, path(grid, 1).T / acceleration[:, None], path(grid, 2).T / acceleration[:, None]
    if given.plain == FAILS:
        with pytest.raises(TimingError, match="not controllable"):
            toppra_solver.fastest(*problem, speed / acceleration)
        return
    rates = toppra_solver.fastest(*problem, speed / acceleration)
    assert np.sum(2 * np.diff(grid) / (rates[1:] + rates[:-1])) == pytest.approx(given.plain, rel=1e-3)


def test_a_wrong_duration_without_a_failure_is_five_times_the_right_one():
    given = INPUTS["toppra 226, no failure but five times too long"]
    limits = np.array(given.speed, float), np.array(given.acceleration, float)
    right = time_path(spline_of(given), *limits, dt=given.dt, knots=given.points, finest=given.points).optimal
    assert given.plain / right == pytest.approx(4.96, abs=0.01)
