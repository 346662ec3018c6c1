"""Compute the readings of a robot: pose, limits, trocar errors, loop gap, singularities, error of the equations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics
from twin.reference.states import Assembly
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.trocars import InTrocar, in_trocars


class EquationDeviation(NamedTuple):
    """Difference between equations and mechanism in the quantity `what`; `size` is in rad if `is_angle`, else in m."""

    size: float
    what: str
    is_angle: bool = False


LIVE_TOLERANCE = 1e-6
"""Largest difference in m or rad that counts as agreement; larger differences are shown in red. Reports have
smaller limits."""

_ASSEMBLY_MODES_DIFFER = "not comparable: different assembly modes"
_BEYOND_EQUATIONS = "not comparable: beyond the reach of the equations"
"""The values of `RobotReading.incomparable`."""


@dataclass(frozen=True)
class JointReading:
    """Value of a joint between its limits `low` and `high`, in `unit` (mm or °)."""

    joint: str
    value: float
    unit: str
    low: float
    high: float

    @property
    def part(self) -> float | None:
        """Position of the value between the lower limit (0) and the upper limit (1); None without limits."""
        width = self.high - self.low
        if not np.isfinite(width) or width <= 0:
            return None
        return float((self.value - self.low) / width)


@dataclass(frozen=True)
class RobotReading:
    """The readings of a robot at one state.

    Attributes:
        coordinates: (name, value, unit mm or °) of the tool, in the convention of the equations.
        limits: value and limits of each active joint.
        gap: largest loop gap in m.
        branch: label of the assembly mode, computed by the equations; "" without equations.
        condition: condition number of the Jacobian, with rotations scaled by the characteristic length; infinite at a
            singularity; None without equations.
        singular: (name, "type1" or "type2", ratio) of each singularity measure. The ratio is the measure's absolute
            value divided by its alarm value; at a ratio of at most 1, the robot is too near to a singularity.
        trocars: the instruments in their trocars, or the instrument at the RCM of a protocol.
        residual: largest difference between equations and mechanism; None without equations.
        incomparable: why equations and mechanism cannot be compared at this state; "" if they can. If they are in
            different assembly modes, `residual` compares the present tool pose with the tool pose of the mechanism at
            the joint values that the equations compute, in the assembly mode of the equations.
        points: named points (3,) in m in the base frame, computed by the equations.
        actual: the same points (3,) in m in the base frame, computed by the mechanism.
        reason: why the last request was refused; "" if it was not.
    """

    coordinates: tuple[tuple[str, float, str], ...]
    limits: tuple[JointReading, ...]
    gap: float
    branch: str = ""
    condition: float | None = None
    singular: tuple[tuple[str, str, float], ...] = ()
    trocars: tuple[InTrocar, ...] = ()
    residual: EquationDeviation | None = None
    incomparable: str = ""
    points: dict[str, Array] = field(default_factory=dict)
    actual: dict[str, Array] = field(default_factory=dict)
    reason: str = ""

    @property
    def depth(self) -> float | None:
        """Insertion depth in m: distance from the trocar to the tip of the instrument; None without a trocar."""
        for trocar in self.trocars:
            if trocar.depth is not None:
                return trocar.depth
        return None

    @property
    def rcm_error(self) -> float | None:
        """Largest trocar error in m; None without a trocar."""
        return max((trocar.error for trocar in self.trocars), default=None)

    @property
    def comparable(self) -> bool:
        """Whether equations and mechanism can be compared: both are in the same assembly mode and reach the pose."""
        return not self.incomparable

    @property
    def agrees(self) -> bool:
        """Whether equations and mechanism agree within `LIVE_TOLERANCE` at the present pose; True without equations.

        If they are not `comparable`, only what can be compared counts; see `incomparable`.
        """
        return self.residual is None or self.residual.size <= LIVE_TOLERANCE


def read(movable: MovableRobot, rcm: Array | None = None) -> RobotReading:
    """Return the readings at the robot's state; without trocars, `rcm` (3,) is the RCM in m in the base frame."""
    with movable.lock:
        kin = movable.kin
        assembly = movable.assembly
        requested = movable.requested_pose
        joints = movable.joints
        # a move that continues has not failed
        reason = "" if movable.last_move.more else movable.last_move.reason
        trocars = in_trocars(movable, rcm)
    T = assembly.T_base_tool
    limits = []
    for joint, value in zip(joints, assembly.q, strict=True):
        scale, unit = _display(joint.is_angle)
        low, high = joint.limits or (-np.inf, np.inf)
        limits.append(JointReading(joint.name, float(value) / scale, unit, low / scale, high / scale))
    if kin is None:
        coordinates = _pose_coordinates(T)
        return RobotReading(coordinates, tuple(limits), assembly.worst_gap, trocars=trocars, reason=reason)
    if kin.closed_inverse:
        states = {"Ts": T[None]}
    else:
        states = {"qs": assembly.q[None]}
    points = {}
    actual = {}
    # a redundant arm has no unique posture for a tool pose, so points cannot be compared
    if not movable.model.redundant:
        for name, positions in kin.points_many(**states).items():
            points[name] = positions[0]
            if name in assembly.points:
                actual[name] = assembly.points[name]
    residual, incomparable = _residual(movable, assembly, points, actual, requested)
    if incomparable:
        points = {}
        actual = {}
    return RobotReading(
        coordinates=_formula_coordinates(kin, T),
        limits=tuple(limits),
        gap=assembly.worst_gap,
        branch=str(kin.branch(**states)[0]),
        condition=_condition(kin, T, assembly.q),
        singular=_singularities(kin, states),
        trocars=trocars,
        residual=residual,
        incomparable=incomparable,
        points=points,
        actual=actual,
        reason=reason,
    )


def _display(is_angle: bool) -> tuple[float, str]:
    """Return the displayed unit of a length or an angle: its size in m or rad, and its sign."""
    if is_angle:
        return DEG, "°"
    return MM, "mm"


def _pose_coordinates(T: Array) -> tuple[tuple[str, float, str], ...]:
    """Return (name, value, unit) of position and rotation vector of a pose (4, 4)."""
    coordinates = []
    for name, length in zip("xyz", T[:3, 3] / MM, strict=True):
        coordinates.append((name, float(length), "mm"))
    rotation = spatial.log_so3(T[:3, :3])
    for name, angle in zip(("rx", "ry", "rz"), rotation / DEG, strict=True):
        coordinates.append((name, float(angle), "°"))
    return tuple(coordinates)


def _formula_coordinates(kin: Kinematics, T: Array) -> tuple[tuple[str, float, str], ...]:
    """Return (name, value, unit) of a tool pose (4, 4) in the convention of the equations."""
    convention = kin.formula.coordinates
    values = kin.program.coordinates_of_pose.one(T.ravel())
    coordinates = []
    for name, unit, value in zip(convention.names, convention.units, values, strict=True):
        scale, sign = _display(unit != "m")
        coordinates.append((name, float(value) / scale, sign))
    return tuple(coordinates)


def _condition(kin: Kinematics, T: Array, q: Array) -> float:
    """Return the condition number of the Jacobian at tool pose T (4, 4) or joints q (n,); infinite at a singularity."""
    try:
        if kin.closed_inverse:
            return kin.condition(T=T)
        return kin.condition(q=q)
    except (KinematicsError, np.linalg.LinAlgError):
        return float("inf")


def _singularities(kin: Kinematics, states: dict[str, Array]) -> tuple[tuple[str, str, float], ...]:
    """Return (name, kind, ratio to the alarm value) of each singularity measure, the smallest ratio first."""
    values = kin.singularity(**states)
    ratios = []
    for measure in kin.formula.measures:
        ratio = abs(float(values[measure.name][0])) / measure.alarm
        ratios.append((measure.name, measure.kind, ratio))
    ratios.sort(key=lambda item: item[2])
    return tuple(ratios)


def _residual(
    movable: MovableRobot,
    assembly: Assembly,
    points: dict[str, Array],
    actual: dict[str, Array],
    requested: Array | None,
) -> tuple[EquationDeviation, str]:
    """Return (residual, incomparable), the values of these attributes of `RobotReading`.

    Joint values, named points and tool are compared. The same tool pose may be reached in several assembly modes.
    Equations for one mode cannot be compared with a mechanism in another mode. Such equations are nevertheless correct
    if the mechanism, moved to the joint values that they compute, has the same tool pose. This is tested only if the
    equations are for the assembly mode of the home state: from the home tool pose, the equations must compute the home
    joint values.
    """
    kin = movable.kin
    assert kin is not None
    q = assembly.q
    T = assembly.T_base_tool
    to_request = _request_errors(requested, T)
    errors = _point_errors(points, actual)
    if movable.model.redundant:
        if kin.closed_forward:
            distance = float(np.linalg.norm(kin.forward(q)[:3, 3] - T[:3, 3]))
            errors.append(EquationDeviation(distance, "tool at these joints"))
        return _largest(errors + to_request), ""
    try:
        q_equations = kin.inverse(T, q)
    except KinematicsError:
        # without joint values, the named points may still be compared
        if any(np.isfinite(error.size) for error in errors):
            return _largest(errors + to_request), ""
        return _largest(to_request), _BEYOND_EQUATIONS
    errors.append(_joint_error(movable, q_equations, q))
    if _largest(errors).size > LIVE_TOLERANCE and _agree_at_home(movable):
        nearest = _nearest_mode(movable, assembly, q_equations)
        if nearest is not None and nearest.size <= LIVE_TOLERANCE:
            return _largest([nearest, *to_request]), _ASSEMBLY_MODES_DIFFER
        if not _has_value(kin, q):
            return _largest(to_request), _BEYOND_EQUATIONS
    return _largest(errors + to_request), ""


def _nearest_mode(movable: MovableRobot, assembly: Assembly, q: Array) -> EquationDeviation | None:
    """Return the smallest tool error of the assembly modes of the mechanism at q (n,); None if it cannot be closed."""
    nearest: EquationDeviation | None = None
    for T_tool in movable.solver.tools(assembly, q):
        error = _pose_error(T_tool, assembly.T_base_tool)
        if nearest is None or error.size < nearest.size:
            nearest = error
    return nearest


def _request_errors(requested: Array | None, T: Array) -> list[EquationDeviation]:
    """Return the distance and the angle from the tool pose T (4, 4) to the requested one; nothing without a request."""
    if requested is None:
        return []
    distance, angle = spatial.pose_difference(requested, T)
    return [EquationDeviation(distance, "tool"), EquationDeviation(angle, "tool rotation", True)]


def _point_errors(points: dict[str, Array], actual: dict[str, Array]) -> list[EquationDeviation]:
    """Return the distances of the points of the equations that have a value from those of the mechanism."""
    errors = []
    for name, position in actual.items():
        if np.isfinite(points[name]).all():
            distance = float(np.linalg.norm(points[name] - position))
            errors.append(EquationDeviation(distance, f"point {name}"))
    return errors


def _has_value(kin: Kinematics, q: Array) -> bool:
    """Return whether the forward equations have a solution at q (n,); True without forward equations."""
    try:
        if not kin.closed_forward:
            return True
        return bool(np.isfinite(kin.forward(q)).all())
    except KinematicsError:
        return False


def _largest(errors: list[EquationDeviation]) -> EquationDeviation:
    """Return the largest finite error, the first of equal ones; m and rad are compared as numbers."""
    finite = [error for error in errors if np.isfinite(error.size)]
    return max(finite, key=lambda error: error.size, default=EquationDeviation(0.0, ""))


def _joint_error(movable: MovableRobot, q_equations: Array, q: Array) -> EquationDeviation:
    """Return the largest difference between joint values q_equations (n,) and q (n,); angles modulo full turns."""
    is_angle = np.array([joint.is_angle for joint in movable.joints], bool)
    difference = q_equations - q
    wrapped = (difference + np.pi) % (2 * np.pi) - np.pi
    difference = np.where(is_angle, wrapped, difference)
    k = int(np.argmax(np.abs(difference)))
    return EquationDeviation(float(abs(difference[k])), f"joint {movable.joints[k].name}", bool(is_angle[k]))


def _pose_error(A: Array, B: Array) -> EquationDeviation:
    """Return the larger of distance in m and angle in rad between two poses (4, 4)."""
    distance, angle = spatial.pose_difference(A, B)
    what = "tool at the equations' joints"
    if angle > distance:
        return EquationDeviation(angle, what, True)
    return EquationDeviation(distance, what)


def _agree_at_home(movable: MovableRobot) -> bool:
    """Return whether the inverse equations compute the home joint values from the home tool pose."""
    home = movable.model.home()
    assert movable.kin is not None
    try:
        q_equations = movable.kin.inverse(home.T_base_tool, home.q)
    except KinematicsError:
        return False
    return _joint_error(movable, q_equations, home.q).size <= LIVE_TOLERANCE
