"""A planar arm of boxes among posts, and its exact distances, computed without code of `twin`."""

from __future__ import annotations

from itertools import combinations

import coal
import numpy as np

from made.mechanisms import box
from twin.core import spatial
from twin.core.units import MM
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel, distance_bounds
from twin.reference.collision_pairs import Obstacle
from twin.reference.joint_space import JointSpace

CLEARANCE = 5 * MM
DENSE = np.linspace(0.0, 1.0, 1001)

LINK, SIZE = 0.2, np.array([0.18, 0.03, 0.03])


def arm(count=3):
    """Return a planar arm: a chain of boxes whose joints turn about z."""
    bodies = [Body("base")]
    joints = []
    for i in range(count):
        bodies.append(Body(f"link{i}", (box(f"box{i}", [LINK / 2, 0, 0], SIZE),)))
        at = spatial.pose(p=[LINK if i else 0.0, 0, 0])
        joints.append(Joint(f"q{i}", "revolute", bodies[-2].name, f"link{i}", at, active=True, limits=(-2.6, 2.6)))
    tool = Frame("tool", bodies[-1].name, spatial.pose(p=[LINK, 0, 0]))
    rest = {b.name: spatial.pose(p=[LINK * max(i - 1, 0), 0, 0]) for i, b in enumerate(bodies)}
    return Mechanism("arm", "base", tuple(bodies), tuple(joints), (tool,), rest=rest)


def post(x, y, size=0.06, touches=frozenset()):
    """Return a square post at (x, y) in m as an obstacle."""
    return Obstacle(
        "room/post", Body("post", (box("post", [0, 0, 0], [size, size, 0.2]),)), spatial.pose(p=[x, y, 0]), touches
    )


def coarse_grids(monkeypatch):
    """Let grids have a tenth of their nodes, and keep none: a full one takes seconds where none is kept on disk."""
    monkeypatch.setattr(distance_bounds, "_GRID_NODES", 40_000)
    monkeypatch.setattr(distance_bounds, "_cached_arrays", lambda kind, triangles, make: make())


def space_of(mechanism, *stills, clearance=CLEARANCE, **more):
    return JointSpace(lambda: ReferenceModel(mechanism), clearance, around=lambda: stills, **more)


def clearances(q, stills):
    """Return the minimum distance (k,) in m at joint values q (k, n) in rad, by trigonometry and coal's boxes."""
    ends = np.cumsum(q, axis=1)
    out = []
    for angles in ends:
        start, boxes = np.zeros(3), []
        for a in angles:
            along = np.array([np.cos(a), np.sin(a), 0.0])
            R = np.array([[along[0], -along[1], 0], [along[1], along[0], 0], [0, 0, 1.0]])
            boxes.append((coal.Box(*SIZE), coal.Transform3s(R, start + LINK / 2 * along)))
            start = start + LINK * along
        others = [(coal.Box(*np.ptp(s.body.meshes[0].vertices, axis=0)), s.T_base_body) for s in stills]
        posts = [(b, coal.Transform3s(T[:3, :3], T[:3, 3])) for b, T in others]
        pairs = [*((boxes[i], boxes[j]) for i, j in combinations(range(len(boxes)), 2) if j > i + 1)]
        pairs += [(b, p) for b in boxes for p in posts]
        out.append(min(coal.distance(*a, *b, coal.DistanceRequest(), coal.DistanceResult()) for a, b in pairs))
    return np.array(out)
