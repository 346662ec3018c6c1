"""Ways around obstacles: free by an exact check that shares nothing with the search, exact at their ends."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import twin
from made import protocols
from made.arm import CLEARANCE, DENSE, arm, clearances, coarse_grids, post, space_of
from made.mechanisms import box, four_bar
from twin.core import spatial
from twin.core.errors import CancelledError, DescriptionError, ProtocolError
from twin.core.units import MM
from twin.model.body import Body
from twin.planning.costs import COSTS
from twin.planning.obstacle_avoidance import NoPathError, around, rounded
from twin.planning.path import line
from twin.planning.plan import plan
from twin.planning.protocol import load_protocol
from twin.planning.rounds import UNITS
from twin.planning.space import nearest_free
from twin.reference import ReferenceModel
from twin.reference.collision_pairs import Obstacle
from twin.reference.follower import Follower
from twin.reference.joint_space import JointSpace
from twin.reference.relative_motion import GlobalMotionBounds

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("seed", range(2))
def test_every_way_of_an_arm_is_free_and_its_ends_are_exact(seed):
    rng = np.random.default_rng(seed)
    r, a = rng.uniform(0.48, 0.58), rng.uniform(-0.3, 0.3)
    stills = [post(r * np.cos(a), r * np.sin(a))]
    space = space_of(arm(), *stills)
    start, goal = np.array([a - 1.1, 0.2, 0.1]), np.array([a + 1.1, -0.2, -0.1])
    assert not space.free_between(start, goal)
    assert clearances(line(start, goal)(DENSE), stills).min() <= 0, "the straight way must run through the post"
    path = around(space, start, goal, seed=seed)
    np.testing.assert_allclose(path(np.array([0.0, 1.0])), [start, goal], atol=1e-14)
    assert clearances(path(DENSE), stills).min() >= CLEARANCE / 2
    assert np.all((path(DENSE) >= space.limits[:, 0]) & (path(DENSE) <= space.limits[:, 1]))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_way_and_another_seed_another():
    start, goal = np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1])
    a, b, c = (around(space_of(arm(), post(0.52, 0)), start, goal, seed=s).coefficients for s in (3, 3, 4))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


ENDS = np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1])


def length_of(space, path):
    return np.linalg.norm(np.diff(path(DENSE) * space.weights, axis=0), axis=1).sum()


@pytest.mark.slow
def test_more_samples_shorten_the_path():
    space = space_of(arm(), post(0.52, 0))
    first, second = (length_of(space, around(space, *ENDS, seed=2, samples=n)) for n in (0, 400))
    assert second < 0.94 * first


@pytest.mark.nightly
def test_improved_paths_of_all_seeds_are_equally_long():
    space = space_of(arm(), post(0.52, 0))
    lengths = [length_of(space, around(space, *ENDS, seed=seed, samples=800)) for seed in range(4)]
    assert max(lengths) < 1.01 * min(lengths)


@pytest.mark.slow
def test_a_path_whose_corners_graze_keeps_most_of_its_shortcuts():
    """Without any shortcut, three of these paths are 0.40 m long."""
    space = space_of(arm(), post(0.52, 0))
    lengths = [length_of(space, around(space, *ENDS, seed=seed)) for seed in range(6)]
    assert max(lengths) < 1.08 * min(lengths)


@pytest.mark.nightly
def test_rounds_are_told_with_their_costs_and_the_last_one_is_the_path():
    space, first, again = space_of(arm(), post(0.52, 0)), [], []
    path = around(space, *ENDS, seed=0, samples=700, ended=lambda done, tree: first.append(done))
    repeated = around(space, *ENDS, seed=0, samples=700, ended=lambda done, tree: again.append(done))
    assert np.array_equal(path.coefficients, repeated.coefficients)
    assert first == again, "samples and costs are the same each time"
    assert [r.samples for r in first] == [60, 200, 400, 700]
    assert first[0].best == first[0].tree == np.inf, "no path through 60 samples"
    best = [r.best for r in first[1:]]
    assert best == sorted(best, reverse=True)
    assert all(r.best <= r.tree for r in first)
    direct = float(np.linalg.norm((ENDS[1] - ENDS[0]) * space.weights))
    along = np.linalg.norm(np.diff(path(DENSE) * space.weights, axis=0), axis=1).sum()
    assert direct <= along <= best[-1] + 1e-9, "rounding makes a path shorter"
    assert along == pytest.approx(best[-1], rel=0.1)
    for kind in ("processor", "wall"):
        spent = [getattr(r, kind) for r in first]
        assert 0 <= spent[0] <= spent[-1]
        assert spent == sorted(spent)
    around(space_of(arm()), np.zeros(3), np.ones(3), ended=lambda r, tree: pytest.fail("it searched"))


@pytest.mark.slow
def test_the_cost_for_clearance_keeps_the_path_away_from_the_post():
    stills = [post(0.52, 0)]
    space = space_of(arm(), *stills)
    short, wide = (around(space, *ENDS, seed=3, **more) for more in (
        {}, {"cost": COSTS["clearance"](space), "straight": False}))  # fmt: skip
    near = [np.maximum(1 - clearances(way(DENSE), stills) / (20 * MM), 0).mean() for way in (short, wide)]
    assert near[1] < 0.5 * near[0]


@pytest.mark.slow
def test_a_free_straight_path_is_left_only_for_more_clearance():
    stills = [post(0.52, 0)]
    space = space_of(arm(), *stills)
    straight = around(space, np.array([-1.1, 0.2, 0.1]), np.array([-0.35, 0.2, 0.1]))
    assert len(straight.coefficients) == 2
    at = clearances(straight(DENSE), stills).min()
    cost = COSTS["clearance"](space)
    away = around(space, straight(np.zeros(1))[0], straight(np.ones(1))[0], cost=cost, straight=False, samples=200)
    assert clearances(away(DENSE), stills).min() >= at - 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_clearances_are_never_above_the_exact_distance(seed):
    stills = [post(0.52, 0), replace(post(-0.3, 0.4), name="room/other")]
    space = space_of(arm(), *stills)
    q = np.random.default_rng(seed).uniform(*space.limits.T, (200, 3))
    exact = np.clip(clearances(q, stills), 0, 50 * MM)
    found = space.clearances(q, 50 * MM)
    assert np.all(found <= exact + 1e-9)
    assert np.all(found >= exact - 8 * MM), "close enough to rank paths"


def test_every_cost_has_a_unit():
    assert set(UNITS) == set(COSTS)


def test_progress_is_told_and_a_straight_way_needs_no_search():
    seen = []
    around(
        space_of(arm(), post(0.52, 0)), np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1]), progress=seen.append
    )
    assert len(seen) > 3
    assert 0 <= min(seen) <= max(seen) <= 1
    straight = around(space_of(arm()), np.zeros(3), np.ones(3), progress=lambda f: pytest.fail("it searched"))
    assert len(straight.coefficients) == 2


@pytest.mark.slow
def test_a_search_can_be_cancelled_at_any_moment_and_is_the_same_when_repeated():
    space, start, goal = space_of(arm(), post(0.52, 0)), np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1])
    asked = []
    expected = around(space, start, goal, cancelled=lambda: bool(asked.append(0)))
    for left in {0, 1, 2, 5, len(asked) // 2, len(asked) - 1}:
        count = iter(range(left))
        with pytest.raises(CancelledError, match="was cancelled"):
            around(space, start, goal, cancelled=lambda c=count: next(c, None) is None)
    again = around(space, start, goal)
    assert np.array_equal(again.coefficients, expected.coefficients)


def test_the_tree_of_a_search_begins_at_the_start_and_has_no_circles():
    space, trees = space_of(arm(), post(0.52, 0)), []
    start, goal = np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1])
    around(space, start, goal, ended=lambda done, tree: trees.append(tree))
    tree = trees[-1]
    np.testing.assert_array_equal(tree.q[:2], [start, goal])
    assert tree.parent[1] >= 0, "the last search found a path"
    assert len(tree.branches) == (tree.parent >= 0).sum() > 10
    for row in tree.branches[:, 1]:
        steps = 0
        while (row := tree.parent[row]) > 0:
            steps += 1
            assert steps < len(tree.q)
        assert row == 0


def test_free_agrees_with_the_exact_distance():
    rng, stills = np.random.default_rng(0), [post(0.3, 0.1, 0.12)]
    q = rng.uniform(-2.6, 2.6, (300, 3))
    exact = clearances(q, stills)
    clear = np.abs(exact - CLEARANCE) > 1e-6
    found = space_of(arm(), *stills).free(q)
    assert np.array_equal(found[clear], exact[clear] >= CLEARANCE)
    assert 0.1 < found.mean() < 0.9


def test_a_path_that_only_touches_between_any_samples_is_not_free():
    """A thin wire is crossed in 1e-3 of the path: steps would jump over it, a bound cannot."""
    wire = post(0.55, 0.0, size=1e-4)
    space = space_of(arm(), wire, clearance=0.2 * MM)
    start, goal = np.array([-1.3, 0.0, 0.0]), np.array([1.3, 0.0, 0.0])
    assert space.free(np.array([start, goal])).all()
    assert not space.free_between(start, goal)
    assert space.free_between(start, np.array([-0.1, 0.0, 0.0]))


def test_bodies_never_move_further_than_the_bound():
    model = ReferenceModel(arm(4))
    corners = {b.name: b.meshes[0].vertices for b in model.mechanism.bodies if b.meshes}
    names = list(combinations(corners, 2))
    at = {n: (model.tree.body(n)[0], corners[n] @ (T := model.tree.body(n)[1])[:3, :3].T + T[:3, 3]) for n in corners}
    bounds = GlobalMotionBounds(model.tree, [(at[a], at[b]) for a, b in names]).bounds(np.zeros((1, 4)), np.zeros(4))
    rng = np.random.default_rng(1)
    tightest = 1.0
    for _ in range(200):
        q = rng.uniform(-2, 2, 4)
        step = rng.normal(size=4) * 10 ** rng.uniform(-4, -1)
        links = model.link_poses(np.array([q, q + step]))
        for (a, b), most in zip(names, bounds @ np.abs(step), strict=True):
            seen = spatial.inverse(links[a]) @ links[b]
            moved = seen[:, :3, :3] @ corners[b].T + seen[:, :3, 3:]
            far = np.linalg.norm(moved[1] - moved[0], axis=0).max()
            assert far <= most * (1 + 1e-9)
            tightest = min(tightest, 1 - far / most)
    assert tightest < 0.3, "a bound that is never nearly reached only costs time"


# -- loops -----------------------------------------------------------------------------------------------------------


def limited_four_bar():
    made = four_bar()
    joints = tuple(replace(j, limits=(-0.5, 2.5)) if j.active else j for j in made.joints)
    return replace(made, joints=joints)


def test_a_closed_loop_meets_what_stands_in_the_way_of_a_passive_body(monkeypatch):
    coarse_grids(monkeypatch)
    mechanism = limited_four_bar()
    model = ReferenceModel(mechanism)
    q = np.linspace(-0.6, 0.6, 61)[:, None] + model.home().q
    links = model.link_poses(model.run(q).x)
    driven = {j.child for j in mechanism.active}
    passive = next(
        b for b in mechanism.bodies if b.meshes and b.name not in driven and np.ptp(links[b.name], axis=0).max() > 1e-3
    )
    middle = links[passive.name][30]
    centre = np.concatenate([m.vertices for m in passive.meshes]).mean(axis=0)
    free = space_of(mechanism, clearance=MM)
    assert free.free_between(q[0], q[-1]) or not free.free(q).all()
    ball = Obstacle("room/ball", Body("ball", (box("ball", [0, 0, 0], [0.03] * 3),)), middle @ spatial.pose(p=centre))
    blocked = space_of(mechanism, ball, clearance=MM)
    assert passive.name in blocked.why(q[30])
    assert not blocked.free_between(q[0], q[-1])


@pytest.mark.slow
def test_loops_that_cannot_close_are_not_free():
    made = limited_four_bar()
    wide = replace(made, joints=tuple(replace(j, limits=(-9.0, 9.0)) if j.active else j for j in made.joints))
    model = ReferenceModel(wide)
    reached = []
    for x in np.linspace(-4, 4, 17):
        try:
            model.solve(np.array([x]))
            reached.append(True)
        except twin.TwinError:
            reached.append(False)
    found = space_of(wide, clearance=1e-6).free(np.linspace(-4, 4, 17)[:, None])
    assert not np.any(found & ~np.array(reached))


def test_connections_without_length_are_as_free_as_their_ends():
    mechanism = limited_four_bar()
    q = np.array([[0.1], [0.4]]) + ReferenceModel(mechanism).home().q
    space = space_of(mechanism, clearance=MM)
    assert np.array_equal(space.free_each(q, q), space.free(q))
    assert space.free_each(q, q).all()


# -- what is said ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ([0.0, 0, 0], [1.5, 0, 0], "at the start, link1 and room/post collide"),
        ([1.5, 0, 0], [0.0, 0, 0], "at the goal, link1 and room/post collide"),
        ([1.5, 0, 0], [2.7, 0, 0], r"at the goal, joint q0 = 154.699 deg is 5.73 deg beyond its limits"),
        ([1.5, 0, 0], [0.0, 2.5, 2.5], "mm apart \\(required: 5 mm\\)|collide"),
        ([0.0, 0, 0], [1.5, 0, 0], r"the nearest free configuration found is q0_deg = .*, q1_deg = .*, q2_deg = "),
        ([1.5, 0, 0], [2.7, 0, 0], r"the nearest free configuration found is q0_deg = 149, q1_deg = 0, q2_deg = 0"),
        ([np.nan, 0, 0], [1.5, 0, 0], "at the start, joint values are not finite"),
    ],
)
def test_an_end_that_is_not_free_is_named_with_its_size(start, goal, words):
    with pytest.raises(ProtocolError, match=words):
        around(space_of(arm(), post(0.3, 0)), np.array(start), np.array(goal))


@pytest.mark.parametrize(
    ("q", "advice"),
    [
        ([0.0, 0, 0], ". Move this waypoint"),  # collides: a lower clearance would not help
        ([0.17, 0, 0], ". Move this waypoint, or lower clearance_mm"),
        ([2.7, 0, 0], ""),  # beyond its limits
    ],
)
def test_advice_for_an_end_follows_from_the_distance_of_its_bodies(q, advice):
    space = space_of(arm(), post(0.3, 0))
    with pytest.raises(NoPathError) as told:
        around(space, np.array(q), np.array([1.5, 0, 0]))
    assert str(told.value) == told.value.reason + advice


@pytest.mark.parametrize(("start", "goal", "at_start"), [(0.0, 1.5, True), (1.5, 0.0, False)])
def test_a_start_that_is_not_free_is_told_from_a_goal(start, goal, at_start):
    with pytest.raises(NoPathError) as told:
        around(space_of(arm(), post(0.3, 0)), np.array([start, 0, 0]), np.array([goal, 0, 0]))
    assert told.value.at_start == at_start


def test_an_end_at_a_limit_may_be_beyond_it_by_rounding():
    space, start = space_of(arm()), np.array([0.0, 0.0, 0.0])
    goal = np.array([np.nextafter(2.6, 3.0), 0.0, 0.0])
    assert space.why(goal) == ""
    assert space.free(goal[None]).all()
    around(space, start, goal)
    assert "beyond its limits" in space.why(np.array([2.6 + 1e-8, 0.0, 0.0]))


def test_the_nearest_free_configuration_is_free_and_no_other_is_much_nearer():
    space, q = space_of(arm(), post(0.3, 0)), np.zeros(3)
    near = nearest_free(space, q)
    assert space.free(near[None])[0]
    others = np.random.default_rng(5).uniform(-1, 1, (300, 3)) * np.abs(near).max()
    others = others[space.free(others)]
    assert np.linalg.norm(near) < 1.5 * np.linalg.norm(others, axis=1).min()


def test_no_way_says_what_was_tried(monkeypatch):
    monkeypatch.setattr("twin.planning.obstacle_avoidance._SEARCHES", ((0.2, 20), (1.0, 30)))
    space = space_of(arm(1), *[replace(post(0.15, 0.0), name="room/wall")])
    with pytest.raises(
        NoPathError,
        match=r"no path around .*20 samples in a box that extends 20 % of .* range .*, 30 samples .* 100 % .* waypoint",
    ) as raised:
        around(space, np.array([-1.5]), np.array([1.5]))
    assert str(raised.value).startswith(raised.value.reason)
    assert raised.value.reason.endswith("beyond start and goal)"), "without what to change in a protocol"


@pytest.mark.parametrize(("start", "goal", "end"), [(1.5, -1.5, "start"), (-1.5, 1.5, "goal")])
def test_no_way_out_of_a_closed_place_names_the_end_that_is_enclosed(monkeypatch, start, goal, end):
    monkeypatch.setattr("twin.planning.obstacle_avoidance._SEARCHES", ((0.2, 20), (1.0, 60)))
    walls = [
        replace(post(0.15 * np.cos(a), 0.15 * np.sin(a)), name=f"room/{name}")
        for name, a in (("right", 1.05), ("left", 1.95))
    ]
    with pytest.raises(ProtocolError, match=rf"\); the {end} seems to be enclosed, because only \d of 60 samples are"):
        around(space_of(arm(1), *walls), np.array([start]), np.array([goal]))


@pytest.mark.parametrize("seed", range(3))
def test_a_rounded_way_is_smooth_keeps_its_ends_and_comes_near_its_corners(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (6, 3))
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    sharp = np.column_stack([np.interp(DENSE * along[-1], along, column) for column in corners.T])
    off = []
    for width in (0.1, 0.05, 0.025, 0.0125):
        curve = rounded(corners, np.ones(3), width)
        q = curve(DENSE)
        np.testing.assert_allclose(q[[0, -1]], corners[[0, -1]], atol=1e-12)
        np.testing.assert_allclose(curve(DENSE[1:-1], 1), (q[2:] - q[:-2]) / 2e-3, atol=0.05 / width)
        assert curve.tail.max() < 1e-6
        off.append(np.abs(q - sharp).max())
    assert off == sorted(off, reverse=True)
    assert off[-1] < 0.2 * off[0]


# -- in a protocol ---------------------------------------------------------------------------------------------------

PLACES = {
    "pa10": {
        "frame": "instrument_tip",
        "a": [310, 480, 160],
        "b": [-310, 480, 160],
        "angles": [0, 180, 0],
    },
    "sils": {
        "frame": "endoscope_tip",
        "a": [478, 320, 10],
        "b": [528, 318, 15],
        "angles": [0, 0, 0],
    },
}


POSTS = {"pa10": 20 * MM, "sils": 4 * MM}
"""Edge of the obstacle: the shaft of sils is thick, and it moves by 50 mm only."""


def written(folder, robot, more=""):
    place, path = PLACES[robot], folder / "over.toml"
    head = {"name": "over", "title": "Over an obstacle", "robot": robot, "frame": place["frame"], "start": "a"}
    waypoints = [protocols.waypoint(k, place["angles"], position_mm=place[k]) for k in "ab"]
    parts = [*waypoints, protocols.phase(name="across", type="free", to="b"), more]
    limits = {"free": (300, 900, 90, 300)}
    text = protocols.text(head | {"no_patient": "made for a test"}, "", limits, parts)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("clearance_mm = 0", "clearance_mm = 0: out of range"),
        ("seed = -1", "seed = -1: out of range"),
        ("sample = 9", "sample: unknown key"),
        ("samples = -1", "samples = -1: out of range"),
        ('cost = "time"', 'cost = "time": not known; allowed: length, stops'),
    ],
)
def test_wrong_keys_of_a_free_phase_are_refused(tmp_path, more, words):
    with pytest.raises(DescriptionError, match=words):
        load_protocol(written(tmp_path, "pa10", more))


def test_a_free_phase_needs_a_mechanism_and_a_scene_that_is_there(tmp_path):
    robot = twin.load("pa10")
    protocol = load_protocol(written(tmp_path, "pa10"))
    T, bare = robot.mechanism.frame_in_tool("instrument_tip"), replace(robot.path_kinematics(), space=None)
    with pytest.raises(ProtocolError, match=r"phase 'across' \(free\): a free motion requires a mechanism"):
        plan(protocol, bare, T_tool_frame=T)
    with pytest.raises(ProtocolError, match=r"there is no scene 'vrs'\. Did you mean 'vsrs'"):
        twin.plan(robot, written(tmp_path, "pa10", 'scene = "vrs"'))


@pytest.mark.nightly
@pytest.mark.parametrize("name", PLACES if "TWIN_WAYS" in os.environ else ["pa10"])  # one of SILS takes 100 s
def test_free_phases_of_robots_go_around_a_post_and_are_judged_right(tmp_path, name):
    """TWIN_WAYS plans of each (default 1), the obstacle in the middle of the straight way; collisions: none."""
    robot = twin.load(name)
    follower = Follower(robot.reference)
    for seed in range(int(os.environ.get("TWIN_WAYS", "1"))):
        path = written(tmp_path, name, f"seed = {seed}")
        protocol = robot.protocol(path)
        kinematics = robot.path_kinematics()
        T = robot.mechanism.frame_in_tool(protocol.frame)
        straight = plan(protocol, kinematics, T_tool_frame=T)
        middle = straight.q[len(straight.t) // 2]
        tip = ReferenceModel(robot.mechanism).run(np.array([straight.q[0], middle])).Ts_base_tool[-1] @ T
        size = POSTS[name]
        still = Obstacle("room/post", Body("post", (box("post", [0, 0, 0], [size] * 3),)), spatial.pose(p=tip[:3, 3]))

        def space(scene, clearance, keep, still=still):
            return JointSpace(lambda: follower.model, clearance, keep=keep, around=lambda: [still])

        found = plan(protocol, replace(kinematics, space=space), T_tool_frame=T)
        assert [f for f in found.findings if f.severity in ("error", "disagreement")] == []
        times = np.linspace(0.0, found.duration, 400)
        model = ReferenceModel(robot.mechanism)
        links = model.link_poses(model.run(found.joints(times)).x)
        assert nearest(robot.mechanism, links, still) >= CLEARANCE / 2
        assert nearest(robot.mechanism, model.link_poses(model.run(straight.joints(times)).x), still) < CLEARANCE / 2
        report = twin.validate(robot, found, protocol=path)
        assert [str(f) for f in report.findings if f.severity in ("error", "disagreement")] == []


def nearest(mechanism, links, still):
    """Return the minimum distance in m of a robot's bodies from a box along link poses, by vertices in the box's frame.

    Vertices of a mesh with chords of 0.1 mm are within a fraction of a millimetre of its nearest point if its triangles
    are small; long ones are halved first.
    """
    import trimesh

    half = np.ptp(still.body.meshes[0].vertices, axis=0) / 2
    least = np.inf
    for body in mechanism.bodies:
        for mesh in body.meshes:
            vertices, _ = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.triangles, 10 * MM, max_iter=20)
            for T in np.broadcast_to(links[body.name], (len(next(iter(links.values()))), 4, 4))[::4]:
                p = vertices @ T[:3, :3].T + T[:3, 3] - still.T_base_body[:3, 3]
                out = np.maximum(np.abs(p) - half, 0)
                least = min(least, float(np.sqrt((out**2).sum(axis=1).min())))
    return least
