"""Plans between random configurations of four robots in their scenes, judged by exact geometry.

The judge shares no test of distances and no choice of pairs with the planner. Its poses are those of the reference
model, by Pinocchio, which the planner uses for the rest pose only; its pairs are all pairs of bodies, of the CAD and
of the scene, that no joint connects and that do not touch when drawn; coal computes every distance between their
triangles. It looks at 400 moments, equally spaced in time, of each timed path, and at the one that the certificate
names, then more closely around the nearest; at 50 for bodies that are always close. Boxes and hulls only leave out
pairs that cannot be the nearest. Start and goal are drawn by seed within the limits of the joints; all but one pair in
20 are drawn again until the straight path between them is not free. SILS has no scene: a cube stands in the way of its
tool.

Each plan is one line of a file, so that a run that was ended goes on where it was:

    python tests/benchmarks/plans.py FILE [plans per robot [robot ...]]
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
from scipy.spatial import ConvexHull

import twin
from twin.api.scene_obstacles import obstacles_in_base
from twin.cad.build import read_props
from twin.core import assets, spatial
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.model.body import Body, Mesh
from twin.model.scene import load_scene
from twin.planning.obstacle_avoidance import around
from twin.planning.path import line
from twin.planning.timing import time_path
from twin.reference import ReferenceModel
from twin.reference.collision_pairs import Obstacle
from twin.reference.joint_space import JointSpace

CLEARANCE, CUBE, MOMENTS, INNER, TOUCH = 2 * MM, 50 * MM, 400, 50, 0.01 * MM
ROBOTS = {"raven_left": ("dome", 0.6), "pa10": ("vsrs", 1.0), "davinci_psm": ("davinci", 0.4), "sils": (None, 0.4)}
"""Robot -> (scene, width of the box around the rest pose from which ends are drawn, relative to the joint ranges)."""


class Judge:
    """Exact distances of a robot among obstacles (name, body, T_base_body); `touching` pairs are left out."""

    def __init__(self, mechanism, obstacles, touching):
        self.model = ReferenceModel(mechanism)
        home = self.model.home().link_poses
        own = [b.name for b in mechanism.bodies if b.meshes]
        self.still = {name: T for name, _, T in obstacles}
        self.shapes = {b.name: shape(b) for b in mechanism.bodies if b.meshes} | {n: shape(b) for n, b, _ in obstacles}
        jointed = {frozenset((j.parent, j.child)) for j in mechanism.joints}
        self.pairs = [(a, n) for a in own for n in self.still if (a, n) not in touching]
        self.inner = []  # pairs that the certificate does not include
        for a, b in combinations(own, 2):
            drawn = distance(self.shapes[a], home[a], self.shapes[b], home[b])
            if frozenset((a, b)) not in jointed and drawn > TOUCH:
                (self.pairs if drawn >= 2 * CLEARANCE else self.inner).append((a, b))
        base = {b for b in own if self._at_rest(b)}
        self.pairs = [p for p in self.pairs if not (p[0] in base and (p[1] in self.still or p[1] in base))]

    def _at_rest(self, body):
        q = self.model.home().q
        low, high = self.model.mechanism.limits.T
        other = np.clip(q + 0.01 * (high - low), low, high)
        return np.allclose(self.poses(np.array([q, other]))[body][0], self.poses(np.array([q, other]))[body][1])

    def poses(self, q):
        return self.model.link_poses(self.model.run(q, self.model.home()).x)

    def least(self, path, s):
        """Return the smallest distances in m on a path q(s), looked for at s (k,): (certificate's pairs, all others).

        Around the nearest moment, others are tried, three times more closely each.
        """
        best, k = self.closest(path(s), self.pairs)
        inner = self.closest(path(s[:: len(s) // INNER]), self.inner)[0]
        for _ in range(3):
            s_near = np.linspace(s[max(k - 1, 0)], s[min(k + 1, len(s) - 1)], 21)
            found, k = self.closest(path(s_near), self.pairs)
            best, s = min(best, found), s_near
        return best, inner

    def closest(self, q, pairs):
        """Return (smallest distance in m of pairs along q (k, n), its row)."""
        links = self.poses(q) | {n: np.repeat(T[None], len(q), axis=0) for n, T in self.still.items()}
        span = {}
        for name in {n for pair in pairs for n in pair}:
            T = links[name]
            corners = self.shapes[name][2] @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
            span[name] = corners.min(axis=1), corners.max(axis=1)
        gaps = np.array(
            [
                np.linalg.norm(np.maximum(np.maximum(span[a][0] - span[b][1], span[b][0] - span[a][1]), 0), axis=1)
                for a, b in pairs
            ]
        ).reshape(len(pairs), len(q))
        best, row = np.inf, 0
        for flat in np.argsort(gaps, axis=None, kind="stable"):
            pair, k = np.unravel_index(flat, gaps.shape)
            if gaps[pair, k] >= best:
                break
            a, b = pairs[pair]
            at = self.shapes[a], links[a][k], self.shapes[b], links[b][k]
            if distance(*at, which=1) < best + 1e-5 and (found := distance(*at)) < best:
                best, row = found, int(k)
        return best, row


def shape(body):
    """Return (triangles, convex hull) of a body for coal, and the corners (8, 3) of its box."""
    parts, points, triangles = list(body.meshes), [], []
    for mesh in parts:
        triangles.append(mesh.triangles + sum(len(p) for p in points))
        points.append(mesh.vertices)
    points, triangles = np.concatenate(points), np.concatenate(triangles)
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(triangles), len(points))
    surface.addVertices(points)
    surface.addTriangles(triangles.astype(np.int64))
    surface.endModel()
    outer = points[ConvexHull(points).vertices]
    hull = coal.BVHModelOBBRSS()
    hull.beginModel(0, len(outer))
    hull.addVertices(outer)
    hull.endModel()
    hull.buildConvexHull(True, "Qt")
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    return surface, hull.convex, corners


def distance(a, Ta, b, Tb, which=0):
    """Return the distance in m of two shapes at poses (4, 4): of their triangles, or (which=1) of their hulls."""
    places = [coal.Transform3s(np.ascontiguousarray(T[:3, :3]), T[:3, 3]) for T in (Ta, Tb)]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return max(0.0, float(coal.distance(a[which], places[0], b[which], places[1], request, result)))


def obstacles(scene, name):
    """Return obstacles (name, body, T_base_body) of a scene, and the pairs (own body, obstacle) that may touch."""
    read = load_scene(assets.scene_file(scene))
    own = next(p for p in read.places if p.robot == name)
    groups = [(p.name, twin.load(p.robot).mechanism, p.T_world_base) for p in read.places if p is not own]
    if read.props is not None:
        props = read_props(read.props)
        groups.append((props.name, props, np.eye(4)))
    out, touching = [], set()
    for group, mechanism, T_world in groups:
        links = ReferenceModel(mechanism).home().link_poses
        for body in mechanism.bodies:
            full = f"{group}/{body.name}"
            if body.meshes:
                out.append((full, body, np.linalg.inv(own.T_world_base) @ T_world @ links[body.name]))
            met = [x.split("/", 1) for pair in read.touching if full in pair for x in pair - {full}]
            touching |= {(inner, full) for owner, inner in met if owner == own.name}
    return out, touching


def cube(p):
    """Return a cube in the way of a tool at p (3,)."""
    corners = CUBE / 2 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    hull = ConvexHull(corners)
    mesh = Mesh("cube", corners, hull.simplices.astype(np.int32))
    return "room/cube", Body("cube", (mesh,)), spatial.pose(p=p)


class Problem:
    """Pairs of ends of one robot, each with the space in which the path is planned and its judge."""

    def __init__(self, name):
        self.robot, (self.scene, self.part) = twin.load(name), ROBOTS[name]
        self.name, self.mechanism = name, self.robot.mechanism
        self.model = ReferenceModel(self.mechanism)
        self.room, self.touching = obstacles(self.scene, name) if self.scene else ([], set())
        stills = obstacles_in_base(self.scene, name, twin.load) if self.scene else []
        self.space = JointSpace(lambda: self.model, CLEARANCE, around=lambda: stills)
        self.judge = Judge(self.mechanism, self.room, self.touching)

    def ends(self, number):
        """Return (space, judge, start, goal, whether the straight path is free) of plan `number`."""
        rng, (low, high) = np.random.default_rng(number), self.space.limits.T
        home = self.model.home().q
        while True:
            q = np.clip(home + rng.uniform(-self.part / 2, self.part / 2, (16, len(low))) * (high - low), low, high)
            q = q[self.space.free(q)][:2]
            if len(q) < 2:
                continue
            space, judge = self.space, self.judge
            if self.scene is None:
                way = space._closing.along(
                    lambda s, q=q: q[0] + s[:, None] * (q[1] - q[0]),
                    space._state(q[0]),
                    np.linspace(0, 1, 33),
                    lambda: None,
                )
                if way is None:
                    continue
                block = cube(self.model.collect(way).Ts_base_tool[16, :3, 3])
                still = Obstacle(block[0], block[1], block[2])
                space = JointSpace(lambda: self.model, CLEARANCE, around=lambda s=still: [s])
                if not space.free(q).all():
                    continue
                judge = Judge(self.mechanism, [block], set())
            straight = space.free_along(line(*q))
            if not straight or number % 20 == 0:
                return space, judge, *q, straight


def one(problem, number):
    """Return what came of one plan, as a dictionary."""
    space, judge, start, goal, straight = problem.ends(number)
    row, began = {"robot": problem.name, "plan": number, "straight": bool(straight)}, time.process_time()
    try:
        path = around(space, start, goal, seed=number)
    except TwinError as error:
        text = str(error)
        reason = "an end seems to be enclosed" if "enclosed" in text else "no path found"
        return row | {"failed": reason, "text": text, "seconds": time.process_time() - began}
    row["seconds"] = time.process_time() - began
    joints = problem.mechanism.active
    speed = np.array([j.max_speed or (0.8 if j.is_angle else 0.06) for j in joints])
    timing = time_path(path, speed, np.array([j.max_acceleration or 3 * v for j, v in zip(joints, speed, strict=True)]))
    row["timed"] = time.process_time() - began
    seen = space.certify(path)
    row["certified"] = time.process_time() - began - row["timed"]
    s = np.union1d(timing.s[np.linspace(0, len(timing.s) - 1, MOMENTS).astype(int)], seen.s)
    least, inner = judge.least(path, s)
    return row | {
        "duration": timing.duration,
        "proven": seen.proven / MM,
        "found": seen.found / MM,
        "least": least / MM,
        "inner": inner / MM,
    }


def report(rows):
    """Print one line for each robot, and one for all."""
    for name in [*dict.fromkeys(r["robot"] for r in rows), None]:
        here = [r for r in rows if name in (None, r["robot"])]
        good = [r for r in here if "failed" not in r]
        off = np.array([r["least"] - r["proven"] for r in good])
        hits = sum(min(r["least"], r["inner"]) <= 0 for r in good)
        failed = Counter(r["failed"] for r in here if "failed" in r)
        print(
            f"{name or 'all':12s} {len(here)} plans, {sum(r['straight'] for r in here)} straight, {len(good)} paths, "
            f"{hits} collisions; certificate above the exact minimum {(off < -1e-6).sum()} times, below it by "
            f"{off.min(initial=np.inf):.3f} to {off.max(initial=-np.inf):.3f} mm, by more than 1 mm {(off > 1).sum()} "
            f"times; smallest distance {min((r['least'] for r in good), default=np.nan):.2f} mm; median "
            f"{np.median([r['seconds'] for r in here]):.2f} s a plan; failed: {dict(failed) or 'none'}",
            flush=True,
        )


def main(file: str, count: int, *robots: str) -> None:
    """Plan until `count` plans of each robot (default: all) are in the file; robots in turns."""
    kept = Path(file)
    rows = [json.loads(text) for text in kept.read_text().splitlines()] if kept.exists() else []
    done = {(r["robot"], r["plan"]) for r in rows}
    problems = {}
    for number in range(count):
        for name in robots or ROBOTS:
            if (name, number) in done:
                continue
            if name not in problems:
                problems[name] = Problem(name)
            rows.append(one(problems[name], number))
            with kept.open("a") as out:
                out.write(json.dumps(rows[-1]) + "\n")
        if number % 10 == 9:
            report(rows)
    report(rows)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 250, *sys.argv[3:])
