"""Loops closed for many states at once, against Pinocchio and the single solver of the reference model."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import twin
from made.mechanisms import four_bar
from twin.core.errors import AssemblyError
from twin.core.units import MM
from twin.model.combined_arms import joined
from twin.planning.path import line
from twin.reference import ReferenceModel
from twin.reference.assembly import settle
from twin.reference.collision_pairs import CollisionPairs
from twin.reference.loop_closing import Closing


@cache
def model(name):
    return ReferenceModel(four_bar() if name == "four_bar" else twin.load(name).mechanism)


def closing_of(name):
    return Closing(model(name), np.ones(len(model(name).mechanism.active)))


def near_home(name, count, part=0.05):
    m, rng = model(name), np.random.default_rng(0)
    low, high = m.mechanism.limits.T
    reach = np.where(np.isfinite(high - low), high - low, 1.0)
    return np.clip(m.home().q + rng.uniform(-part, part, (count, len(low))) * reach, low, high)


@pytest.mark.parametrize("name", ["sils", "four_bar"])
def test_many_states_equal_the_single_solutions(name):
    m, q = model(name), near_home(name, 12)
    X, ok = closing_of(name).states(q)
    assert ok.any()
    for x, closed, values in zip(X, ok, q, strict=True):
        try:
            single = m.solve(values)
        except AssemblyError:
            assert not closed
            continue
        assert closed
        np.testing.assert_allclose(x, single.x, atol=1e-9)


def test_a_joint_value_that_is_not_finite_settles_nowhere():
    first = next(iter(model("four_bar").tree.configuration))
    assert settle(model("four_bar"), {first: np.nan}) is None


def test_a_tree_with_ball_joints_is_placed_and_moved_as_by_pinocchio():
    tree, rng = model("sils").tree, np.random.default_rng(1)
    assert tree.quaternions, "the mechanism must have a ball joint"
    X = np.tile(model("sils").home().x, (20, 1))
    steps = rng.normal(scale=0.4, size=(20, tree.model.nv))
    steps[0] = 0.0
    moved = tree.step(X, steps)
    np.testing.assert_allclose(moved, tree.integrate(X, steps), atol=1e-14)
    poses, J = tree.update(moved)
    np.testing.assert_allclose(tree.place(moved), poses, atol=1e-14)
    np.testing.assert_allclose(tree.columns(tree.place(moved)), J, atol=1e-14)


def test_rates_are_those_of_neighbouring_states():
    closing, q, h = closing_of("sils"), near_home("sils", 3, 0.02), 1e-6
    X, _ = closing.states(q)
    for j in range(q.shape[1]):
        step = h * (np.arange(q.shape[1]) == j)
        ahead, behind = (closing.near(X, q + sign * step)[0] for sign in (1, -1))
        single = [n for n in range(X.shape[1]) if not any(p <= n < p + 4 for p in model("sils").tree.quaternions)]
        slopes = ((ahead - behind) / (2 * h))[:, single]
        columns = [n - 1 if n > model("sils").tree.quaternions[0] else n for n in single]
        np.testing.assert_allclose(closing.rates(X)[:, columns, j], slopes, atol=1e-6)


def test_a_path_is_followed_and_a_path_out_of_reach_is_not():
    closing, q = closing_of("sils"), near_home("sils", 40)
    X, ok = closing.states(q)
    a, b = q[ok][:2]
    s = np.linspace(0.0, 1.0, 20)

    def path(s):
        return a + s[:, None] * (b - a)

    found = closing.along(path, X[ok][0], s, lambda: None)
    assert found is not None
    np.testing.assert_allclose(found[-1], X[ok][1], atol=1e-9)
    run = model("sils").run(path(s), model("sils").state(X[ok][0]))
    np.testing.assert_allclose(found, run.x, atol=1e-9)
    far = b.copy()
    far[0] = model("sils").mechanism.limits[0, 0]
    far[1] = model("sils").mechanism.limits[1, 1]
    assert closing.along(lambda s: a + s[:, None] * (far - a), X[ok][0], s, lambda: None) is None


def test_states_of_connections_follow_the_paths():
    closing, q = closing_of("sils"), near_home("sils", 30)
    q = q[closing.states(q)[1]]
    X, ok = closing.straight_paths(q[:-1], q[1:], 9)
    assert ok.any()
    for k in np.flatnonzero(ok)[:5]:
        start, s = closing.states(q[k][None])[0][0], np.linspace(0.0, 1.0, 9)
        exact = closing.along(lambda s, k=k: q[k] + s[:, None] * (q[k + 1] - q[k]), start, s, lambda: None)
        np.testing.assert_allclose(X[k], exact, atol=1e-5)


def test_a_certain_state_is_kept_for_ever_and_found_again_at_rounded_values(monkeypatch):
    """Otherwise the end of a path is compared with nothing, so that any assembly mode is accepted there."""
    monkeypatch.setattr("twin.reference.loop_closing._MOST_STORED_STATES", 50)
    closing, rng = closing_of("four_bar"), np.random.default_rng(0)
    home = model("four_bar").home().q
    sure, _ = closing.states(home[None] + 0.1)
    for _ in range(8):
        closing.states(home + rng.uniform(-0.5, 0.5, (20, 1)), thorough=False)
    np.testing.assert_array_equal(closing.stored(home + 0.1), sure[0])
    assert len(closing._q) <= 50 + 20 + 2
    goals = home + rng.uniform(-0.5, 0.5, (40, 1))
    closing.states(goals)
    ends = np.array([line(home, goal)(np.ones(1))[0] for goal in goals])
    assert (ends != goals).any(), "rounding must matter"
    assert all(closing.stored(end) is not None for end in ends)
    assert closing.stored(goals[0] + 1e-6) is None


def test_two_loops_that_change_their_modes_together_are_noticed():
    """The product of both determinants keeps its sign; each of them changes it."""
    single, two = closing_of("four_bar"), joined({n: (four_bar(), np.eye(4)) for n in ("left", "right")})
    home, rng = model("four_bar").home(), np.random.default_rng(0)
    guesses = np.tile(home.x, (40, 1)) + rng.uniform(-3, 3, (40, len(home.x)))
    X, ok = single.near(guesses, np.tile(home.q, (40, 1)))
    other = X[ok & (single.signs(X) != single.signs(home.x[None])).all(axis=1)][0]
    closing = Closing(ReferenceModel(two), np.ones(2))
    modes = [np.concatenate(pair) for pair in ((home.x, home.x), (other, other), (other, home.x))]
    signs = closing.signs(np.array(modes))
    assert signs.shape == (3, 2)
    assert (signs[0] != signs[1]).all()
    assert (signs[0] != signs[2]).sum() == 1


@pytest.mark.slow
def test_levers_bound_the_approach_of_bodies_beyond_a_ball_joint():
    m, rng = model("sils"), np.random.default_rng(2)
    pairs, x = CollisionPairs(m, (), 5 * MM), m.home().x
    assert pairs.local_bounds is not None
    rows = [k for k, pair in enumerate(pairs.rows) if "platform" in {pairs.shapes[i].name for i in pair}]
    assert len(rows) > 3
    for _ in range(3):
        step = rng.uniform(0, 0.05, m.tree.model.nv)
        _, bound = pairs.around(x[None], step[None])
        ways = rng.choice([-1, 1], (4, len(step))) * step
        poses = pairs.poses(np.concatenate([x[None], m.tree.step(np.tile(x, (4, 1)), ways)]))
        for row in rows:
            distances = np.array([pairs.distance(row, T) for T in poses])
            assert np.abs(distances[1:] - distances[0]).max() <= bound[0, row] + 1e-9
