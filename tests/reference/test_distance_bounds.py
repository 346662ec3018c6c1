"""Fast bounds of distances and the certificate of a path, against exact distances computed here by coal."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pytest

import twin
from made.arm import DENSE, arm, clearances, coarse_grids, post, space_of
from made.lanes import contrasting, designs
from made.mechanisms import box
from twin.api.scene_obstacles import obstacles_in_base
from twin.core import spatial
from twin.core.units import MM
from twin.model.body import Body, Frame, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.planning.fmt import FmtSearch
from twin.planning.obstacle_avoidance import around
from twin.planning.path import line
from twin.reference import ReferenceModel
from twin.reference.clearance import Shape
from twin.reference.collision_pairs import CollisionPairs
from twin.reference.distance_bounds import Bounds, balls_of, grid_of
from twin.reference.follower import Follower
from twin.reference.joint_space import JointSpace


def ball_of(radius, count):
    """Return a sphere as a mesh."""
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=count, radius=radius)
    return Mesh("ball", np.array(sphere.vertices), np.array(sphere.faces))


def exact(a, b, Ta, Tb):
    """Return the distance in m of two shapes by coal; 0 if they collide."""
    places = [coal.Transform3s(np.ascontiguousarray(T[:3, :3]), T[:3, 3]) for T in (Ta, Tb)]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return max(0.0, coal.distance(a.model, places[0], b.model, places[1], request, result))


SHAPES = {
    "plate": lambda: box("plate", [0.01, 0, 0], np.array([0.2, 0.1, 0.004])),
    "rod": lambda: box("rod", [0, 0, 0.1], np.array([0.008, 0.008, 0.4])),
    "ball": lambda: ball_of(0.03, 2),
}


@pytest.mark.parametrize(("first", "second"), [("plate", "rod"), ("ball", "rod")])
def test_a_bound_is_never_on_the_wrong_side_of_the_exact_distance(first, second, monkeypatch):
    coarse_grids(monkeypatch)
    rng = np.random.default_rng(0)
    a, b = (Shape(n, n, [SHAPES[n]()]) for n in (first, second))
    bounds = Bounds([a.triangles, b.triangles], np.array([[0, 1]]))
    Ts = np.array(
        [spatial.pose(spatial.exp_so3(rng.normal(size=3) * 2), rng.uniform(-0.2, 0.2, 3)) for _ in range(300)]
    )
    poses, row = np.stack([np.broadcast_to(np.eye(4), Ts.shape), Ts], axis=1), np.arange(len(Ts))
    low, high = bounds.at(poses, row, 0 * row, np.full(len(Ts), 0.02))
    true = np.array([exact(a, b, np.eye(4), T) for T in Ts])
    assert np.all(low <= true + 1e-9)
    assert np.all(high >= true - 1e-9)
    near = (true > 0.012) & (true < 0.02)
    assert near.any()
    assert np.mean(low[near] > 0) == 1.0, "bounds that are always 0 would also pass"
    rough, rough_high = bounds.at(poses, row, 0 * row, np.full(len(Ts), 0.02), smallest_radius=2 * MM)
    assert np.all(rough <= true + 1e-9)
    assert np.all(rough_high >= true - 1e-9)
    refused, reached = bounds.at(poses, row, 0 * row, np.full(len(Ts), 0.02), np.full(len(Ts), 0.01))
    assert np.all(true[reached < 0.01] < 0.01)
    assert np.all(refused <= true + 1e-9)
    swapped = Bounds([b.triangles, a.triangles], np.array([[0, 1]])).at(
        poses[:, ::-1], row, 0 * row, np.full(len(Ts), 0.02)
    )
    np.testing.assert_array_equal(swapped, (low, high))


def test_the_shape_with_the_grid_is_the_one_that_gives_the_closer_bounds(monkeypatch):
    """A long thin rod has smaller balls than a plate, and hardly a finer grid."""
    coarse_grids(monkeypatch)
    plate, rod = (Shape(n, n, [SHAPES[n]()]).triangles for n in ("plate", "rod"))
    rng = np.random.default_rng(0)
    Ts = np.array(
        [spatial.pose(spatial.exp_so3(rng.normal(size=3) * 2), rng.uniform(-0.1, 0.1, 3)) for _ in range(100)]
    )
    poses, row = np.stack([np.broadcast_to(np.eye(4), Ts.shape), Ts], axis=1), np.arange(len(Ts))
    wide = {}
    for order in ([0, 1], [1, 0]):
        bounds = Bounds([plate, rod], np.array([order]))
        chosen = bounds._pairs.tolist() == [order]
        bounds._pairs = np.array([order])
        low, high = bounds.at(poses, row, 0 * row, np.full(len(Ts), np.inf))
        wide[chosen] = float(np.mean(high - low))
    assert wide[True] < wide[False]


def test_nearer_agrees_with_the_exact_distance_at_every_margin():
    pairs, rng = CollisionPairs(ReferenceModel(arm(4)), [post(0.3, 0.1)], 5 * MM), np.random.default_rng(3)
    seen = 0
    for poses in pairs.poses(rng.uniform(-2.5, 2.5, (60, 4))):
        for row, (a, b) in enumerate(pairs.rows):
            true = exact(pairs.shapes[a], pairs.shapes[b], poses[a], poses[b])
            assert pairs.nearer(row, poses, true + 1e-4)
            assert pairs.distance(row, poses) == true
            assert pairs.distance(row, poses, 20 * MM) == min(true, 20 * MM)
            for margin in (1e-6, 1 * MM, 20 * MM, true - 1e-4):
                assert pairs.nearer(row, poses, margin) == (true < margin)
            seen += true == 0
    assert seen > 5, "some of the bodies must collide"


@pytest.mark.slow
def test_a_damaged_cache_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("twin.reference.distance_bounds._GRID_NODES", 1000)
    triangles = Shape("rod", "rod", [SHAPES["rod"]()]).triangles
    first, grid = balls_of(triangles), grid_of(triangles)
    files = sorted((tmp_path / "twin" / "distances").glob("*.npz"))
    assert len(files) == 2
    for damaged in (b"", b"no arrays", files[0].read_bytes()[:-100]):
        for file in files:
            file.write_bytes(damaged)
        np.testing.assert_array_equal(balls_of(triangles), first)
        np.testing.assert_array_equal(grid_of(triangles).values, grid.values)


def test_levers_bound_how_far_bodies_approach():
    pairs, rng = CollisionPairs(ReferenceModel(arm(4)), [post(0.6, 0.0)], 5 * MM), np.random.default_rng(2)
    used = np.zeros(len(pairs))
    for _ in range(40):
        x, step = rng.uniform(-2, 2, 4), rng.uniform(0, 0.1, 4)
        _, bound = pairs.around(x[None], step[None])
        poses = pairs.poses(np.vstack([x, x + rng.choice([-1, 1], (20, 4)) * step]))
        for row in range(len(pairs)):
            distances = np.array([pairs.distance(row, T) for T in poses])
            approach = np.abs(distances[1:] - distances[0]).max()
            assert approach <= bound[0, row] + 1e-9
            used[row] = max(used[row], approach / bound[0, row])
    assert used.min() > 0.5, "a bound without relation to the motion would also pass"


def test_a_ball_joint_that_turns_about_three_axes_in_turn_is_within_the_bound():
    """About x, then y, then z: the turn is larger than the norm of the three angles."""
    turns = 0.5 * np.eye(3)
    net = spatial.exp_so3(turns[0]) @ spatial.exp_so3(turns[1]) @ spatial.exp_so3(turns[2])
    far = np.cross(spatial.log_so3(net), [1.0, 0, 0])
    far *= 0.5 / np.linalg.norm(far)
    bodies = Body("base"), Body("ball", (box("dot", far, [1e-6] * 3),))
    joints = (Joint("port", "spherical", "base", "ball"),)
    tool, rest = Frame("tool", "ball", np.eye(4)), {"base": np.eye(4), "ball": np.eye(4)}
    model = ReferenceModel(Mechanism("ball", "base", bodies, joints, (tool,), rest=rest))
    pairs, x = CollisionPairs(model, [post(2.0, 0.0)], 5 * MM), model.home().x[None]
    bound = pairs.around(x, np.full((1, 3), 0.5))[1]
    end = x
    for turn in turns:
        end = model.tree.step(end, turn[None])
    T0, T1 = (pairs.poses(X)[0, 0] for X in (x, end))
    moved = np.linalg.norm(T1[:3, :3] @ far - T0[:3, :3] @ far)
    assert moved > 0.5 * np.linalg.norm([0.5] * 3), "the norm of the angles would not bound this motion"
    assert moved <= bound[0, 0]


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting(designs()))
def test_bounds_of_every_robot_hold_at_random_configurations(name):
    model = ReferenceModel(twin.load(name).mechanism)
    pairs, rng = CollisionPairs(model, (), 5 * MM), np.random.default_rng(0)
    X = np.array([model.home().x] * 4)
    single = [model.tree.model.joints[i] for i in range(1, model.tree.model.njoints)]
    places = [j.idx_q for j in single if j.nq == 1]
    X[:, places] += rng.uniform(-0.3, 0.3, (len(X), len(places)))  # loops may open: bodies are tested, not loops
    poses = pairs.poses(X)
    states, which = np.divmod(np.arange(len(X) * len(pairs)), max(len(pairs), 1))
    gaps = pairs.gaps(poses, states, which)
    states, which, gaps = (a[gaps < 20 * MM] for a in (states, which, gaps))
    low, high = pairs.bounds.at(poses, states, which, np.full(len(which), 20 * MM))
    for k, pair, least, most, gap in list(zip(states, which, low, high, gaps, strict=True))[:60]:
        a, b = pairs.rows[pair]
        true = exact(pairs.shapes[a], pairs.shapes[b], poses[k, a], poses[k, b])
        assert max(least, gap) <= true + 1e-9
        assert most >= true - 1e-9


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
def test_a_certificate_is_below_the_smallest_distance_and_within_a_millimetre(seed):
    stills = [post(0.52, 0.0)]
    space = space_of(arm(), *stills)
    path = around(space, np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1]), seed=seed)
    seen = space.certify(path)
    true = clearances(path(np.linspace(0, 1, 4001)), stills).min()
    assert seen.proven <= true
    assert true - seen.proven < 1 * MM
    assert seen.found >= seen.proven
    assert "room/post" in seen.bodies or seen.found < true


def test_connections_that_seem_free_are_nearly_always_free_and_blocked_ones_are_found():
    rng, stills = np.random.default_rng(1), [post(0.3, 0.1, 0.12)]
    space = space_of(arm(), *stills)
    q = rng.uniform(-2.0, 2.0, (80, 3))
    q = q[space.free(q)]
    a, b = q[:-1], q[1:]
    seem, true = space.free_each(a, b), np.array([space.free_between(p, r) for p, r in zip(a, b, strict=True)])
    assert true.any()
    assert not true.all()
    assert np.all(seem[true]), "a free path must seem free"
    assert np.mean(seem == true) > 0.9


def test_more_samples_reuse_the_earlier_ones_and_shorten_the_path():
    space = space_of(arm(), post(0.52, 0))
    start, goal = np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1])
    costs, checks = [], []
    search = FmtSearch(space, start, goal, space.limits, np.random.default_rng(0))
    for samples in (100, 200, 400):
        corners = search.path(samples)
        assert search.count == samples
        if corners is not None:
            costs.append(np.linalg.norm(np.diff(corners, axis=0) * space.weights, axis=1).sum())
        checks.append(search.checks)
    fresh = FmtSearch(space, start, goal, space.limits, np.random.default_rng(0))
    fresh.path(400)
    assert checks[2] - checks[1] < fresh.checks, "connections known from before are not tested again"
    assert costs[-1] < costs[0]


def test_a_search_can_be_ended_at_any_moment():
    class EndedError(Exception):
        pass

    def end(fraction):
        if fraction > 0.6:
            raise EndedError

    space = space_of(arm(), post(0.52, 0))
    with pytest.raises(EndedError):
        around(space, np.array([-1.1, 0.2, 0.1]), np.array([1.1, -0.2, -0.1]), progress=end)


def test_a_straight_path_past_a_post_has_an_exact_certificate():
    stills = [post(0.3, 0.2)]
    space = space_of(arm(), *stills)
    path = line(np.array([-0.2, 0.0, 0.0]), np.array([0.1, 0.0, 0.0]))
    seen, true = space.certify(path), clearances(path(DENSE), stills).min()
    assert true - 1 * MM < seen.proven <= true


@pytest.mark.slow
def test_the_way_out_of_the_dome_is_free_by_exact_geometry():
    robot = twin.load("raven_left")
    follower, stills = Follower(robot.reference), obstacles_in_base("dome", "raven_left", twin.load)
    space = JointSpace(lambda: follower.model, 2 * MM, around=lambda: stills)
    protocol = robot.protocol(Path(__file__).parents[2] / "trajectories/raven_left/around/dome.toml")
    names, home = [j.name for j in follower.model.mechanism.active], follower.model.home().q
    ends = []
    for waypoint in ("below", "above"):
        q = home.copy()
        for joint, value in (protocol.waypoints[waypoint].joints or {}).items():
            q[names.index(joint)] = value
        ends.append(q)
    assert not space.free_between(*ends), "the straight way must be blocked by the lid"
    path = around(space, *ends)
    seen = space.certify(path)
    model = ReferenceModel(robot.mechanism)
    links = model.link_poses(model.run(path(np.linspace(0, 1, 101))).x)
    shapes = {b.name: Shape(b.name, b.name, b.meshes) for b in robot.mechanism.bodies if b.meshes}
    least = np.inf
    for still in stills:
        other = Shape(still.name, still.name, still.body.meshes)
        for name in ("shaft", "clevis", "hand", "jaw_left", "jaw_right"):
            least = min(least, *(exact(shapes[name], other, T, still.T_base_body) for T in links[name]))
    assert 1 * MM <= seen.proven <= least
    assert seen.proven <= seen.found <= least + 1 * MM
