"""Decide, independently of the validator, whether a missed fault has any effect.

Two formulas are equivalent if all their values agree at random poses near the motion. Two mechanisms are equivalent if
their limits, their meshes, and the poses of the tool and of every body with meshes agree; these poses are computed with
plain matrices, and SciPy closes the loops. Two stages are equivalent if the texts of the flattened stages agree.
"""

from __future__ import annotations

from collections.abc import Iterator
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
_SHIFT = 30 * MM
_TURN = 15 * DEG
"""Largest shift and rotation, along and about each axis, of random poses from poses of the motion."""

_LEVER = 0.1
"""Length in m by which a rotation counts as a distance, so that the gaps of all loops have one unit."""

_SAME = 1e-12
"""Relative difference below which values of two formulas count as equal."""

_PLACE = 1e-9
"""Difference of pose entries (m for positions) below which two body poses count as equal."""


def same_equations(a: Kinematics, b: Kinematics, trajectory: Trajectory, rng: np.random.Generator) -> str:
    """Return the reason why two formulas are equivalent; "" if they are not."""
    rows = rng.integers(len(trajectory.t), size=_POSES)
    shifts = rng.uniform(-1, 1, (_POSES, 3)) * _SHIFT
    turns = spatial.exp_so3(rng.uniform(-1, 1, (_POSES, 3)) * _TURN)
    Ts = trajectory.Ts_base_tool[rows] @ spatial.pose(turns, shifts)
    planned = trajectory.q[rows]
    q = planned * (1 + rng.uniform(-0.02, 0.02, planned.shape))
    count = 0
    with np.errstate(all="ignore"):
        for one, two in zip(_values(a, Ts, q), _values(b, Ts, q), strict=True):
            finite = np.isfinite(one)
            if one.shape != two.shape or not np.array_equal(finite, np.isfinite(two)):
                return ""
            if finite.any():
                difference = np.abs(one[finite] - two[finite]).max()
                size = np.abs(one[finite]).max()
                if difference > _SAME * (1 + size):
                    return ""
            count += int(finite.sum())
    if not count:
        return ""
    return f"{count} numbers at {_POSES} poses are equal"


def _values(kin: Kinematics, Ts: Array, q: Array) -> Iterator[Array]:
    """Yield all values of a formula at poses (k, 4, 4), or at joint values q (k, n) without an inverse."""
    if kin.closed_inverse:
        yield kin.inverse_many(Ts)
    if kin.closed_forward:
        yield kin.forward_many(q)
    state = {"Ts": Ts} if kin.closed_inverse else {"qs": q}
    points = kin.points_many(**state)
    passive = kin.passive_many(**state)
    yield from points.values()
    yield from passive.values()


class Chain:
    """Kinematics of a mechanism from plain matrices: body poses along the tree, and loop closure by least squares."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.active = {joint.name: i for i, joint in enumerate(mechanism.active)}
        # {passive joint: (free axis, index in x) of each of its coordinates}
        self.index: dict[str, list[tuple[int, int]]] = {}
        # {ball joint: its rotation at rest, from which its three coordinates are measured}
        self.balls: dict[str, Array] = {}
        start = []
        for joint in mechanism.tree:
            if joint.type in ("spherical", "free"):
                self.balls[joint.name] = self._rest(joint)[:3, :3]
            if joint.name in self.active:
                continue
            for axis in FREE_AXES[joint.type]:
                self.index.setdefault(joint.name, []).append((axis, len(start)))
                start.append(self._start(joint, axis))
        self.start = np.array(start)

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
        poses = {self.mechanism.base: np.eye(4)}
        for joint in self.mechanism.tree:
            # shift along the axes 0 to 2, then rotation about the axes 3 to 5
            coordinates = np.zeros(6)
            if joint.name in self.active:
                coordinates[FREE_AXES[joint.type][0]] = q[self.active[joint.name]]
            else:
                for axis, k in self.index.get(joint.name, []):
                    coordinates[axis] = x[k]
            rest = self.balls.get(joint.name, np.eye(3))
            motion = spatial.pose(rest @ spatial.exp_so3(coordinates[3:]), coordinates[:3])
            T_base_joint = poses[joint.parent] @ joint.T_parent_joint @ motion
            poses[joint.child] = T_base_joint @ spatial.inverse(joint.T_child_joint)
        return poses

    def gaps(self, q: Array, x: Array) -> Array:
        """Return the components of all loop gaps in m; a rotation counts as a distance at `_LEVER`."""
        poses = self.bodies(q, x)
        gaps = []
        for joint in self.mechanism.loops:
            M = joint.relative(poses[joint.parent], poses[joint.child])
            if joint.type in ("revolute", "cylindrical"):  # only the axes must be parallel
                turn = np.cross(M[:3, 2], [0, 0, 1])
            else:
                turn = spatial.log_so3(M[:3, :3])
            gap = np.concatenate([M[:3, 3], _LEVER * turn])
            for axis in range(6):
                if axis not in FREE_AXES[joint.type]:
                    gaps.append(gap[axis])
        for coupling in self.mechanism.couplings:
            total = 0.0
            for name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
                total += ratio * self._coordinate(name, q, x)
            gaps.append(_LEVER * (total - coupling.total))
        return np.array(gaps)

    def _coordinate(self, name: str, q: Array, x: Array) -> float:
        """Return the coordinate of a joint with one free axis."""
        if name in self.active:
            return float(q[self.active[name]])
        _, k = self.index[name][0]
        return float(x[k])

    def close(self, q: Array, x: Array) -> Array:
        """Return the tree coordinates with the smallest loop gaps, found by least squares from x."""
        from scipy.optimize import least_squares

        if not len(x) or not len(self.gaps(q, x)):
            return x
        return least_squares(lambda y: self.gaps(q, y), x, xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def same_motion(a: Mechanism, b: Mechanism, trajectory: Trajectory, places: int = 5) -> str:
    """Return the reason why limits, meshes and body poses of two mechanisms are equivalent; "" if they are not."""
    if not _same_limits_and_meshes(a, b):
        return ""
    visible = [body.name for body in a.bodies if body.meshes]
    visible.append(a.frame(a.tool).body)
    chain_a = Chain(a)
    chain_b = Chain(b)
    state_a = chain_a.start
    state_b = chain_b.start
    worst = 0.0
    for k in np.linspace(0, len(trajectory.t) - 1, places).astype(int):
        q = trajectory.q[k]
        # Each closure starts at the state before, so that both mechanisms stay in one assembly.
        state_a = chain_a.close(q, state_a)
        state_b = chain_b.close(q, state_b)
        poses_a = chain_a.bodies(q, state_a)
        poses_b = chain_b.bodies(q, state_b)
        for name in visible:
            difference = float(np.abs(poses_a[name] - poses_b[name]).max())
            worst = max(worst, difference)
        if worst > _PLACE:
            return ""
    return f"every body has the same pose at {places} times, within {worst:.1g} m"


def _same_limits_and_meshes(a: Mechanism, b: Mechanism) -> bool:
    """Return whether limits of joints and meshes of bodies, which have no effect on poses, are the same."""
    for joint_a, joint_b in zip(a.joints, b.joints, strict=True):
        if _LIMITS(joint_a) != _LIMITS(joint_b):
            return False
    for body_a, body_b in zip(a.bodies, b.bodies, strict=True):
        for mesh_a, mesh_b in zip(body_a.meshes, body_b.meshes, strict=True):
            if not np.array_equal(mesh_a.vertices, mesh_b.vertices):
                return False
            if not np.array_equal(mesh_a.triangles, mesh_b.triangles):
                return False
    return True


def same_samples(a: Trajectory, b: Trajectory) -> str:
    """Return the reason why two trajectories are equivalent; "" if they are not."""
    if a.phases is not b.phases:
        return ""
    worst = 0.0
    for name, values_a in vars(a).items():
        if not isinstance(values_a, np.ndarray):
            continue
        values_b = getattr(b, name)
        if values_a.shape != values_b.shape:
            return ""
        worst = max(worst, float(np.nanmax(np.abs(values_a - values_b), initial=0.0)))
    if worst > _SAME:
        return ""
    return f"all numbers of all samples agree within {worst:.1g}"


def same_stage(a: Path, b: Path) -> str:
    """Return the reason why two stages are equivalent; "" if they are not."""
    if _flattened(a) != _flattened(b):
        return ""
    return "the flattened stages have the same text"


def _flattened(root: Path) -> str:
    """Return the text of a stage with all its layers in one."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(root))
    # without the comment, which contains the path of the file
    return stage.Flatten(addSourceFileComment=False).ExportToString()


def same_protocol(a: Protocol, b: Protocol) -> str:
    """Return the reason why two protocols are equivalent; "" if they are not."""
    numbers_a = {parameter.name: parameter.value for parameter in a.parameters()}
    numbers_b = {parameter.name: parameter.value for parameter in b.parameters()}
    if numbers_a != numbers_b or a.phases != b.phases:
        return ""
    return "all numbers of the protocol are the same"
