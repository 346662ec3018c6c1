"""Plans between random configurations of several robots in their scenes: is any in collision, is its certificate true?

Start and goal are drawn by seed, free of collisions, within the limits of the joints. The planner is that of
`twin plan --avoid`. Each path is judged by coal alone at 200 configurations; the proven clearance must not be above the
smallest distance found there. Robots with closed loops are planned between configurations near each other, because each
state is solved.

    python tests/benchmarks/plans.py [plans per robot [robot ...]]
"""

from __future__ import annotations

import sys
import time

import coal
import numpy as np

import twin
from twin.api.standing import standing
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.planning.around import around
from twin.reference.following import Follower
from twin.reference.space import JointSpace

CLEARANCE = 2 * MM
ROBOTS = {"raven_left": ("dome", 1.0), "pa10": ("vsrs", 1.0), "davinci_psm": ("davinci", 0.3), "sils": (None, 0.15)}
"""Robot -> (scene, largest distance of start and goal as a fraction of the range of each joint)."""


def exact(space, X):
    """Return the smallest distance in m at configurations X (k, nq) of all pairs of the space, by coal alone."""
    pairs, least = space._pairs, np.inf
    which = np.flatnonzero(pairs.required >= space.clearance)
    for poses in pairs.poses(X):
        for pair in which:
            rows = pairs.rows[pair]
            places = [coal.Transform3s(np.ascontiguousarray(poses[i][:3, :3]), poses[i][:3, 3]) for i in rows]
            a, b = (pairs.shapes[i] for i in rows)
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            if coal.distance(a.hull, places[0], b.hull, places[1], request, result) < least:
                request, result = coal.DistanceRequest(), coal.DistanceResult()
                found = coal.distance(a.model, places[0], b.model, places[1], request, result)
                least = min(least, max(found, 0.0))
    return least


def along(space, path, count=200):
    """Return configurations (count, nq) along a path."""
    return space._at(space._stations(path), np.linspace(0.0, 1.0, count))


def main(count: int, *robots: str) -> None:
    """Print one line for each robot (default: all), and one for each plan without a path, with its reason."""
    for name in robots or ROBOTS:
        scene, part = ROBOTS[name]
        follower = Follower(twin.load(name).reference)
        stills = (lambda s=scene, n=name: standing(s, n, twin.load)) if scene else tuple
        space = JointSpace(lambda f=follower: f.model, CLEARANCE, around=stills)
        home, rng, rows, refused, began = follower.model.home().q, np.random.default_rng(0), [], 0, time.process_time()
        low, high = space.limits.T
        while len(rows) + refused < count:
            ends = []
            while len(ends) < 2:
                middle = ends[0] if ends else home if part < 1 else (low + high) / 2
                q = np.clip(middle + rng.uniform(-part / 2, part / 2, len(low)) * (high - low), low, high)
                ends += [q] if space.free(q[None])[0] else []
            try:
                path = around(space, *ends, seed=len(rows))
            except TwinError as error:
                refused += 1
                print(f"  {name}, plan {len(rows) + refused}: {error}", flush=True)
                continue
            proven, least = space.certify(path).proven, exact(space, along(space, path))
            rows.append((proven / MM, least / MM, np.ptp(path(np.linspace(0, 1, 3), 1), axis=0).max() > 1e-9))
        a = np.array(rows, float).reshape(-1, 3)
        off = a[:, 1] - a[:, 0]
        print(
            f"{name:12s} {len(a)} plans ({int(a[:, 2].sum())} not straight), {refused} without a path, "
            f"{(a[:, 1] <= 0).sum()} collisions, certificate above the exact minimum {(off < 0).sum()} times, "
            f"below it by {off.min(initial=np.inf):.3f} to {off.max(initial=0):.3f} mm; smallest distance "
            f"{a[:, 1].min(initial=np.inf):.2f} mm; {(time.process_time() - began) / count:.2f} s a plan",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 250, *sys.argv[2:])
