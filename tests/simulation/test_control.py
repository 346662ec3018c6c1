"""Control: what any controller must keep, for both solvers and both clutches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.core.errors import KinematicsError
from twin.core.units import DEG, MM
from twin.kinematics import compile_formula
from twin.robots import load_formula
from twin.simulation.controllers.clutch_test import clutch_report, play
from twin.simulation.controllers.jacobian_step import pose_error, step
from twin.simulation.controllers.teleoperation import Gains, Teleoperation
from twin.simulation.limits import JointLimits

SCALE = np.array([MM, MM, MM, DEG, MM])
HOME = np.array([50, 50, 50, 0, 20.25077]) * SCALE
LIMITS = JointLimits(
    np.array([0, 0, 0, -60, 0]) * SCALE,
    np.array([100, 100, 100, 60, 50]) * SCALE,
    np.array([10, 10, 10, 15, 10]) * SCALE,
)
DT = 1e-3
SOLVERS = ("slsqp", "damped")


@pytest.fixture(scope="module")
def kin():
    return compile_formula(load_formula("sher"))


def follow(kin, q, T, solver, ticks=4000):
    """Track a standing target; return all joints."""
    out = [q]
    for _ in range(ticks):
        out.append(step(kin, out[-1], T, DT, LIMITS, solver).q)
        if np.linalg.norm(pose_error(kin.forward(out[-1]), T)) < 1e-12:
            break
    return np.array(out)


# -- velocity ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_reachable_pose_is_reached_within_all_limits(kin, solver):
    goal = np.array([52, 49, 51, 4, 23]) * SCALE
    qs = follow(kin, HOME, kin.forward(goal), solver)
    assert np.abs(qs[-1] - goal).max() < 1e-9
    rates = np.abs(np.diff(qs, axis=0)) / DT
    assert (rates <= LIMITS.max_speed * (1 + 1e-9)).all()


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_standing_target_moves_nothing(kin, solver):
    one = step(kin, HOME, kin.forward(HOME), DT, LIMITS, solver)
    assert np.abs(one.dq).max() < 1e-15
    assert one.residual < 1e-15
    assert not one.saturated.any()


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("microns", [1, 10, 100])
def test_micrometre_steps_are_made(kin, solver, microns):
    """The paper's solver, unscaled, would stop at once: a micrometre squared is below its tolerance."""
    T = kin.forward(HOME)
    T[:3, 3] += microns * 1e-6 * np.array([0.6, -0.64, 0.48])
    q = follow(kin, HOME, T, solver, ticks=60)[-1]
    assert np.linalg.norm(pose_error(kin.forward(q), T)) < 1e-9


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=11, max_size=11), st.sampled_from(SOLVERS))
def test_no_limit_is_ever_passed_and_the_solvers_agree(x, solver):
    kin = compile_formula(load_formula("sher"))
    q = np.clip(HOME + np.array(x[:5]) * [0.01, 0.01, 0.01, 0.9, 0.025], LIMITS.lower, LIMITS.upper)
    T = kin.forward(q)
    T[:3, 3] += 0.03 * np.array(x[5:8])  # far away, mostly: the rate limits are met
    one = step(kin, q, T, 0.02, LIMITS, solver)
    assert (np.abs(one.dq) <= LIMITS.max_speed * 0.02 * (1 + 1e-12)).all()
    assert (one.q >= LIMITS.lower - 1e-15).all()
    assert (one.q <= LIMITS.upper + 1e-15).all()
    other = step(kin, q, T, 0.02, LIMITS, "damped" if solver == "slsqp" else "slsqp")
    assert one.residual == pytest.approx(other.residual, rel=1e-3, abs=1e-7)


def test_a_joint_at_its_end_stays_there(kin):
    q = HOME.copy()
    q[4] = 0.05
    ahead = kin.forward(q + np.array([0, 0, 0, 0, 0.001]))
    for solver in SOLVERS:
        one = step(kin, q, ahead, DT, LIMITS, solver)
        assert one.dq[4] <= 0
        assert one.saturated[4] or one.dq[4] < 0


@pytest.mark.parametrize("bad", [{"q": HOME * np.nan}, {"T": np.full((4, 4), np.nan)}, {"dt": 0.0}])
def test_what_is_not_finite_is_refused(kin, bad):
    with pytest.raises(KinematicsError, match="must be finite"):
        step(kin, bad.get("q", HOME), bad.get("T", kin.forward(HOME)), bad.get("dt", DT), LIMITS)


# -- teleoperation -----------------------------------------------------------------------------------------


def make(clutch_="corrected", n=5, **gains):
    return lambda: Teleoperation(Gains(**gains), 1 / 200, clutch_, n)


def test_re_clutching_moves_nothing_when_the_offset_is_latched():
    for gains in ({}, {"ki": 1.0, "kd": 0.01}, {"scale": 1.0, "kp": 20.0}):
        report = clutch_report(make(**gains))
        assert report.keeps, report


def test_re_clutching_as_printed_jumps_by_the_scaled_way_of_the_hand():
    for scale in (0.1, 1.0):
        report = clutch_report(make("printed", scale=scale))
        assert not report.keeps
        assert report.jump == pytest.approx(scale * report.handle, rel=1e-3)


def test_as_printed_the_error_is_zero_for_one_tick_alone():
    controller = make("printed", n=1, scale=1.0, kp=1.0)()
    tool, handle = np.zeros(1), np.array([0.03])
    assert controller.step(handle, tool, False) == 0
    assert controller.step(handle, tool, True) == 0
    assert controller.step(handle, tool, True) == pytest.approx(0.03)


@pytest.mark.parametrize("variant", ["printed", "corrected"])
def test_a_still_hand_leaves_the_tool_still(variant):
    k = 400
    tool = play(make(variant)(), np.zeros((k, 5)), np.ones(k, bool), np.zeros(5))
    assert np.abs(tool).max() == 0


def test_the_tool_goes_the_scaled_way_of_the_hand():
    k = 2000
    handle = np.outer(np.minimum(np.linspace(0, 2, k), 1), np.array([10, -5, 3, 1, 0.5]) * [MM, MM, MM, DEG, DEG])
    tool = play(make(scale=0.1)(), handle, np.ones(k, bool), np.array([0.3, 0, 0.1, 0, 0.7]))
    np.testing.assert_allclose(tool[-1] - tool[0], 0.1 * handle[-1], rtol=1e-6, atol=1e-12)


def test_nothing_moves_while_the_pedal_is_up(rng):
    k = 300
    tool = play(make(ki=2.0)(), rng.normal(size=(k, 5)), np.zeros(k, bool), np.ones(5))
    assert np.abs(tool - 1).max() == 0


def test_rates_are_bounded_and_the_integral_does_not_wind_up():
    k, limit = 4000, 1e-3
    controller = make(n=1, scale=1.0, ki=2.0, limit=limit)()
    handle = np.zeros((k, 1))
    handle[200:] = 5 * MM  # far more than the rate can follow at once
    tool = play(controller, handle, np.ones(k, bool), np.zeros(1))
    assert np.abs(np.diff(tool, axis=0)).max() <= limit / 200 * (1 + 1e-9)
    assert tool.max() < 5 * MM * 1.25  # what was saved up while bounded would carry it much further
    assert tool[-1, 0] == pytest.approx(5 * MM, rel=0.01)


def test_many_clutches_carry_the_tool_on_without_a_step():
    """Ratchet: ten strokes of the hand to one side, the pedal up on every way back."""
    stroke = np.concatenate([np.linspace(0, 0.02, 400), np.full(800, 0.02), np.linspace(0.02, 0, 200)])
    pressed = np.concatenate([np.ones(1200, bool), np.zeros(200, bool)])
    handle, pedal = np.tile(stroke, 10)[:, None], np.tile(pressed, 10)
    tool = play(make(n=1)(), handle, pedal, np.zeros(1))
    assert tool[-1, 0] == pytest.approx(10 * 0.1 * 0.02, rel=1e-3)
    assert np.diff(tool[:, 0]).min() > -1e-12


def test_wrong_settings_are_named():
    with pytest.raises(KinematicsError, match="dt is 0"):
        Teleoperation(Gains(), 0.0)
    with pytest.raises(KinematicsError, match="no clutch 'latched'; give 'printed' or 'corrected'"):
        Teleoperation(Gains(), 0.005, "latched")  # type: ignore[arg-type]
