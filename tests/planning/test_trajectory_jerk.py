"""Limited jerk: the same path, later; every limit kept; as fast as can be where the fastest is known."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import twin
from twin.core.errors import TimingError
from twin.planning import timing
from twin.planning.plan import plan
from twin.planning.protocol import load_protocol
from twin.planning.sampling import sample
from twin.planning.timing import time_path
from twin.validation.sampled_timing import check_rates as audit

ROOT = Path(__file__).resolve().parents[2]
DT = 1e-3


def judge(derivatives, limit):
    def jerk(s, sd, sdd):
        first, second = derivatives(s)
        a = first * sdd[:, None] + second * sd[:, None] ** 2
        return float(np.max(np.abs(np.diff(a, axis=0)))) / (DT * limit)

    return jerk


def path_of(derivatives):
    """Return a path by its derivatives, which are all that a timing asks."""
    return lambda s, order: derivatives(s)[order - 1]


def line(length):
    return lambda s: (np.full((len(s), 1), length), np.zeros((len(s), 1)))


@pytest.mark.parametrize(("v", "a", "j"), [(0.1, 0.5, 10.0), (0.1, 0.5, 2.5), (0.02, 1.0, 100.0)])
def test_a_straight_line_takes_the_least_time_there_is_with_that_jerk(v, a, j):
    """The seven-phase profile: d / v + v / a + a / j, where v and a are both reached."""
    path = line(0.2)
    found = time_path(path_of(path), np.array([v]), np.array([a]), jerk=judge(path, j), knots=3841)
    assert found.duration == pytest.approx(0.2 / v + v / a + a / j, abs=3 * DT + 0.02 * a / j)
    assert judge(path, j)(found.s, found.sd, found.sdd) <= 1 + 1e-9


def test_the_average_is_that_of_the_motion_itself():
    """Against a sum over finer samples."""
    grid = np.linspace(0, 1, 51)
    rates = np.sqrt(np.minimum(np.minimum(3 * grid, 2 * (1 - grid)), 0.5 + 0.3 * np.sin(9 * grid)))
    rates[-1] = 0
    total = float(np.sum(2 * np.diff(grid) / (rates[1:] + rates[:-1])))
    steps, window, fine = 200, 30, 50
    dt = total / steps
    s = sample(grid, rates, steps * fine, dt / fine)[1]
    padded = np.concatenate([np.zeros(window * fine), s, np.ones(window * fine)])
    area = np.concatenate([[0], np.cumsum(0.5 * (padded[1:] + padded[:-1]))])
    wanted = (area[window * fine :] - area[: -window * fine])[::fine] / (window * fine)
    t, s, sd, sdd = sample(grid, rates, steps, dt, window)
    assert len(t) == steps + window + 1
    np.testing.assert_allclose(s, wanted, atol=1e-6)
    np.testing.assert_allclose(sd[1:-1], (s[2:] - s[:-2]) / (2 * dt), atol=2e-3)
    np.testing.assert_allclose(sdd[1:-1], (sd[2:] - sd[:-2]) / (2 * dt), atol=0.1)
    assert (s[0], s[-1], sd[0], sd[-1], sdd[0], sdd[-1]) == (0, 1, 0, 0, 0, 0)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.floats(-0.5, 1.5), st.floats(-5, 0))
@example(405, 3, 0.0, -4.9921875)  # 16 steps in all, and 0.4 % too fast: slower must mean a step more
def test_all_limits_are_kept_on_any_path_at_any_scale(seed, m, exponent, scale):
    rng = np.random.default_rng(seed)
    direction, bend = 10**scale * rng.normal(size=m), 10**scale * 0.3 * rng.normal(size=m)
    speed, acceleration = np.full(m, 0.1), np.full(m, 0.5)
    limit = 0.5 * 10**exponent / 0.1  # from 0.3 s to 3 ms for the largest acceleration

    def path(s):
        s = s[:, None]
        return direction + 3 * bend * np.cos(3 * s), -9 * bend * np.sin(3 * s)

    fast = time_path(path_of(path), speed, acceleration)
    found = time_path(path_of(path), speed, acceleration, jerk=judge(path, limit))
    first, second = path(found.s)
    sd, sdd = found.sd[:, None], found.sdd[:, None]
    a = first * sdd + second * sd**2
    assert np.max(np.abs(first * sd)) <= 0.1 * (1 + timing.ACCEPTED_EXCESS)
    assert np.max(np.abs(a)) <= 0.5 * (1 + timing.ACCEPTED_EXCESS)
    assert np.max(np.abs(np.diff(a, axis=0))) <= limit * DT * (1 + 1e-9)
    assert np.all(np.diff(found.s) >= 0)
    assert (found.s[0], found.s[-1], found.sd[0], found.sd[-1]) == (0, 1, 0, 0)
    assert found.duration >= fast.duration - 1e-9
    assert found.optimal == fast.optimal


def test_a_limit_that_is_kept_anyway_changes_nothing():
    path = line(0.2)
    free = time_path(path_of(path), np.array([0.1]), np.array([0.5]))
    found = time_path(path_of(path), np.array([0.1]), np.array([0.5]), jerk=judge(path, 1e6))
    np.testing.assert_array_equal(found.s, free.s)


def test_a_jerk_that_cannot_be_kept_is_said():
    with pytest.raises(TimingError, match="the jerk is at least 2 times its limit"):
        time_path(path_of(line(1e-4)), np.array([0.1]), np.array([0.5]), jerk=lambda *_: 2.0)


# -- protocols --------------------------------------------------------------------------------------------


def with_jerk(tmp_path, tip, turn):
    text = (ROOT / "trajectories/sils/table2_printed.toml").read_text(encoding="utf-8")
    more = f"tip_jerk_mm_s3 = {tip}\nrotation_jerk_deg_s3 = {turn}\n"
    file = tmp_path / "table2_printed.toml"
    file.write_text(re.sub(r"(\[limits\.\w+\]\n)", rf"\g<1>{more}", text), encoding="utf-8")
    return file


def test_a_protocol_with_jerks_is_timed_within_them_and_one_without_is_not(tmp_path):
    robot = twin.load("sils")
    file = with_jerk(tmp_path, 1000, 800)
    protocol = load_protocol(file)
    assert protocol.limits["pivot"].tip_jerk == pytest.approx(1.0)
    assert protocol.limits["pivot"].rotation_jerk == pytest.approx(np.deg2rad(800))
    assert {p.unit for p in protocol.parameters() if "jerk" in p.name} == {"mm/s3", "deg/s3"}
    free, limited = twin.plan(robot, "table2_printed"), twin.plan(robot, protocol)
    facts, found = audit(limited, robot.mechanism, protocol)
    assert not found
    assert "of 1000 (" in facts["tip jerk"]
    assert not [f for f in limited.findings if "jerk" in f.code]
    assert {f.code for f in audit(free, robot.mechanism, protocol)[1]} >= {"timing.tip_jerk", "timing.rotation_jerk"}
    assert 1.005 < limited.duration / free.duration < 1.03
    np.testing.assert_allclose(limited.q[-1], free.q[-1], atol=1e-12)


def test_planner_s_own_check_sees_a_jerk(tmp_path):
    from twin.planning.check import check

    robot = twin.load("sils")
    found = check(twin.plan(robot, "table2_printed"), load_protocol(with_jerk(tmp_path, 1000, 800)),
                  robot.path_kinematics())  # fmt: skip
    assert {f.code for f in found if "jerk" in f.code} == {"limit.tip_jerk", "limit.rotation_jerk"}


def test_without_jerks_none_is_reported():
    robot = twin.load("sils")
    protocol = robot.protocol("table2_printed")
    facts, _ = audit(twin.plan(robot, protocol), robot.mechanism, protocol)
    assert "tip jerk" not in facts
    assert protocol.limits["pivot"].tip_jerk == np.inf
    assert not [p for p in protocol.parameters() if "jerk" in p.name]


def test_a_jerk_in_another_unit_is_a_warning(tmp_path):
    found = load_protocol(with_jerk(tmp_path, 0.9, 800)).findings
    assert [f for f in found if "0.9 mm/s3" in f.message and "probably in a wrong unit" in f.message]


@pytest.mark.slow
def test_jerks_of_joints_limit_a_motion_and_are_judged_twice():
    from twin.planning.check import check

    robot, limit = twin.load("sils"), 1.5
    protocol = robot.protocol("table2_printed")
    T = robot.mechanism.frame_in_tool(protocol.frame)
    kinematics = robot.path_kinematics()
    limited = replace(kinematics, max_jerk=np.full(6, limit))
    free, slow = (plan(protocol, k, T_tool_frame=T) for k in (kinematics, limited))
    jerks = [np.abs(np.diff(t.qdd, axis=0)).max() / t.step for t in (free, slow)]
    assert jerks[0] > 10 * limit
    assert jerks[1] <= limit * (1 + 1e-9)
    assert 1.001 < slow.duration / free.duration < 1.2
    joints = tuple(replace(j, max_jerk=limit) if j.active else j for j in robot.mechanism.joints)
    mechanism = replace(robot.mechanism, joints=joints)
    assert not audit(slow, mechanism, protocol)[1]
    assert "timing.jerk" in {f.code for f in audit(free, mechanism, protocol)[1]}
    assert "limit.jerk" in {f.code for f in check(free, protocol, limited)}
    assert "limit.jerk" not in {f.code for f in check(slow, protocol, limited)}
