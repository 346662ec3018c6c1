"""The search as the Raven paper prints it: each of its four errors by itself, and the corrected one against `fmt`."""

from __future__ import annotations

import numpy as np
import pytest

from made.printed import SLIPS, algorithm1
from twin.core.errors import ProtocolError
from twin.planning.costs import length, length_and_stops, stops, total
from twin.planning.fmt import FmtSearch, neighbours

START, GOAL = np.array([0.1, 0.5]), np.array([0.9, 0.5])
RADIUS = 0.2


class Wall:
    """A square with a wall at x = 0.5 that is open above y = 0.8."""

    limits, weights = np.array([[0.0, 1.0], [0.0, 1.0]]), np.ones(2)

    def free(self, q, *, exact=True):
        return np.ones(len(q), bool)

    def free_each(self, a, b):
        step = np.where(b[:, 0] == a[:, 0], 1.0, b[:, 0] - a[:, 0])
        y = a[:, 1] + (0.5 - a[:, 0]) / step * (b[:, 1] - a[:, 1])
        return ((a[:, 0] < 0.5) == (b[:, 0] < 0.5)) | (y > 0.8)


def samples(count=300, seed=0):
    return np.vstack([START, GOAL, np.random.default_rng(seed).uniform(0, 1, (count, 2))])


def run(*slips, seed=0):
    q = samples(seed=seed)
    return q, algorithm1(q, neighbours(q, RADIUS), length(np.ones(2)), Wall().free_each, slips)


def best_by_dijkstra(q, cost):
    """Return the smallest cost from start to goal over all free connections within the radius."""
    near, costs, done = neighbours(q, RADIUS), np.full(len(q), np.inf), np.zeros(len(q), bool)
    costs[0] = 0.0
    while not done.all():
        i = int(np.argmin(np.where(done, np.inf, costs)))
        done[i] = True
        a, b = np.broadcast_to(q[i], q[near[i]].shape), q[near[i]]
        through = np.where(Wall().free_each(a, b), costs[i] + cost(a, b), np.inf)
        costs[near[i]] = np.minimum(costs[near[i]], through)
    return costs[1]


@pytest.mark.parametrize("seed", range(3))
def test_the_corrected_algorithm_is_nearly_as_good_as_all_connections(seed):
    q, out = run(seed=seed)
    assert out.reason == ""
    assert out.path[0] == 0
    assert out.path[-1] == 1
    assert not out.overlap
    assert not out.lost
    best = best_by_dijkstra(q, length(np.ones(2)))
    assert best - 1e-12 <= out.cost <= 1.02 * best
    assert out.cost == pytest.approx(total(length(np.ones(2)), q[out.path]))


def test_without_the_goal_among_the_samples_there_is_never_a_path():
    _, out = run("goal")
    assert out.path is None
    assert "V_open is empty" in out.reason


def test_what_leaves_the_open_set_in_place_of_z_is_lost_and_z_comes_again():
    q, out = run("open")
    assert out.path is None
    assert "does not end" in out.reason
    assert run()[1].path is not None
    assert len(q) > 100


def test_a_closed_neighbour_is_open_and_closed_at_once():
    _, out = run("closed")
    assert out.overlap > 0
    assert out.lost, "z itself is in no set any more, so that the path's tree has lost it"


def test_if_the_next_z_is_not_chosen_the_loop_does_not_end():
    _, out = run("next")
    assert out.path is None
    assert "does not end" in out.reason


def test_as_printed_it_fails():
    _, out = run(*SLIPS)
    assert out.path is None


@pytest.mark.parametrize("kind", [length, stops, length_and_stops])
def test_every_cost_is_minimised_and_obeys_the_triangle_inequality(kind):
    cost, rng = kind(np.array([1.0, 1.0])), np.random.default_rng(0)
    a, b, c = rng.uniform(0, 1, (3, 200, 2))
    assert np.all(cost(a, c) <= cost(a, b) + cost(b, c) + 1e-12)
    paths = [
        FmtSearch(Wall(), START, GOAL, Wall.limits, np.random.default_rng(1), each).path(1000) for each in (cost, None)
    ]
    if kind is length:
        np.testing.assert_array_equal(*paths)
    else:
        assert total(cost, paths[0]) < total(cost, paths[1]), "the shortest path has more corners"


@pytest.mark.slow
def test_more_samples_shorten_the_path_and_a_closed_wall_is_said_to_enclose():
    costs = np.zeros((6, 3))
    for seed in range(6):
        search = FmtSearch(Wall(), START, GOAL, Wall.limits, np.random.default_rng(seed))
        costs[seed] = [total(length(np.ones(2)), search.path(n)) for n in (300, 1000, 3000)]
    assert costs.mean(axis=0)[0] > costs.mean(axis=0)[2]
    closed = Wall()
    closed.free_each = lambda a, b: (a[:, 0] < 0.15) == (b[:, 0] < 0.15)
    search = FmtSearch(closed, START, GOAL, Wall.limits, np.random.default_rng(0))
    assert search.path(300) is None
    near, far = search.reached()
    assert near < 0.2 * 300 < 0.7 * 300 < far


def test_in_a_box_in_which_no_joint_moves_the_path_is_its_only_state():
    box = np.stack([START, START], axis=1)
    search = FmtSearch(Wall(), START, START, box, np.random.default_rng(0))
    assert search.path(300).tolist() == [START.tolist(), START.tolist()]
    assert search.tree.corners.tolist() == [START.tolist(), START.tolist()]


def test_a_search_with_one_direction_is_grown_from_the_goal_against_the_motion():
    """As beside an arm that must not go back: y may not decrease, and only the start is enclosed."""
    way = length(np.ones(2))
    space = Wall()
    space.free_each = lambda a, b: (b[:, 1] >= a[:, 1]) & ((a[:, 0] < 0.15) == (b[:, 0] < 0.15))
    start, goal = np.array([0.1, 0.0]), np.array([0.9, 1.0])
    search = FmtSearch(
        *(space, start, goal, Wall.limits, np.random.default_rng(0)),
        lambda a, b: np.where(b[:, 1] >= a[:, 1], way(a, b), np.inf),
    )
    assert search.path(300) is None
    near, far = search.reached()
    assert near < 0.2 * 300 < 0.7 * 300 < far


def test_an_informed_search_draws_where_paths_can_be_shorter():
    search = FmtSearch(Wall(), START, GOAL, Wall.limits, np.random.default_rng(0))
    first = search.path(300)
    search.inform(first)
    assert search.count < 300
    corners = search.path(300)
    weights = np.ones(2)
    best = 2 * np.hypot(0.4, 0.3)
    assert total(length(weights), corners) < total(length(weights), first)
    assert best < total(length(weights), corners) < 1.05 * best


@pytest.mark.parametrize(
    ("start", "goal", "count", "text"),
    [
        (START, GOAL, 0, "0 samples cannot find a path; give at least 1"),
        (np.array([np.nan, 0.5]), GOAL, 10, "start of the search has values that are not finite"),
        (START, np.array([1.5, 0.5]), 10, "goal of the search is not in its box"),
    ],
)
def test_bad_input_of_a_search_is_named(start, goal, count, text):
    with pytest.raises(ProtocolError, match=text):
        FmtSearch(Wall(), start, goal, Wall.limits, np.random.default_rng(0)).path(count)
