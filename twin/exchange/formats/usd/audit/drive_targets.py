"""Check the targets of the drives of a stage: they hold the robot in the pose in which the stage shows it.

A drive is a spring: under the weight of the robot it holds a pose only if its target is ahead of the pose by effort
per stiffness. The efforts are computed here, from masses, joints and poses of the stage, by virtual work: for all
velocities that the joints allow, weight and drives together do no work. Only stages that state this meaning of their
targets are checked; elsewhere a target may be any pose to move to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdPhysics

from twin.core import format
from twin.exchange.audit import poses
from twin.exchange.audit.file_joints import WORLD, FileJoint
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.motion_lines import JointLine
from twin.exchange.audit.poses import Array

_TOLERANCE = 1e-6
"""Difference of a target in m or rad, and part of the target, that single precision explains."""

_PART = 1e-3
"""Part of the deflection by which a target may differ: masses are in single precision."""

_ZERO = 1e-9
"""Size of a singular value, relative to the largest, below which it counts as zero."""

_BALANCED = 1e-6
"""Part of the weight's power that may remain where drives hold a robot."""

_EARTH = (0.0, 0.0, -9.81)
"""Gravity in m/s2 of a robot that states none, z up."""

_SINGLE = ("revolute", "prismatic")


class _UndeterminedError(Exception):
    """The stage does not determine the efforts of its drives; the message is the reason."""


@dataclass(frozen=True)
class _Target:
    """Targets of the drive of a joint: position in m or rad, velocity in m/s or rad/s; None if not stated."""

    position: float | None
    velocity: float | None


def check_drive_targets(
    stage: Usd.Stage,
    rest_poses: Mapping[str, Array],
    mechanism: FileMechanism,
    meters: float,
    ledger: Ledger,
    *,
    moving: bool,
) -> None:
    """Report drives whose targets do not hold the robot in its authored pose, or move it, and targets not checked.

    Args:
        stage: the stage.
        rest_poses: {body: T_world_body (4, 4)} of the authored pose, in m, z up.
        mechanism: the mechanism data of the stage.
        meters: unit of length of the stage in m.
        ledger: receives the findings.
        moving: whether the stage has a motion: it may begin elsewhere than its targets, which are those of the robot.
    """
    if not mechanism.all_motors:  # no stage of this project: its targets may mean anything
        return
    targets = _targets(stage, meters)
    if not targets:
        return
    gravity = mechanism.gravity
    if gravity is None:  # the layers of a robot have no physics scene
        stated = stage.GetDefaultPrim().GetAttribute("twin:gravity").Get()
        gravity = np.array(stated or _EARTH, float)
    efforts: dict[str, float] | None = None
    if not moving:
        try:
            efforts = _efforts(rest_poses, mechanism, gravity)
        except _UndeterminedError as reason:
            _not_checked("targets of the drives", f"{reason}", "", ledger)
    for joint in mechanism.joints:
        name = joint.names[0]
        target = targets.get(name)
        if target is None:
            continue
        if target.velocity:
            unit = "m/s"
            if joint.kind == "revolute":
                unit = "rad/s"
            text = f"the drive of joint '{name}' has a target velocity of {target.velocity:g} {unit}; expected 0."
            ledger.wrong("usd.drive_target", text, name, suggestion="export the stage again")
        q = _coordinate(joint, rest_poses)
        if efforts is None:
            continue
        if q is None:
            reason = "the poses of its bodies and frames give no coordinate"
            _not_checked(f"target of the drive of joint '{name}'", reason, name, ledger)
            continue
        _check_position(joint, q, target.position, efforts.get(name, 0.0), ledger)


def _not_checked(what: str, reason: str, where: str, ledger: Ledger) -> None:
    """Report that positions of targets are not checked."""
    advice = "simulate the stage, and see whether it keeps its pose"
    ledger.add("usd.drive_target_unchecked", "info", f"{what} not checked: {reason}.", where, suggestion=advice)


def _check_position(joint: FileJoint, q: float, target: float | None, effort: float, ledger: Ledger) -> None:
    """Report a target that does not hold a joint at the coordinate q against an effort, all in SI units."""
    low, high = joint.drive.limits or (-np.inf, np.inf)
    deflection = 0.0
    if joint.drive.stiffness:
        deflection = effort / joint.drive.stiffness
    stated = target or 0.0  # the schema's target where none is stated
    if joint.kind == "revolute":
        q = _nearest_turn(q, stated - deflection, low, high)
    expected = float(np.clip(q + deflection, low, high))
    difference = abs(stated - expected)
    limit = _TOLERANCE * (1.0 + abs(stated)) + _PART * abs(deflection)
    if difference <= limit:
        return
    unit = "m"
    if joint.kind == "revolute":
        unit = "rad"
    text = (
        f"the drive of joint '{joint.names[0]}' has the target {stated:.6g} {unit}; {expected:.6g} {unit} holds the "
        "pose that the stage shows."
    )
    advice = "export the stage again, or write the target that holds the pose"
    ledger.wrong("usd.drive_target", text, joint.names[0], suggestion=advice, size=Measured(difference, limit, unit))


def _targets(stage: Usd.Stage, meters: float) -> dict[str, _Target]:
    """Return {joint: targets of its drive} of the joints with a drive along or about their axis."""
    targets = {}
    for prim in stage.Traverse():
        for schema, token, unit in (
            (UsdPhysics.RevoluteJoint, "angular", np.pi / 180),
            (UsdPhysics.PrismaticJoint, "linear", meters),
        ):
            if prim.IsA(schema) and prim.HasAPI(UsdPhysics.DriveAPI, token):
                drive = UsdPhysics.DriveAPI(prim, token)
                position = drive.GetTargetPositionAttr().Get()
                velocity = drive.GetTargetVelocityAttr().Get()
                targets[prim.GetName()] = _Target(_scaled(position, unit), _scaled(velocity, unit))
    return targets


def _scaled(value: float | None, unit: float) -> float | None:
    """Return a number of the stage in SI units; None if it is not stated."""
    if value is None:
        return None
    return float(value) * unit


def _nearest_turn(q: float, target: float, low: float, high: float) -> float:
    """Return the angle q, plus full turns, within limits if possible, and there nearest to another angle."""
    nearest = q + 2 * np.pi * np.round((target - q) / (2 * np.pi))
    turned = q + 2 * np.pi * np.arange(-2, 3)
    is_allowed = (low - _TOLERANCE <= turned) & (turned <= high + _TOLERANCE)
    allowed = turned[is_allowed].tolist()
    if not np.isfinite([low, high]).all() or not allowed:
        if abs(nearest) > 2 * np.pi:  # a target so far away is no rounding of the pose
            return q
        return float(nearest)
    return min(allowed, key=lambda angle: abs(angle - target))


def _coordinate(joint: FileJoint, rest_poses: Mapping[str, Array]) -> float | None:
    """Return the coordinate of a joint in m or rad at the authored pose; None if it has not exactly one."""
    if joint.kind not in _SINGLE or joint.T is None or len(joint.motions) != 1:
        return None
    T_parent = _placed(joint.parent, rest_poses)
    T_child = _placed(joint.child, rest_poses)
    if T_parent is None or T_child is None:
        return None
    T_joint = poses.inverse(T_parent) @ T_child @ poses.inverse(joint.T)
    line = joint.motions[0]
    if line.kind == "slide":
        return float(line.direction @ T_joint[:3, 3])
    R = T_joint[:3, :3]
    sine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(line.direction @ sine, 0.5 * (np.trace(R) - 1.0)))


def _placed(link: str, rest_poses: Mapping[str, Array]) -> Array | None:
    if link in ("", WORLD) and link not in rest_poses:
        return np.eye(4)
    return rest_poses.get(link)


# -- statics ------------------------------------------------------------------------------------------


def _efforts(rest_poses: Mapping[str, Array], mechanism: FileMechanism, gravity: Array) -> dict[str, float]:
    """Return {driven joint: effort in N or N m} that holds the robot at the authored pose.

    `gravity` (3,) is in m/s2, in the world with z up.

    Raises:
        _UndeterminedError: no link is held, or no or several sets of efforts hold the robot.
    """
    if not mechanism.fixed_to_world:
        raise _UndeterminedError("no joint holds a link of the robot in the world")
    columns: dict[str, int] = {}
    for link in mechanism.links:
        if link not in mechanism.fixed_to_world:
            columns[link] = 6 * len(columns)
    joints = [joint for joint in mechanism.joints if joint.parent in rest_poses or joint.child in rest_poses]
    rates: dict[str, int] = {}
    count = 6 * len(columns)
    for joint in joints:
        rates[joint.names[0]] = count
        count += len(joint.motions)
    allowed = _allowed(joints, columns, rates, count, rest_poses, mechanism)
    power = np.zeros(count)
    for link, column in columns.items():
        mass = mechanism.masses.get(link)
        if mass is None or mass.center is None:
            continue
        share = 1.0 - (mechanism.weight_shares or {}).get(link, 0.0)
        force = share * mass.mass * gravity
        center = rest_poses[link][:3, :3] @ mass.center + rest_poses[link][:3, 3]
        power[column : column + 3] = np.cross(center, force)
        power[column + 3 : column + 6] = force
    driven: list[str] = []
    rate_rows: list[int] = []
    for joint in joints:
        if joint.drive.driven and joint.kind in _SINGLE:
            driven.append(joint.names[0])
            rate_rows.append(rates[joint.names[0]])
    by_drives = allowed[rate_rows].T
    by_weight = allowed.T @ power
    independent = int(np.linalg.matrix_rank(by_drives, tol=_ZERO))
    if independent < len(driven):
        names = ", ".join(map("'{}'".format, driven))
        drives = f"{len(driven)} drives ({names}) act"
        if len(driven) == 1:
            drives = f"1 drive ({names}) acts"
        reason = f"{drives} on {format.count(independent, 'independent motion')}"
        raise _UndeterminedError(f"{reason}, so that several sets of efforts hold the same weight")
    efforts = -np.linalg.lstsq(by_drives, by_weight, rcond=None)[0]
    remaining = float(np.linalg.norm(by_drives @ efforts + by_weight))
    weight = float(np.linalg.norm(by_weight))
    if remaining > _BALANCED * max(weight, 1e-12):  # what no drive holds would fall
        part = f"{100 * remaining / max(weight, 1e-12):.3g} %"
        raise _UndeterminedError(f"no efforts of the drives balance the weight; {part} of its power remains")
    return dict(zip(driven, efforts.tolist(), strict=True))


def _allowed(
    joints: Sequence[FileJoint],
    columns: Mapping[str, int],
    rates: Mapping[str, int],
    count: int,
    rest_poses: Mapping[str, Array],
    mechanism: FileMechanism,
) -> Array:
    """Return velocities (count, freedoms) that joints and couplings allow.

    Of the rows, six are the angular velocity of a link and the velocity of its point at the world's origin, from
    `columns` on; the others are the rates of the joints, from `rates` on.
    """
    rows = []
    for joint in joints:
        row = np.zeros((6, count))
        for link, sign in ((joint.child, 1.0), (joint.parent, -1.0)):
            if link in columns:
                row[:, columns[link] : columns[link] + 6] = sign * np.eye(6)
        T_parent = _placed(joint.parent, rest_poses)
        if T_parent is not None:
            for k, line in enumerate(joint.motions):
                row[:, rates[joint.names[0]] + k] = -_screw(line.transformed(T_parent))
        rows.append(row)
    for ratios, _ in (mechanism.couplings or {}).values():
        row = np.zeros((1, count))
        for name, ratio in ratios.items():
            if name in rates:
                row[0, rates[name]] = ratio
        rows.append(row)
    if not rows or count == 0:  # nothing is tied, or nothing can move
        return np.eye(count)
    _, sizes, Vt = np.linalg.svd(np.concatenate(rows))
    rank = int(np.sum(sizes > _ZERO * sizes[0]))
    return Vt[rank:].T


def _screw(line: JointLine) -> Array:
    """Return angular velocity and velocity at the origin (6,) of a unit rate of a joint."""
    if line.kind == "slide":
        return np.concatenate([np.zeros(3), line.direction])
    return np.concatenate([line.direction, np.cross(line.point, line.direction)])
