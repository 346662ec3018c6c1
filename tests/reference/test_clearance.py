"""Minimum clearances: exact where they are known, never missed where they are skipped."""

from __future__ import annotations

from itertools import combinations

import coal
import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.model.body import Body, Frame, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.clearance import Shape, clearance

X = spatial.pose(spatial.frame_from_axes([1, 0, 0], [0, 0, -1]))
"""A joint frame whose z is the x of its body."""


def box(name, low, high):
    """Return a closed box mesh between two corners."""
    low, high = np.array(low, float), np.array(high, float)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])]
    return Mesh(name, corners, np.array(triangles, np.int32))


def mechanism(bodies, joints, rest):
    frame = Frame("tool", bodies[-1].name, np.eye(4))
    return Mechanism("m", bodies[0].name, tuple(bodies), tuple(joints), (frame,), rest=rest)


def two_boxes():
    """A box that slides along x towards another that stands 1 m away; a rail between base and box has no mesh."""
    bodies = (
        Body("base"),
        Body("wall", (box("wall_box", [0, -0.1, -0.1], [0.1, 0.1, 0.1]),)),
        Body("cart", (box("cart_box", [-0.2, -0.05, -0.05], [0, 0.05, 0.05]),)),
    )
    joints = (
        Joint("stand", "fixed", "base", "wall", spatial.pose(p=[1, 0, 0])),
        Joint("slide", "prismatic", "base", "cart", X, X, active=True),
    )
    rest = {"base": np.eye(4), "wall": spatial.pose(p=[1, 0, 0]), "cart": np.eye(4)}
    return mechanism(bodies, joints, rest)


def link_poses(m, q):
    model = ReferenceModel(m)
    return model.link_poses(model.run(np.asarray(q, float)).x)


def test_a_flat_body_without_a_hull_is_named():
    plate = box("plate_box", [0, -0.1, -0.1], [0, 0.1, 0.1])
    with pytest.raises(
        TwinError, match=r"m/plate is flat: all its vertices are in one plane.* Draw it with a thickness"
    ):
        Shape("m/plate", "m/plate", (plate,)).hull  # noqa: B018


def test_the_distance_of_an_approach_is_exact_at_every_sample():
    q = 0.5 + 0.45 * np.sin(np.linspace(-2, 5, 400))
    found = clearance(two_boxes(), link_poses(two_boxes(), q[:, None]))
    assert np.abs(found.distance - (1 - q)).max() < 1e-12
    assert set(found.pair) == {("wall", "cart")}
    assert found.contacts == ()


def test_contact_is_distance_zero_for_as_long_as_it_lasts():
    q = np.linspace(0.9, 1.2, 301)
    found = clearance(two_boxes(), link_poses(two_boxes(), q[:, None]))
    assert np.abs(found.distance - np.maximum(1 - q, 0)).max() < 1e-12
    assert np.array_equal(found.distance == 0, q >= 1 - 1e-12)


def test_progress_ends_at_one():
    seen = []
    q = np.linspace(0, 0.5, 20)
    clearance(two_boxes(), link_poses(two_boxes(), q[:, None]), seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_nothing_to_measure_is_infinitely_far():
    m = mechanism(
        [Body("base"), Body("cart", (box("b", [0, 0, 0], [1, 1, 1]),))],
        [Joint("slide", "prismatic", "base", "cart", active=True)],
        {},
    )
    found = clearance(m, link_poses(m, np.zeros((3, 1))))
    assert np.array_equal(found.distance, np.full(3, np.inf))
    assert found.contacts == ()


# -- skipping never misses -----------------------------------------------------------------------------


def brute_force(m, poses):
    """Measure every pair of bodies that no joint connects at every sample."""
    jointed = {frozenset((j.parent, j.child)) for j in m.joints}
    shapes = {}
    for body in m.bodies:
        shape = coal.BVHModelOBBRSS()
        (part,) = body.meshes
        shape.beginModel(len(part.triangles), len(part.vertices))
        shape.addVertices(part.vertices)
        shape.addTriangles(part.triangles.astype(np.int64))
        shape.endModel()
        shapes[body.name] = shape
    pairs = [p for p in combinations(shapes, 2) if frozenset(p) not in jointed]
    count = len(next(iter(poses.values())))
    out = np.zeros((count, len(pairs)))
    for k in range(count):
        for i, (a, b) in enumerate(pairs):
            Ta, Tb = (coal.Transform3s(poses[n][k][:3, :3].copy(), poses[n][k][:3, 3]) for n in (a, b))
            result = coal.DistanceResult()
            out[k, i] = coal.distance(shapes[a], Ta, shapes[b], Tb, coal.DistanceRequest(), result)
    return np.maximum(out, 0.0), pairs


def random_tree(rng, count=6):
    """Return a tree of boxes on revolute and prismatic joints, anywhere."""
    bodies = [
        Body(f"b{i}", (box(f"m{i}", rng.uniform(-0.15, 0, 3), rng.uniform(0.02, 0.15, 3)),)) for i in range(count)
    ]
    joints = []
    for i in range(1, count):
        T = [spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.uniform(-0.5, 0.5, 3)) for _ in range(2)]
        kind = ["revolute", "prismatic"][int(rng.integers(2))]
        joints.append(Joint(f"j{i}", kind, f"b{int(rng.integers(i))}", f"b{i}", *T, active=True))
    return mechanism(bodies, joints, {})


@pytest.mark.parametrize("seed", range(6))
def test_what_is_skipped_is_never_the_nearest(seed):
    rng = np.random.default_rng(seed)
    m = random_tree(rng)
    t = np.linspace(0, 1, 80)[:, None]
    q = rng.uniform(-0.5, 0.5, 5) * np.sin(2 * np.pi * t * rng.uniform(0.3, 2, 5) + rng.uniform(0, 6, 5))
    poses = link_poses(m, q)
    found = clearance(m, poses)
    distances, pairs = brute_force(m, poses)
    assert np.abs(found.distance - distances.min(axis=1)).max() < 1e-12
    for k, pair in enumerate(found.pair):
        own = distances[k, pairs.index(pair)]
        assert own == pytest.approx(distances[k].min(), abs=1e-12)
    assert np.ptp(found.distance) > 0.01  # something happened


# -- parts of jointed bodies ---------------------------------------------------------------------------


def hinge(mating=()):
    """An arm with a pin in an eye of the base; 80 mm out, a block on the base stops it at a quarter turn."""
    base = Body(
        "base",
        (
            box("eye", [-0.01, -0.01, -0.01], [0.01, 0.01, 0.01]),
            box("stop", [-0.01, 0.07, -0.01], [0.01, 0.09, 0.01]),
        ),
    )
    arm = Body(
        "arm",
        (
            box("pin", [-0.004, -0.004, -0.02], [0.004, 0.004, 0.02]),
            box("rod", [0.02, -0.003, -0.003], [0.1, 0.003, 0.003]),
        ),
    )
    joint = Joint("turn", "revolute", "base", "arm", active=True, mating=mating)
    return mechanism([base, arm], [joint], {"base": np.eye(4), "arm": np.eye(4)})


def test_parts_of_jointed_bodies_that_run_through_each_other_are_found():
    m = hinge(("eye", "pin"))
    turn = np.linspace(0, np.pi / 2, 501)[:, None]
    found = clearance(m, link_poses(m, turn))
    ((sample, *parts),) = found.contacts
    assert set(parts) == {"rod", "stop"}
    # The rod's far upper edge (0.1, 0.003) meets the stop's face x = 0.01; every fifth sample is looked at.
    reach, corner = np.hypot(0.09, 0.003), 0.0
    touching = [k for k in range(0, 501, 5) if _touches(turn[k, 0])]
    assert sample == touching[0]
    assert reach > corner
    assert np.array_equal(found.distance, np.full(501, np.inf))  # no two bodies without a joint


def _touches(angle):
    """Whether the rod's rectangle meets the stop's in the plane, by separating axes."""
    c, s = np.cos(angle), np.sin(angle)
    rod = np.array([[0.02, -0.003], [0.1, -0.003], [0.1, 0.003], [0.02, 0.003]]) @ [[c, s], [-s, c]]
    stop = np.array([[-0.01, 0.07], [0.01, 0.07], [0.01, 0.09], [-0.01, 0.09]])
    for axis in ([1, 0], [0, 1], [c, s], [-s, c]):
        a, b = rod @ axis, stop @ axis
        if a.max() < b.min() or b.max() < a.min():
            return False
    return True


def test_mating_parts_are_left_out_and_so_are_parts_that_touch_as_drawn():
    short = np.linspace(0, 0.3, 50)[:, None]
    for mating in ((), ("eye", "pin")):
        m = hinge(mating)
        assert clearance(m, link_poses(m, short)).contacts == ()


def test_a_part_named_as_mating_may_run_into_its_partner():
    m = hinge(("rod", "stop"))
    turn = np.linspace(0, np.pi / 2, 501)[:, None]
    assert clearance(m, link_poses(m, turn)).contacts == ()


def test_a_wide_joint_between_two_parts_is_seen_once():
    """Twice back and forth: the first sample of contact is reported, once."""
    m = hinge(("eye", "pin"))
    turn = (np.pi / 4) * (1 - np.cos(np.linspace(0, 4 * np.pi, 1001)))[:, None]
    ((sample, *_),) = clearance(m, link_poses(m, turn)).contacts
    assert sample == min(k for k in range(0, 1001, 5) if _touches(turn[k, 0]))


def test_a_contact_is_found_after_another_part_was_near():
    """The motion begins far from the drawn pose, and the rod has passed a post, which it does not touch."""
    m = hinge(("eye", "pin"))
    base, arm = m.bodies
    post = box("post", [0.05, 0.02, -0.003], [0.06, 0.03, 0.003])
    eye, stop = base.meshes
    m = mechanism([Body("base", (eye, post, stop)), arm], list(m.joints), {"base": np.eye(4), "arm": np.eye(4)})
    turn = np.linspace(1.2, np.pi / 2, 501)[:, None]
    ((sample, *parts),) = clearance(m, link_poses(m, turn)).contacts
    assert set(parts) == {"rod", "stop"}
    assert sample == min(k for k in range(0, 501, 5) if _touches(turn[k, 0]))


@pytest.mark.slow
def test_sils_keeps_its_distance_on_the_way_in(sils_model):
    """Bars 1 and 2 pass each other closest; centre lines 15.6 mm apart at insertion, each 10 mm thick."""
    q = np.linspace(*(sils_model.mechanism.posture(n) for n in ("home", "insertion")), 40)
    found = clearance(sils_model.mechanism, sils_model.link_poses(sils_model.run(q).x))
    assert found.contacts == ()
    assert found.distance.min() > 0.05 * MM
    assert found.distance[0] > found.distance.min()
