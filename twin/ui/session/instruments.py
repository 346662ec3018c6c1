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
from twin.ui.session.desk import Desk
from twin.ui.session.trocars import InTrocar, in_trocars


class EquationError(NamedTuple):
    """Difference between equations and mechanism in the quantity `what`; `size` is in rad if `is_angle`, else in m."""

    size: float
    what: str
    is_angle: bool = False


AGREE = 1e-6
"""Largest difference in m or rad that counts as agreement; larger differences are shown in red. Reports have
smaller limits."""

OTHER = "not comparable: different assembly modes"
BEYOND = "not comparable: beyond the reach of the equations"


@dataclass(frozen=True)
class Limit:
    """Value and limits of a joint, in `unit` (mm or °)."""

    joint: str
    value: float
    unit: str
    low: float
    high: float

    @property
    def part(self) -> float | None:
        """Position of the value between the lower limit (0) and the upper limit (1); None without limits."""
        width = self.high - self.low
        return float((self.value - self.low) / width) if np.isfinite(width) and width > 0 else None


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
        scope: why equations and mechanism cannot be compared at this state; "" if they can. If they are in different
            assembly modes, `residual` compares the present tool pose with the tool pose of the mechanism at the joint
            values that the equations compute, in the assembly mode of the equations.
        points: named points (3,) in m in the base frame, computed by the equations.
        actual: the same points (3,) in m in the base frame, computed by the mechanism.
        reason: why the last request was refused; "" if it was not.
    """

    coordinates: tuple[tuple[str, float, str], ...]
    limits: tuple[Limit, ...]
    gap: float
    branch: str = ""
    condition: float | None = None
    singular: tuple[tuple[str, str, float], ...] = ()
    trocars: tuple[InTrocar, ...] = ()
    residual: EquationError | None = None
    scope: str = ""
    points: dict[str, Array] = field(default_factory=dict)
    actual: dict[str, Array] = field(default_factory=dict)
    reason: str = ""

    @property
    def depth(self) -> float | None:
        """Insertion depth in m: distance from the trocar to the tip of the instrument; None without a trocar."""
        return next((t.depth for t in self.trocars if t.depth is not None), None)

    @property
    def rcm_error(self) -> float | None:
        """Largest trocar error in m; None without a trocar."""
        return max((t.error for t in self.trocars), default=None)

    @property
    def comparable(self) -> bool:
        """Whether equations and mechanism can be compared: both are in the same assembly mode and reach the pose."""
        return not self.scope

    @property
    def agrees(self) -> bool:
        """Whether equations and mechanism agree within `AGREE` at the present pose."""
        return self.residual is None or self.residual.size <= AGREE


def read(desk: Desk, rcm: Array | None = None) -> RobotReading:
    """Return the readings at the desk's state; without trocars, `rcm` (3,) is the RCM in m in the base frame."""
    with desk.lock:
        kin, now, T = desk.kin, desk.assembly, desk.assembly.T_base_tool
        asked, joints = desk.asked, desk.joints
        reason = "" if desk.moved.more else desk.moved.reason
        trocars = in_trocars(desk, rcm)
    limits = []
    for joint, value in zip(joints, now.q, strict=True):
        unit, scale = ("°", DEG) if joint.is_angle else ("mm", MM)
        low, high = joint.limits or (-np.inf, np.inf)
        limits.append(Limit(joint.name, float(value) / scale, unit, low / scale, high / scale))
    if kin is None:
        p, R = T[:3, 3], T[:3, :3]
        turn = spatial.log_so3(R)
        rows = [*zip("xyz", p / MM, ("mm",) * 3, strict=True)]
        rows += [*zip(("rx", "ry", "rz"), turn / DEG, ("°",) * 3, strict=True)]
        coordinates = tuple((n, float(v), u) for n, v, u in rows)
        return RobotReading(coordinates, tuple(limits), now.worst_gap, trocars=trocars, reason=reason)
    values = kin.program.coordinates_of_pose.one(T.ravel())
    coordinates = tuple(
        (name, float(v) / (MM if unit == "m" else DEG), "mm" if unit == "m" else "°")
        for name, unit, v in zip(kin.formula.coordinates.names, kin.formula.coordinates.units, values, strict=True)
    )
    where = {"Ts": T[None]} if kin.closed_inverse else {"qs": now.q[None]}
    measures = kin.singularity(**where)
    singular = tuple((m.name, m.kind, abs(float(measures[m.name][0])) / m.alarm) for m in kin.formula.measures)
    try:
        condition = kin.condition(**({"T": T} if kin.closed_inverse else {"q": now.q}))
    except (KinematicsError, np.linalg.LinAlgError):
        condition = float("inf")
    points = {n: p[0] for n, p in kin.points_many(**where).items()}
    actual = {n: now.points[n] for n in points if n in now.points}
    if desk.model.redundant:  # a redundant arm has no unique posture for a tool pose, so points cannot be compared
        points = actual = {}
    residual, scope = _residual(desk, now, points, actual, asked)
    if scope:
        points = actual = {}
    return RobotReading(
        coordinates,
        tuple(limits),
        now.worst_gap,
        str(kin.branch(**where)[0]),
        condition,
        tuple(sorted(singular, key=lambda s: s[2])),
        trocars,
        residual,
        scope,
        points,
        actual,
        reason,
    )


def _residual(
    desk: Desk, now: Assembly, points: dict[str, Array], actual: dict[str, Array], asked: Array | None
) -> tuple[EquationError, str]:
    """Return (residual, scope), the values of these attributes of `RobotReading`.

    Joint values, named points and tool are compared. The same tool pose may be reached in several assembly modes.
    Equations for one mode cannot be compared with a mechanism in another mode. Such equations are nevertheless correct
    if the mechanism, moved to the joint values that they compute, has the same tool pose. This is tested only if the
    equations are for the assembly mode of the home state: from the home tool pose, the equations must compute the home
    joint values.
    """
    kin, q, T = desk.kin, now.q, now.T_base_tool
    assert kin is not None
    of_pose: list[EquationError] = []
    if asked is not None:
        of_pose.append(EquationError(float(np.linalg.norm(asked[:3, 3] - T[:3, 3])), "tool"))
        of_pose.append(EquationError(float(spatial.rotation_angle(asked[:3, :3].T @ T[:3, :3])), "tool rotation", True))
    found = [
        EquationError(float(np.linalg.norm(points[n] - p)), f"point {n}")
        for n, p in actual.items()
        if np.isfinite(points[n]).all()
    ]
    if desk.model.redundant:
        if kin.closed_forward:
            there = kin.forward(q)
            found.append(EquationError(float(np.linalg.norm(there[:3, 3] - T[:3, 3])), "tool at these joints"))
        return _largest(found + of_pose), ""
    try:
        theirs = kin.inverse(T, q)
    except KinematicsError:
        return _largest(found + of_pose), ""
    found.append(_joints_apart(desk, theirs, q))
    if _largest(found).size > AGREE and _agree_as_drawn(desk):
        away = min((_poses_apart(A, T) for A in desk.solver.tools(now, theirs)), key=lambda r: r.size, default=None)
        if away is not None and away.size <= AGREE:
            return _largest([away, *of_pose]), OTHER
        if not _has_value(kin, q):
            return _largest(of_pose), BEYOND
    return _largest(found + of_pose), ""


def _has_value(kin: Kinematics, q: Array) -> bool:
    """Return whether the forward equations have a solution at q (n,); True without forward equations."""
    try:
        return not kin.closed_forward or bool(np.isfinite(kin.forward(q)).all())
    except KinematicsError:
        return False


def _largest(found: list[EquationError]) -> EquationError:
    return max((f for f in found if np.isfinite(f.size)), key=lambda f: f.size, default=EquationError(0.0, ""))


def _joints_apart(desk: Desk, theirs: Array, q: Array) -> EquationError:
    """Return the largest difference between the joint values `theirs` (n,) and q (n,); angles modulo full turns."""
    angle = np.array([j.is_angle for j in desk.joints], bool)
    apart = np.where(angle, (theirs - q + np.pi) % (2 * np.pi) - np.pi, theirs - q)
    k = int(np.argmax(np.abs(apart)))
    return EquationError(float(abs(apart[k])), f"joint {desk.joints[k].name}", bool(angle[k]))


def _poses_apart(A: Array, B: Array) -> EquationError:
    way, turn = float(np.linalg.norm(A[:3, 3] - B[:3, 3])), float(spatial.rotation_angle(A[:3, :3].T @ B[:3, :3]))
    what = "tool at the equations' joints"
    return EquationError(turn, what, True) if turn > way else EquationError(way, what)


def _agree_as_drawn(desk: Desk) -> bool:
    """Return whether the inverse equations compute the home joint values from the home tool pose."""
    home = desk.model.home()
    assert desk.kin is not None
    try:
        return _joints_apart(desk, desk.kin.inverse(home.T_base_tool, home.q), home.q).size <= AGREE
    except KinematicsError:
        return False
