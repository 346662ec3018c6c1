"""Series, paths and timing, without a robot."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.core import spatial
from twin.core.errors import ProtocolError, TimingError
from twin.planning import toppra_solver
from twin.planning.path import fit, line
from twin.planning.phase_path import build
from twin.planning.protocol import (
    Insertion,
    Limits,
    Pivot,
    Positioning,
    Protocol,
    Retraction,
    TrajectoryTolerances,
    Waypoint,
)
from twin.planning.protocol.course import rotation
from twin.planning.timing import time_path

SPEED, ACCELERATION = np.full(6, 0.1), np.full(6, 0.5)
RATE_TOLERANCE = 1e-8
OVERSHOOT = 1e-4  # what is left between the points that are judged; 1e-3 is promised


def wave(amplitude, direction, bend):
    """A curved path of six coordinates, and its derivatives."""

    def derivatives(s):
        s = s[:, None]
        return amplitude * (direction + 3 * bend * np.cos(3 * s)), -9 * amplitude * bend * np.sin(3 * s)

    return derivatives


def path_of(derivatives):
    """Return a path by its derivatives, which are all that a timing asks."""
    return lambda s, order: derivatives(s)[order - 1]


def peak(derivatives, timing):
    first, second = derivatives(timing.s)
    v = first * timing.sd[:, None]
    a = first * timing.sdd[:, None] + second * timing.sd[:, None] ** 2
    return np.max(np.abs(v) / SPEED), np.max(np.abs(a) / ACCELERATION)


def test_a_straight_move_takes_the_time_of_a_trapezoid():
    timing = time_path(line(np.zeros(1), np.full(1, 0.2)), SPEED[:1], ACCELERATION[:1])
    assert timing.optimal == pytest.approx(0.2 / 0.1 + 0.1 / 0.5, rel=1e-4)
    assert timing.duration == pytest.approx(np.ceil(timing.optimal * 1e3) * 1e-3)
    assert (timing.s[0], timing.s[-1], timing.sd[0], timing.sd[-1]) == (0, 1, 0, 0)


def test_micrometre_moves_never_fail_and_keep_their_limits():
    rng = np.random.default_rng(0)
    for _ in range(200):
        amplitude = 10 ** rng.uniform(-6, -4)  # 1 um to 100 um
        direction = rng.normal(size=6)
        path = wave(amplitude, direction / np.linalg.norm(direction), 0.2 * rng.normal(size=6))
        timing = time_path(path_of(path), SPEED, ACCELERATION, knots=101)
        assert max(peak(path, timing)) <= 1 + OVERSHOOT
        assert 0 < timing.duration < 0.2
        assert timing.duration <= max(timing.optimal * (1 + timing.overshoot + 1e-3) + 1e-3, 2e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-9, 1))
def test_limits_hold_and_one_of_them_is_used_at_any_scale(seed, exponent):
    rng = np.random.default_rng(seed)
    path = wave(10**exponent, rng.normal(size=6), 0.5 * rng.normal(size=6))
    timing = time_path(path_of(path), SPEED, ACCELERATION, dt=1e-3 * 10 ** (exponent / 2), knots=121)
    speed, acceleration = peak(path, timing)
    # Looked at more densely than the planner does, which takes out all but OVERSHOOT where it looks.
    assert 0.95 < max(speed, acceleration) <= 1 + 2 * OVERSHOOT
    assert np.all(np.diff(timing.s) >= 0)
    assert timing.overshoot < 0.05


def test_the_timing_agrees_with_toppra_s_own_constant_acceleration_trajectory():
    algorithm, constraint = toppra_solver.package()  # whose own warnings are not ours to mend
    from toppra import SplineInterpolator

    rng = np.random.default_rng(3)
    direction, bend = rng.normal(size=6), 0.4 * rng.normal(size=6)
    s = np.linspace(0, 1, 401)
    instance = algorithm.TOPPRA(
        [constraint.JointVelocityConstraint(SPEED), constraint.JointAccelerationConstraint(ACCELERATION)],
        SplineInterpolator(s, direction * s[:, None] + bend * np.sin(3 * s[:, None])),
        gridpoints=s,
        solver_wrapper="seidel",
        parametrizer="ParametrizeConstAccel",
    )
    theirs = instance.compute_trajectory().duration
    ours = time_path(path_of(wave(1.0, direction, bend)), SPEED, ACCELERATION, knots=401).optimal
    assert ours == pytest.approx(theirs, rel=1e-4)


@pytest.mark.parametrize(
    ("derivatives", "limits", "words"),
    [
        (lambda s: (np.zeros((len(s), 6)), np.zeros((len(s), 6))), SPEED, "no length"),
        (lambda s: (np.full((len(s), 6), np.nan), np.zeros((len(s), 6))), SPEED, "no finite derivatives"),
        (wave(1.0, np.ones(6), np.zeros(6)), 0 * SPEED, "must be positive"),
    ],
)
def test_what_cannot_be_timed_raises(derivatives, limits, words):
    with pytest.raises(TimingError, match=words):
        time_path(path_of(derivatives), limits, ACCELERATION)


def test_a_series_holds_a_function_and_its_derivatives_to_rounding():
    series = fit(lambda s: np.column_stack([np.sqrt(1.3 - s), np.sin(9 * s), 0.5 + 1e-6 * s]))
    s = np.linspace(0, 1, 57)
    expected = np.column_stack([-0.25 * (1.3 - s) ** -1.5, -81 * np.sin(9 * s), 0 * s])
    np.testing.assert_allclose(series(s, 2), expected, atol=2e-7)
    np.testing.assert_allclose(series(s, 1)[:, 1], 9 * np.cos(9 * s), atol=1e-10)


def test_a_series_of_a_noisy_function_stops_at_the_noise():
    rng = np.random.default_rng(0)
    series = fit(lambda s: np.sin(3 * s)[:, None] + 1e-10 * rng.normal(size=(len(s), 1)))
    s = np.linspace(0, 1, 33)
    np.testing.assert_allclose(series(s, 2)[:, 0], -9 * np.sin(3 * s), atol=1e-5)
    assert len(series.coefficients) < 30


def test_a_jump_leaves_a_tail():
    assert np.max(fit(lambda s: (s > 0.4).astype(float)[:, None]).tail) > 1e-4


def protocol(*phases, waypoints=None, axis=(0, 0, -1)):
    poses = {"a": ((0.1, 0.2, 0.3), (0.2, -0.1, 0.4)), "b": ((0.2, 0.1, 0.1), (-0.3, 0.2, 0.1))}
    points = {n: Waypoint(n, np.array(r), np.array(p), None, n, "ASSUMED", "test") for n, (p, r) in poses.items()}
    points["about"] = Waypoint("about", np.array([0.1, 0.5, -0.3]), None, 0.07, "about", "ASSUMED", "test")
    limits = Limits(0.02, 0.1, 0.3, 1.0, "ASSUMED", "test")
    kinds = ("positioning", "insertion", "pivot", "retraction", "home")
    tolerances = TrajectoryTolerances(1e-4, 1e-3, 1e-4, 1e-4, 1e-3, "ASSUMED", "test")
    return Protocol(
        "p", "p", "test", "none", "tip", np.array(axis, float), "a", points | (waypoints or {}), phases,
        dict.fromkeys(kinds, limits), tolerances,
    )  # fmt: skip


T_TOOL_TIP = spatial.pose(rotation(np.array([0.3, 0.2, -0.4]), "zyx"), np.array([0.01, -0.02, -0.3]))
INSIDE = (Insertion("in", 0.05), Pivot("turn", "about", "enforced"), Retraction("out"))


def test_the_rotation_is_the_product_of_three_written_out():
    a, b, c = 0.3, -0.7, 1.1
    z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    x = np.array([[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]])
    np.testing.assert_allclose(rotation(np.array([a, b, c]), "zyx"), z @ y @ x, atol=1e-15)
    np.testing.assert_allclose(rotation(np.array([c, b, a]), "xyz"), x @ y @ z, atol=1e-15)


@pytest.mark.parametrize("order", ["zyx", "xyz"])
def test_derivatives_of_every_phase_agree_with_differences(order):
    h, s = 1e-6, np.linspace(0.1, 0.9, 9)
    for path in build(replace(protocol(Positioning("go", "b"), *INSIDE), rotation=order), T_TOOL_TIP):
        m, ahead, behind = path.motion(s), path.motion(s + h), path.motion(s - h)
        np.testing.assert_allclose(m.p1, (ahead.p - behind.p) / (2 * h), atol=RATE_TOLERANCE)
        np.testing.assert_allclose(m.p2, (ahead.p1 - behind.p1) / (2 * h), atol=RATE_TOLERANCE)
        np.testing.assert_allclose(m.w2, (ahead.w1 - behind.w1) / (2 * h), atol=RATE_TOLERANCE)
        R = ahead.Ts_base_tool[:, :3, :3] @ np.swapaxes(behind.Ts_base_tool[:, :3, :3], 1, 2)
        np.testing.assert_allclose(m.w1, spatial.log_so3(R) / (2 * h), atol=RATE_TOLERANCE)
        tool = (ahead.Ts_base_tool[:, :3, 3] - behind.Ts_base_tool[:, :3, 3]) / (2 * h)
        np.testing.assert_allclose(m.twists, np.column_stack([tool, m.w1]), atol=RATE_TOLERANCE)
        np.testing.assert_allclose((m.Ts_base_tool @ T_TOOL_TIP)[:, :3, 3], m.p, atol=1e-15)


def test_phases_join_and_keep_the_rcm_on_the_shaft():
    paths = build(protocol(Positioning("go", "b"), *INSIDE), T_TOOL_TIP)
    for before, after in itertools.pairwise(paths):
        ends = before.motion(np.ones(1)).Ts_base_tool - after.motion(np.zeros(1)).Ts_base_tool
        np.testing.assert_allclose(ends, 0, atol=1e-14)
    for path in paths[1:]:
        T = path.motion(np.linspace(0, 1, 101)).Ts_base_tool @ T_TOOL_TIP
        off = spatial.point_to_line(path.rcm, T[:, :3, 3], T[:, :3, :3] @ [0, 0, -1])
        assert np.max(off) < 1e-14
    np.testing.assert_allclose(paths[-1].tip1, paths[-1].rcm, atol=1e-15)
    assert [p.depth1 for p in paths[1:]] == pytest.approx([0.05, 0.07, 0.0])


@pytest.mark.parametrize(
    ("phases", "words"),
    [
        ((Positioning("go", "a"),), r"phase 'go' \(positioning\): the phase has no length"),
        ((Insertion("in", 0.05), Retraction("out", 0.05)), "phase 'out' .retraction.: the phase has no length"),
        (
            (Insertion("in", 0.05), Retraction("out", 0.06)),
            "should end at depth 60.000 mm, but begins at 50.000",
        ),
        ((Pivot("turn", "about", "enforced"),), "no RCM is registered yet; add an insertion before this pivot"),
        ((Insertion("in", 0.05), Pivot("m", "b", "monitored"), INSIDE[1]), "after a monitored pivot the shaft .* mm"),
    ],
)
def test_paths_that_make_no_sense_are_refused(phases, words):
    with pytest.raises(ProtocolError, match=words):
        build(protocol(*phases), T_TOOL_TIP)


@pytest.mark.parametrize("limits", [(1.0, np.inf), (np.inf, 2.0)])
def test_a_limit_that_is_not_there_does_not_bind_and_the_other_does(limits):
    """Also for a coordinate that stands still: zero length times no limit is not a number."""

    def straight(s):
        first = np.column_stack([np.ones_like(s), np.zeros_like(s), np.ones_like(s)])
        return first, np.zeros_like(first)

    speed, acceleration = limits
    timing = time_path(path_of(straight), np.array([speed, np.inf, 50.0]), np.array([acceleration, np.inf, 80.0]))
    assert np.max(timing.sd) <= min(speed, 50.0) * (1 + 1e-6)
    assert np.max(np.abs(timing.sdd)) <= min(acceleration, 80.0) * (1 + 1e-3)
    wanted = 1.0 + 1.0 / 80 if speed == 1 else 2 * np.sqrt(0.5)
    assert timing.duration == pytest.approx(wanted, rel=2e-2)
