"""Continuation to targets: it stays in one assembly mode, and stops with the best state where it cannot go on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made import mechanisms as made
from made.lanes import nightly
from made.loops import rod
from twin.core import spatial
from twin.core.errors import AssemblyError
from twin.core.units import DEG
from twin.reference import ReferenceModel
from twin.reference.target_continuation import GAP_TOLERANCE


@pytest.fixture(scope="module")
def four_bar():
    return ReferenceModel(made.four_bar())


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [70, 81, 100, 170 + 81])
def test_a_crank_that_cannot_turn_fully_is_driven_around_what_it_cannot_pass(monkeypatch, degrees):
    """Beyond 138 degrees the crank is blocked; from -100 degrees, the shorter way to 100 would lead through that."""
    for name, length in (("GROUND", 0.1), ("CRANK", 0.06), ("COUPLER", 0.08), ("ROCKER", 0.07)):
        monkeypatch.setattr(made, name, length)
    monkeypatch.setattr(made, "CRANK_AT_REST", -100 * DEG)
    model, q = ReferenceModel(made.four_bar()), np.array([degrees * DEG])
    if degrees > 180:  # only as -109 degrees
        q -= 2 * np.pi
    poses, _ = made.four_bar_state(q[0])
    for x in (model.solve(q).x, model.solve_many(q[None]).x[0], model.run(q[None]).x[0]):
        np.testing.assert_allclose(model.link_poses(x[None])["rocker"][0], poses["rocker"], atol=1e-10)
    away = q + 2 * np.pi
    for x in (model.solve(away).x, model.solve_many(away[None]).x[0], model.run(away[None]).x[0]):
        np.testing.assert_allclose(model.link_poses(x[None])["rocker"][0], poses["rocker"], atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("turns", [1, 2])
@pytest.mark.parametrize("count", nightly([2, 10, 14, 27, 47], every=3))
def test_a_few_wide_samples_stay_on_the_branch_too(four_bar, count, turns):
    """Where samples are half a radian and more apart, an interpolation between knots would lead elsewhere."""
    cranks = made.CRANK_AT_REST + np.linspace(0, 2 * np.pi * turns, count)
    run = four_bar.run(cranks[:, None])
    for k, crank in enumerate(cranks):
        T_tool = made.four_bar_state(crank)[0]["coupler"] @ four_bar.mechanism.frame("tool").T_body_frame
        assert np.abs(run.Ts_base_tool[k] - T_tool).max() < 1e-12


def test_unrelated_states_are_solved_at_once(four_bar, rng):
    q = rng.uniform(-2, 2, (40, 1))
    run = four_bar.solve_many(q)
    assert np.array_equal(run.q, q)
    assert run.gaps.max() < 1e-13
    for i in (0, 17, 39):
        assert np.abs(run.Ts_base_tool[i] - four_bar.solve(q[i]).T_base_tool).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("active", "target", "other"), [("lift", 0.55, 0.5), ("push", 0.6, 0.5)])
def test_what_cannot_close_raises_with_the_best_state_and_its_gap(active, target, other):
    model = ReferenceModel(rod(active))
    with pytest.raises(
        AssemblyError, match=r"m: the mechanism cannot be assembled at the target: .* % of the way"
    ) as caught:
        model.solve(np.array([target]))
    best = caught.value.best
    assert caught.value.gap == best.worst_gap
    assert 0 <= best.worst_gap < target - other + 1e-6
    assert best.q[0] == pytest.approx(other, abs=0.02)  # as far as the rod reaches


@pytest.mark.slow
def test_a_rocker_is_not_driven_through_its_toggle():
    """Crank and coupler in line end the rocker's range; beyond, no state exists."""
    good = made.four_bar()
    joints = [j for j in good.joints if j.name in ("rocker_joint", "crank_joint", "elbow", "closing")]
    joints = [replace(j, active=j.name == "rocker_joint", limits=None) for j in joints]
    model = ReferenceModel(replace(good, joints=tuple(joints), postures={}))
    start = model.home()
    a, b, c, d = made.CRANK, made.COUPLER, made.ROCKER, made.GROUND
    lowest = np.pi - np.arccos((c * c + d * d - (b - a) ** 2) / (2 * c * d))
    highest = np.pi - np.arccos((c * c + d * d - (b + a) ** 2) / (2 * c * d))
    low, high = sorted([lowest, highest])
    assert low < start.q[0] < high
    for inside in (low + 1e-3, high - 1e-3):
        assert model.solve(np.array([inside])).worst_gap < 1e-12
    for beyond in (low - 0.05, high + 0.05):
        with pytest.raises(AssemblyError) as caught:
            model.solve(np.array([beyond]))
        assert low - 0.06 < caught.value.best.q[0] < high + 0.06


def test_a_pose_that_only_another_branch_has_is_not_jumped_to(four_bar):
    crank = made.CRANK_AT_REST
    pin_at = made.CRANK * np.array([np.cos(crank), np.sin(crank)])
    across = np.array([made.GROUND, 0.0]) - pin_at
    coupler, _ = made.four_bar_angles(crank)
    flipped = 2 * np.arctan2(across[1], across[0]) - coupler  # mirrored at the line from crank pin to rocker pivot
    T = made.T_TILT @ spatial.pose(spatial.rotation_z(flipped), [*pin_at, 0])
    with pytest.raises(AssemblyError) as caught:
        four_bar.solve_pose(T @ four_bar.mechanism.frame("tool").T_body_frame)
    poses, _ = made.four_bar_state(caught.value.best.q[0])
    assert caught.value.best.q.shape == (1,)
    assert set(caught.value.best.link_poses) == set(poses)


def test_a_run_that_leaves_the_reach_between_two_knots_raises():
    model = ReferenceModel(rod())
    lifts = np.full(200, 0.45)
    lifts[100:103] = [0.49, 0.51, 0.49]  # one sample 10 mm beyond the rod's length, knots at 96 and 128
    with pytest.raises(AssemblyError, match="at sample 101") as caught:
        model.run(lifts[:, None])
    assert caught.value.gap == pytest.approx(caught.value.best.worst_gap)
    assert caught.value.gap > GAP_TOLERANCE


def test_a_run_that_ends_out_of_reach_raises():
    with pytest.raises(AssemblyError, match=r"at sample 67: m: the mechanism cannot be assembled"):
        ReferenceModel(rod()).run(np.linspace(0.3, 0.6, 100)[:, None])  # sample 66 lifts by 0.5 exactly
