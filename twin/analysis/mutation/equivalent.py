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

_limits_of = attrgetter("limits", "cone", "max_speed", "max_acceleration", "max_jerk")
"""Function that returns what of a joint has no effect on poses."""

_COMPARED_POSES = 200
"""Number of random poses at which two formulas are compared."""

_LARGEST_Q_CHANGE = 0.02
"""Largest relative change of a joint value of the motion, for equations that start from joints."""

_LARGEST_SHIFT = 30 * MM
"""Largest shift along each axis of random poses from poses of the motion."""

_LARGEST_TURN = 15 * DEG
"""Largest rotation about each axis of random poses from poses of the motion."""

_LEVER = 0.1
"""Length in m by which a rotation counts as a distance, so that the gaps of all loops have one unit."""

_TURN_X = 3
"""Number of the rotation about x among the axes of a joint, which are shifts first."""

_SAME_VALUE = 1e-12
"""Relative difference below which values of two formulas count as equal."""

_SAME_POSE = 1e-9
"""Difference of pose entries (m for positions) below which two body poses count as equal."""


def same_equations(kin: Kinematics, kin_faulty: Kinematics, trajectory: Trajectory, rng: np.random.Generator) -> str:
    """Return the reason why two formulas are equivalent; "" if they are not."""
    rows = rng.integers(len(trajectory.t), size=_COMPARED_POSES)
    shifts = rng.uniform(-1, 1, (_COMPARED_POSES, 3)) * _LARGEST_SHIFT
    turns = spatial.exp_so3(rng.uniform(-1, 1, (_COMPARED_POSES, 3)) * _LARGEST_TURN)
    Ts = trajectory.Ts_base_tool[rows] @ spatial.pose(turns, shifts)
    q_planned = trajectory.q[rows]
    q = q_planned * (1 + rng.uniform(-_LARGEST_Q_CHANGE, _LARGEST_Q_CHANGE, q_planned.shape))
    count = 0
    with np.errstate(all="ignore"):
        for values, values_faulty in zip(_values(kin, Ts, q), _values(kin_faulty, Ts, q), strict=True):
            finite = np.isfinite(values)
            finite_faulty = np.isfinite(values_faulty)
            # a pose that only one of two formulas can reach is an effect, although no number differs
            if values.shape != values_faulty.shape or not np.array_equal(finite, finite_faulty):
                return ""
            if finite.any():
                difference = np.abs(values[finite] - values_faulty[finite]).max()
                size = np.abs(values[finite]).max()
                if difference > _SAME_VALUE * (1 + size):
                    return ""
            count += int(finite.sum())
    if not count:  # nothing was compared, which proves nothing
        return ""
    return f"{count} numbers at {_COMPARED_POSES} poses are equal"


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


class MatrixKinematics:
    """Kinematics of a mechanism from plain matrices: body poses along the tree, and loop closure by least squares."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        # {active joint: its index in q}
        self.active: dict[str, int] = {}
        for i, active_joint in enumerate(mechanism.active):
            self.active[active_joint.name] = i
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
        """Return the pose (4, 4) of a joint's child frame in its parent frame, in the rest poses."""
        rest_poses = self.mechanism.rest
        return joint.relative(rest_poses[joint.parent], rest_poses[joint.child])

    def _start(self, joint: Joint, axis: int) -> float:
        """Return the coordinate of a joint along or about one of its axes in the rest poses, in m or rad."""
        T = self._rest(joint)
        if axis < _TURN_X:
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
            R_rest = self.balls.get(joint.name, np.eye(3))
            motion = spatial.pose(R_rest @ spatial.exp_so3(coordinates[_TURN_X:]), coordinates[:_TURN_X])
            T_base_joint = poses[joint.parent] @ joint.T_parent_joint @ motion
            poses[joint.child] = T_base_joint @ spatial.inverse(joint.T_child_joint)
        return poses

    def gaps(self, q: Array, x: Array) -> Array:
        """Return the components of all loop gaps in m; a rotation counts as a distance at `_LEVER`."""
        poses = self.bodies(q, x)
        gaps = []
        for joint in self.mechanism.loops:
            T_gap = joint.relative(poses[joint.parent], poses[joint.child])
            if joint.type in ("revolute", "cylindrical"):  # only the axes must be parallel
                turn = np.cross(T_gap[:3, 2], [0, 0, 1])
            else:
                turn = spatial.log_so3(T_gap[:3, :3])
            gap = np.concatenate([T_gap[:3, 3], _LEVER * turn])
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
        return least_squares(lambda x_tried: self.gaps(q, x_tried), x, xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def same_motion(mechanism: Mechanism, mechanism_faulty: Mechanism, trajectory: Trajectory, places: int = 5) -> str:
    """Return the reason why limits, meshes and body poses of two mechanisms are equivalent; "" if they are not."""
    if not _same_limits_and_meshes(mechanism, mechanism_faulty):
        return ""
    visible = []
    for body in mechanism.bodies:
        if body.meshes:
            visible.append(body.name)
    # the tool counts also without a mesh, because the protocol moves it
    visible.append(mechanism.frame(mechanism.tool).body)
    kinematics = MatrixKinematics(mechanism)
    kinematics_faulty = MatrixKinematics(mechanism_faulty)
    x = kinematics.start
    x_faulty = kinematics_faulty.start
    worst = 0.0
    for sample in np.linspace(0, len(trajectory.t) - 1, places).astype(int):
        q = trajectory.q[sample]
        # Each closure starts at the state before, so that both mechanisms stay in one assembly.
        x = kinematics.close(q, x)
        x_faulty = kinematics_faulty.close(q, x_faulty)
        poses = kinematics.bodies(q, x)
        poses_faulty = kinematics_faulty.bodies(q, x_faulty)
        for name in visible:
            difference = float(np.abs(poses[name] - poses_faulty[name]).max())
            if not difference <= _SAME_POSE:  # also if it is NaN: a body without a pose is an effect
                return ""
            worst = max(worst, difference)
    return f"every body has the same pose at {places} times, within {worst:.1g} m"


def _same_limits_and_meshes(mechanism: Mechanism, mechanism_faulty: Mechanism) -> bool:
    """Return whether limits of joints and meshes of bodies, which have no effect on poses, are the same."""
    for joint, joint_faulty in zip(mechanism.joints, mechanism_faulty.joints, strict=True):
        if _limits_of(joint) != _limits_of(joint_faulty):
            return False
    for body, body_faulty in zip(mechanism.bodies, mechanism_faulty.bodies, strict=True):
        for mesh, mesh_faulty in zip(body.meshes, body_faulty.meshes, strict=True):
            if not np.array_equal(mesh.vertices, mesh_faulty.vertices):
                return False
            if not np.array_equal(mesh.triangles, mesh_faulty.triangles):
                return False
    return True


def same_samples(trajectory: Trajectory, trajectory_faulty: Trajectory) -> str:
    """Return the reason why two trajectories are equivalent; "" if they are not."""
    if trajectory.phases is not trajectory_faulty.phases:
        return ""
    worst = 0.0
    for name, values in vars(trajectory).items():
        if not isinstance(values, np.ndarray):
            continue
        values_faulty = getattr(trajectory_faulty, name)
        if values.shape != values_faulty.shape:
            return ""
        # a value that only one of both has, such as a distance from an RCM, is an effect, although no number differs
        if not np.array_equal(np.isnan(values), np.isnan(values_faulty)):
            return ""
        worst = max(worst, float(np.nanmax(np.abs(values - values_faulty), initial=0.0)))
    if worst > _SAME_VALUE:
        return ""
    return f"all numbers of all samples agree within {worst:.1g}"


def same_stage(stage: Path, stage_faulty: Path) -> str:
    """Return the reason why two stages are equivalent; "" if they are not."""
    if _flattened(stage) != _flattened(stage_faulty):
        return ""
    return "the flattened stages have the same text"


def _flattened(root: Path) -> str:
    """Return the text of a stage with all its layers in one."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(root))
    # without the comment, which contains the path of the file
    return stage.Flatten(addSourceFileComment=False).ExportToString()


def same_protocol(protocol: Protocol, protocol_faulty: Protocol) -> str:
    """Return the reason why two protocols are equivalent; "" if they are not."""
    has_same_numbers = _numbers(protocol) == _numbers(protocol_faulty)
    if not has_same_numbers or protocol.phases != protocol_faulty.phases:
        return ""
    return "all numbers of the protocol are the same"


def _numbers(protocol: Protocol) -> dict[str, float]:
    """Return {name of a number of a protocol: its value}."""
    numbers = {}
    for parameter in protocol.parameters():
        numbers[parameter.name] = parameter.value
    return numbers
