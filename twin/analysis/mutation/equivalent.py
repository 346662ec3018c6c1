"""Decide, independently of the validator, whether a missed fault has any effect.

Two formulas are equivalent if all their values agree at random poses near the motion. Two mechanisms are equivalent if
their limits, their meshes, and the poses of the tool and of every body with meshes agree; these poses are computed with
plain matrices, and SciPy closes the loops. Two stages are equivalent if the texts of the flattened stages agree.
"""

from __future__ import annotations

from operator import attrgetter
from pathlib import Path

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics
from twin.model.joint import FREE_AXES, Joint
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.planning.trajectory import Trajectory

_LIMITS = attrgetter("limits", "cone", "max_speed", "max_acceleration", "max_jerk")
_POSES = 200
_AROUND = (30 * MM, 15 * DEG)
_SAME = 1e-12
"""Relative difference below which values of two formulas count as equal."""

_PLACE = 1e-9
"""Difference of pose entries (m for positions) below which two body poses count as equal."""


def same_equations(a: Kinematics, b: Kinematics, trajectory: Trajectory, rng: np.random.Generator) -> str:
    """Return the reason why two formulas are equivalent; "" if they are not."""
    rows = rng.integers(len(trajectory.t), size=_POSES)
    shift = rng.uniform(-1, 1, (_POSES, 3)) * _AROUND[0]
    turn = spatial.exp_so3(rng.uniform(-1, 1, (_POSES, 3)) * _AROUND[1])
    Ts = trajectory.Ts_base_tool[rows] @ spatial.pose(turn, shift)
    q = trajectory.q[rows] * (1 + rng.uniform(-0.02, 0.02, trajectory.q[rows].shape))
    count = 0
    with np.errstate(all="ignore"):
        for one, two in zip(_answers(a, Ts, q), _answers(b, Ts, q), strict=True):
            if one.shape != two.shape or not np.array_equal(np.isfinite(one), np.isfinite(two)):
                return ""
            good = np.isfinite(one)
            if good.any() and np.abs(one[good] - two[good]).max() > _SAME * (1 + np.abs(one[good]).max()):
                return ""
            count += int(good.sum())
    return f"{count} numbers at {_POSES} poses are equal" if count else ""


def _answers(kin: Kinematics, Ts: Array, q: Array):
    if kin.closed_inverse:
        yield kin.inverse_many(Ts)
    if kin.closed_forward:
        yield kin.forward_many(q)
    state = {"Ts": Ts} if kin.closed_inverse else {"qs": q}
    for group in (kin.points_many(**state), kin.passive_many(**state)):
        yield from group.values()


class Chain:
    """Kinematics of a mechanism from plain matrices: body poses along the tree, and loop closure by least squares."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.active = {j.name: i for i, j in enumerate(mechanism.active)}
        self.free: list[tuple[Joint, int]] = [
            (j, axis) for j in mechanism.tree if j.name not in self.active for axis in FREE_AXES[j.type]
        ]
        self.index = {}
        for k, (j, axis) in enumerate(self.free):
            self.index.setdefault(j.name, []).append((axis, k))
        self.balls = {j.name: self._rest(j)[:3, :3] for j in mechanism.tree if j.type in ("spherical", "free")}
        self.start = np.array([self._start(j, axis) for j, axis in self.free])

    def _rest(self, joint: Joint) -> Array:
        rest = self.mechanism.rest
        return joint.relative(rest[joint.parent], rest[joint.child])

    def _start(self, joint: Joint, axis: int) -> float:
        T = self._rest(joint)
        if axis < 3:
            return float(T[axis, 3])
        if joint.name in self.balls:
            return 0.0
        return float(spatial.angle_about_z(T))

    def bodies(self, q: Array, x: Array) -> dict[str, Array]:
        """Return T_base_body (4, 4) of every body, from active joints q (n,) and all other tree coordinates x."""
        out = {self.mechanism.base: np.eye(4)}
        for joint in self.mechanism.tree:
            p, w = np.zeros(3), np.zeros(3)
            pairs = self.index.get(joint.name, [])
            values = [(axis, float(x[k])) for axis, k in pairs]
            if joint.name in self.active:
                values = [(FREE_AXES[joint.type][0], float(q[self.active[joint.name]]))]
            for axis, value in values:
                (p if axis < 3 else w)[axis % 3] = value
            motion = spatial.pose(self.balls.get(joint.name, np.eye(3)) @ spatial.exp_so3(w), p)
            out[joint.child] = out[joint.parent] @ joint.T_parent_joint @ motion @ spatial.inverse(joint.T_child_joint)
        return out

    def gaps(self, q: Array, x: Array) -> Array:
        """Return the components of all loop gaps in m; a rotation of 1 rad counts as 0.1 m."""
        T = self.bodies(q, x)
        out = []
        for joint in self.mechanism.loops:
            M = joint.relative(T[joint.parent], T[joint.child])
            locked = set(range(6)) - set(FREE_AXES[joint.type])
            if joint.type in ("revolute", "cylindrical"):  # only the axes must be parallel
                turn = np.cross(M[:3, 2], [0, 0, 1])
            else:
                turn = spatial.log_so3(M[:3, :3])
            e = np.concatenate([M[:3, 3], 0.1 * turn])
            out += [e[i] for i in sorted(locked)]
        single = {name: axes[0][1] for name, axes in self.index.items()}
        for c in self.mechanism.couplings:
            total = sum(
                r * (float(q[self.active[n]]) if n in self.active else float(x[single[n]]))
                for n, r in zip(c.joints, c.ratios, strict=True)
            )
            out.append(0.1 * (total - c.total))
        return np.array(out)

    def close(self, q: Array, x: Array) -> Array:
        """Return the tree coordinates with the smallest loop gaps, found by least squares from x."""
        from scipy.optimize import least_squares

        if not len(x) or not len(self.gaps(q, x)):
            return x
        return least_squares(lambda y: self.gaps(q, y), x, xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def same_motion(a: Mechanism, b: Mechanism, trajectory: Trajectory, places: int = 5) -> str:
    """Return the reason why limits, meshes and body poses of two mechanisms are equivalent; "" if they are not."""
    for one, two in zip(a.joints, b.joints, strict=True):
        if _LIMITS(one) != _LIMITS(two):
            return ""
    for one, two in zip(a.bodies, b.bodies, strict=True):
        for p, r in zip(one.meshes, two.meshes, strict=True):
            if not (np.array_equal(p.vertices, r.vertices) and np.array_equal(p.triangles, r.triangles)):
                return ""
    seen = [x.name for x in a.bodies if x.meshes] + [a.frame(a.tool).body]
    chains = [Chain(m) for m in (a, b)]
    states = [c.start for c in chains]
    worst = 0.0
    for k in np.linspace(0, len(trajectory.t) - 1, places).astype(int):
        states = [c.close(trajectory.q[k], x) for c, x in zip(chains, states, strict=True)]
        one, two = (c.bodies(trajectory.q[k], x) for c, x in zip(chains, states, strict=True))
        worst = max([worst, *(float(np.abs(one[n] - two[n]).max()) for n in seen)])
        if worst > _PLACE:
            return ""
    return f"every body has the same pose at {places} times, within {worst:.1g} m"


def same_samples(a: Trajectory, b: Trajectory) -> str:
    """Return the reason why two trajectories are equivalent; "" if they are not."""
    if a.phases is not b.phases:
        return ""
    arrays = [(v, getattr(b, n)) for n, v in vars(a).items() if isinstance(v, np.ndarray)]
    if any(x.shape != y.shape for x, y in arrays):
        return ""
    off = max(float(np.nanmax(np.abs(x - y), initial=0.0)) for x, y in arrays)
    return f"all numbers of all samples agree within {off:.1g}" if off <= _SAME else ""


def same_stage(a: Path, b: Path) -> str:
    """Return the reason why two stages are equivalent; "" if they are not."""
    from pxr import Usd

    one, two = (Usd.Stage.Open(str(p)).Flatten(addSourceFileComment=False).ExportToString() for p in (a, b))
    return "the flattened stages have the same text" if one == two else ""


def same_protocol(a: Protocol, b: Protocol) -> str:
    """Return the reason why two protocols are equivalent; "" if they are not."""
    one, two = ({p.name: p.value for p in x.parameters()} for x in (a, b))
    return "all numbers of the protocol are the same" if one == two and a.phases == b.phases else ""
