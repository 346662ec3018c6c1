"""What the instruments read of a desk: pose, limits, RCM, loops, singularities, equations against mechanism."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin import spatial
from twin.errors import KinematicsError
from twin.live.desk import Desk
from twin.spatial import Array
from twin.units import DEG, MM

AGREE = 1e-6
"""Difference of equations and mechanism in m or rad above which the readout turns red; the report is far stricter."""


@dataclass(frozen=True)
class Limit:
    """A joint between its limits: value in mm or deg, and where it stands, 0 at the lower and 1 at the upper."""

    joint: str
    value: float
    unit: str
    low: float
    high: float

    @property
    def part(self) -> float | None:
        """Fraction of the range, or None without limits."""
        width = self.high - self.low
        return float((self.value - self.low) / width) if np.isfinite(width) and width > 0 else None


@dataclass(frozen=True)
class Reading:
    """One look at the robot.

    Attributes:
        coordinates: the tool in the convention of the equations: name, value, unit (mm or °).
        limits: of each active joint.
        gap: largest loop gap in m.
        branch: label of the assembly by the equations; empty without.
        condition: of the Jacobian, rotations scaled by the characteristic length; infinite at a singularity.
        singular: name, kind (type1, type2), value over alarm; 1 and below is too near.
        depth, rcm_error: m; None without an RCM.
        residual: largest difference of equations and mechanism in m (or rad), and of what.
        points: (k, 3) named points of the equations, in base; `actual` where the mechanism has them.
        reason: why the last request was refused.
    """

    coordinates: tuple[tuple[str, float, str], ...]
    limits: tuple[Limit, ...]
    gap: float
    branch: str = ""
    condition: float | None = None
    singular: tuple[tuple[str, str, float], ...] = ()
    depth: float | None = None
    rcm_error: float | None = None
    residual: tuple[float, str] | None = None
    points: dict[str, Array] = field(default_factory=dict)
    actual: dict[str, Array] = field(default_factory=dict)
    reason: str = ""

    @property
    def agrees(self) -> bool:
        """Whether equations and mechanism agree here, as far as the eye can tell."""
        return self.residual is None or self.residual[0] <= AGREE


def read(desk: Desk, rcm: Array | None = None) -> Reading:
    """Read all instruments; `rcm` (3,) in base if one is registered, which a mechanism's own trocar overrides."""
    with desk.lock:
        kin, now, T = desk.kin, desk.assembly, desk.assembly.T_base_tool
        asked, joints = desk.asked, desk.joints
        reason = desk.moved.reason
    limits = []
    for joint, value in zip(joints, now.q, strict=True):
        unit, scale = ("°", DEG) if joint.is_angle else ("mm", MM)
        low, high = joint.limits or (-np.inf, np.inf)
        limits.append(Limit(joint.name, float(value) / scale, unit, low / scale, high / scale))
    depth = error = None
    tip, a = desk.shaft()
    if desk.mechanism.trocar:  # a loop: what is left of it is its gap
        depth, error = float(np.linalg.norm(desk.mechanism.trocar_at - tip)), now.worst_gap
    elif rcm is not None and np.isfinite(rcm).all():
        w = rcm - tip
        depth, error = float(-w @ a), float(np.linalg.norm(w - (w @ a) * a))
    if kin is None:
        p, R = T[:3, 3], T[:3, :3]
        turn = spatial.log_so3(R)
        rows = [*zip("xyz", p / MM, ("mm",) * 3, strict=True)]
        rows += [*zip(("rx", "ry", "rz"), turn / DEG, ("°",) * 3, strict=True)]
        coordinates = tuple((n, float(v), u) for n, v, u in rows)
        return Reading(coordinates, tuple(limits), now.worst_gap, depth=depth, rcm_error=error, reason=reason)
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
    if len(joints) > 6:  # the arm of a robot with a freedom to spare is a choice, not an answer
        points = actual = {}
    return Reading(
        coordinates,
        tuple(limits),
        now.worst_gap,
        str(kin.branch(**where)[0]),
        condition,
        tuple(sorted(singular, key=lambda s: s[2])),
        depth,
        error,
        _residual(desk, T, now.q, points, actual, asked),
        points,
        actual,
        reason,
    )


def _residual(
    desk: Desk, T: Array, q: Array, points: dict[str, Array], actual: dict[str, Array], asked: Array | None
) -> tuple[float, str]:
    """Return the largest difference of equations and mechanism, and of what: joints, named points, tool."""
    kin = desk.kin
    assert kin is not None
    found: list[tuple[float, str]] = [
        (float(np.linalg.norm(points[n] - p)), f"point {n}") for n, p in actual.items() if np.isfinite(points[n]).all()
    ]
    if asked is not None:
        found.append((float(np.linalg.norm(asked[:3, 3] - T[:3, 3])), "tool"))
        found.append((float(spatial.rotation_angle(asked[:3, :3].T @ T[:3, :3])), "tool rotation"))
    if len(q) <= 6:
        try:
            theirs = kin.inverse(T, q)
        except KinematicsError:
            theirs = None
        if theirs is not None:
            k = int(np.argmax(np.abs(theirs - q)))
            found.append((float(abs(theirs[k] - q[k])), f"joint {desk.joints[k].name}"))
    elif kin.closed_forward:
        there = kin.forward(q)
        found.append((float(np.linalg.norm(there[:3, 3] - T[:3, 3])), "tool of these joints"))
    found = [f for f in found if np.isfinite(f[0])]
    return max(found, default=(0.0, ""))
