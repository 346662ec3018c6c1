"""Rows of joint values and tool poses against a robot: measured poses, or poses that equations compute.

Base and tool frames are always fitted, because whoever measures chooses them: T_row = X T(q) Y. What remains is
compared with the noise: that which the table states or, for a chain, what remains with every joint free (all zeros and
all places of joints). Stated noise must explain the whole remainder, and also the part that free joints would take from
it. If the remainder is larger, the fewest signs, zeros and places of joints that reduce it to the noise are searched;
they make another side of the table (`identified`), whose joint lines are compared with the robot's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.comparison.fewest_changes import fewest_changes
from twin.comparison.row_columns import joint_values, require_common_range, without_followers
from twin.comparison.row_fit import LEVER, RowFit, RowState, base_and_tool
from twin.comparison.row_noise import RowNoise
from twin.comparison.side import JointGroup, PoseRows, RobotSide, joint_motion
from twin.comparison.tool_motion import ChainMotion, FixedMotion, columns_of
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_NEEDED_DEVIATIONS = 4.0
"""A fitted number that is smaller than this multiple of its standard deviation is not needed."""

_SMALLEST_CLOSED_SHARE = 0.5
"""Smallest share of the rows at which the loops of a robot must close."""


@dataclass(frozen=True)
class PoseFit:
    """What rows of poses say about a robot.

    Attributes:
        rows: number of rows.
        base, tool: (4, 4) fitted frames: T_row = base T_base_tool(q) tool.
        rotations: whether rotations were compared.
        noise: (standard deviation of a coordinate in m, of an angle in rad); None without an estimate.
        stated: whether the table states the noise; else it is estimated from the rows.
        computed: whether the rows are computed by equations, so that they have no noise.
        distance, angle: largest remainder in m and rad after the fit of both frames.
        line: line of the table with the largest remainder; 0 for computed rows.
        agrees: whether the remainder is within the tolerance or the noise.
        uncertainty: largest standard deviation of the changes that explain the rows, in m; 0 without changes.
    """

    rows: int
    base: Array
    tool: Array
    rotations: bool
    noise: tuple[float, float] | None
    stated: bool
    computed: bool
    distance: float
    angle: float
    line: int
    agrees: bool
    uncertainty: float = 0.0

    def as_dict(self) -> JsonObject:
        """Return the fit as plain data, lengths in mm and angles in degrees."""
        noise = None
        if self.noise is not None:
            noise = {"length_mm": self.noise[0] / MM, "angle_deg": self.noise[1] / DEG, "stated": self.stated}
        return {
            "rows": self.rows,
            "computed": self.computed,
            "rotations": self.rotations,
            "base": self.base.tolist(),
            "tool": self.tool.tolist(),
            "noise": noise,
            "largest_mm": self.distance / MM,
            "largest_deg": self.angle / DEG,
            "line": self.line,
            "agrees": self.agrees,
            "uncertainty_mm": self.uncertainty / MM,
        }


@dataclass(frozen=True)
class PoseComparison:
    """The fit, the row (joints of the robot's side) with the largest remainder, and the side that the rows describe.

    `identified` is None if the robot has loops, or if no few changes explain the rows.
    """

    fit: PoseFit
    q: dict[str, float]
    identified: RobotSide | None
    tolerance: float


def compare_rows(rows: PoseRows, label: str, side: RobotSide, tolerance: float) -> PoseComparison:
    """Compare rows of poses with a robot.

    Args:
        rows: the rows.
        label: how the user named their side.
        side: the robot.
        tolerance: largest distance in m that is no difference.

    Raises:
        TwinError: the joints cannot be matched, or no row is in the range of the robot's joints.
    """
    rows = without_followers(rows, label, side)
    q = joint_values(rows, label, side)
    require_common_range(rows, q, label, side)
    motion: FixedMotion | ChainMotion
    if side.tool_poses is None:
        motion = ChainMotion(side, q)
    else:
        T = side.tool_poses(q)
        closed = np.asarray(np.isfinite(T).all(axis=(1, 2)))
        if closed.mean() < _SMALLEST_CLOSED_SHARE:
            text = f"{side.label}: its loops close at only {int(closed.sum())} of the {len(T)} states of {label}"
            raise TwinError(f"{text}. Correct the joint values, or the links of the loops")
        # at the others, the robot has no pose to compare
        rows = rows.selected(closed)
        q = q[closed]
        motion = FixedMotion(T[closed])
    return _comparison_of_motion(rows, label, side, q, motion, tolerance)


def _comparison_of_motion(
    rows: PoseRows, label: str, side: RobotSide, q: Array, motion: FixedMotion | ChainMotion, tolerance: float
) -> PoseComparison:
    """Return the comparison of rows with the motion of the robot at their joint values q (k, driven joints)."""
    fit = RowFit(rows, motion)
    noise = RowNoise(fit, tolerance)
    signs = np.ones(motion.count)
    frames_alone = fit.frames_alone(signs)
    shifts, turns = fit.shifts_and_turns(frames_alone.x, signs, ())
    distances = np.linalg.norm(shifts, axis=1)
    angles = np.linalg.norm(turns, axis=1)
    worst = int(np.argmax(distances + LEVER * angles))
    saturated: RowState | None = None
    saturation = noise.saturated(frames_alone)
    if saturation is not None:
        # where the rows show their noise, the frames are fitted once more, with its weight of angles
        noise, frames_alone, saturated = saturation
    base, tool = base_and_tool(frames_alone.x)
    deviations = noise.standard_deviations(saturated)
    agrees = noise.agrees(frames_alone, saturated)
    explained = None
    if not agrees and saturated is not None and isinstance(motion, ChainMotion):
        explained, saturated = fewest_changes(noise, motion, frames_alone, saturated)
        deviations = noise.standard_deviations(saturated)
    pose_fit = PoseFit(
        rows=len(rows.q),
        base=base,
        tool=tool,
        rotations=rows.rotations,
        noise=deviations,
        stated=noise.stated,
        computed=rows.computed,
        distance=float(distances[worst]),
        angle=float(angles[worst]),
        line=rows.lines[worst] if rows.lines else 0,
        agrees=agrees,
    )
    q_worst = dict(zip(side.driven_joints, q[worst].tolist(), strict=True))
    if explained is None or saturated is None or not isinstance(motion, ChainMotion):
        return PoseComparison(pose_fit, q_worst, None, tolerance)
    uncertainty = _largest_uncertainty(motion, explained, noise.uncertainties(explained, saturated))
    pose_fit = replace(pose_fit, uncertainty=uncertainty)
    identified = _identified_side(motion, explained, label)
    # no place is known better than the noise of the rows allows
    return PoseComparison(pose_fit, q_worst, identified, max(tolerance, _NEEDED_DEVIATIONS * uncertainty))


def _largest_uncertainty(motion: ChainMotion, state: RowState, uncertainties: Array) -> float:
    """Return the largest of the standard deviations (unknowns,) of the changed values in m, angles by their lever."""
    largest = 0.0
    for change, columns in columns_of(state.changes):
        values = uncertainties[columns]
        if change.kind == "zero":
            is_angle = motion.path[change.joint].is_angle
            unit = LEVER if is_angle else 1.0
            largest = max(largest, float(values[0]) * unit)
            continue
        largest = max(largest, LEVER * float(values[:3].max()), float(values[3:].max()))
    return largest


def _identified_side(motion: ChainMotion, state: RowState, label: str) -> RobotSide:
    """Return the side that the rows describe: the robot's side with the fitted signs, zeros and places."""
    side = motion.side
    zeros: dict[str, float] = {}
    places: dict[str, Array] = {}
    for change, columns in columns_of(state.changes):
        name = motion.path[change.joint].name
        if change.kind == "zero":
            zeros[name] = float(state.x[columns.start])
        else:
            places[name] = motion.place_motion(change.joint, state.x[columns])
    names_on_path = [axis.name for axis in motion.path]
    signs = dict(zip(names_on_path, state.signs.tolist(), strict=True))
    moves: dict[int, Array] = {0: np.eye(4)}  # {group: its motion by the changes of all joints before it}
    axes = []
    for axis in side.tree:
        W_joint = moves[axis.parent]
        if axis.name in places:
            W_joint = W_joint @ places[axis.name]
        sign = signs.get(axis.name, 1.0)
        zero = zeros.get(axis.name, 0.0)
        point = W_joint[:3, :3] @ axis.point + W_joint[:3, 3]
        direction = sign * (W_joint[:3, :3] @ axis.direction)
        # rows of poses state neither limits nor speeds
        axes.append(replace(axis, point=point, direction=direction, limits=None, max_speed=None))
        moves[axis.child] = W_joint @ joint_motion(axis, np.array([zero]))[0]
    frames = {}
    for name, (group, T) in side.frames.items():
        frames[name] = (group, moves[group] @ T)
    # rows of poses say nothing about masses
    groups = [JointGroup(group.bodies) for group in side.groups]
    return replace(
        side,
        label=label,
        axes=tuple(axes),
        groups=tuple(groups),
        frames=frames,
        path=None,
        text=None,
        xacro_places={},
        dh_rows=(),
        efforts={},
    )
