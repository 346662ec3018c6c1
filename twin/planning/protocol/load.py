"""Reads a protocol file and checks that its phases follow from each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Literal

import numpy as np

from twin.core.errors import DescriptionError, unknown
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol.model import (
    Auxiliary,
    Circle,
    Home,
    Insertion,
    Joints,
    Limits,
    PatientPlace,
    Phase,
    Pivot,
    Positioning,
    Protocol,
    Retraction,
    Tolerances,
    Waypoint,
)
from twin.planning.protocol.plausible import plausible
from twin.planning.protocol.tables import (
    AuxiliaryTable,
    CircleTable,
    HomeTable,
    InsertionTable,
    JointsTable,
    LimitsTable,
    PatientTable,
    PhaseTable,
    PivotTable,
    PositioningTable,
    ProtocolTable,
    RetractionTable,
    TolerancesTable,
    WaypointTable,
)
from twin.schema import Keys, error_at, load_toml


def load_protocol(path: str | Path) -> Protocol:
    """Return the protocol in a TOML file.

    Raises:
        DescriptionError: the file is malformed, or its phases do not follow from each other; the message
            gives file, line, key and the way out.
    """
    table = load_toml(path, ProtocolTable)
    axis = np.array(table.shaft_axis)
    if abs(np.linalg.norm(axis) - 1) > 1e-6:
        n = np.linalg.norm(axis)
        hint = f"write {[round(float(x), 9) for x in axis / n]}" if n > 0 else "it is zero"
        raise error_at(path, ("shaft_axis",), f"is not a unit vector: {hint}")
    used = _check_phases(table, path)
    protocol = Protocol(
        name=table.name,
        title=table.title,
        source=table.source,
        robot=table.robot,
        frame=table.frame,
        shaft_axis=axis / np.linalg.norm(axis),
        start=table.start,
        waypoints={name: _waypoint(name, w) for name, w in table.waypoints.items()},
        phases=tuple(_phase(p, table) for p in table.phases),
        limits={kind: _limits(limits) for kind, limits in table.limits.items()},
        tolerances=_tolerances(table.tolerances),
        rotation=table.rotation,
        trocars=_trocars(table),
        rcm=None if table.rcm_mm is None else np.array(table.rcm_mm) * MM,
        free=None if table.free is None else frozenset(table.free),
        patient=None if table.patient is None else _patient(table.patient),
        no_patient=table.no_patient or "",
        findings=tuple(_warnings(table, used, str(path))),
    )
    return protocol


def _waypoint(name: str, w: WaypointTable) -> Waypoint:
    position = None if w.position_mm is None else np.array(w.position_mm) * MM
    depth = None if w.depth_mm is None else w.depth_mm * MM
    angles = np.zeros(3) if w.angles_deg is None else np.array(w.angles_deg) * DEG
    out = Waypoint(name, angles, position, depth, w.label or name, w.provenance, w.note)
    if w.joints is None:
        return out
    joints, angles = _joint_values(w.joints)
    return replace(out, joints=joints, angle_joints=angles)


def _joint_values(given: Mapping[str, float]) -> tuple[dict[str, float], frozenset[str]]:
    """Return values in SI by joint, and which of them were given in degrees."""
    split = [(*key.rsplit("_", 1), value) for key, value in given.items()]
    joints = {joint: value * (DEG if unit == "deg" else MM) for joint, unit, value in split}
    return joints, frozenset(j for j, unit, _ in split if unit == "deg")


def _limits(l: LimitsTable) -> Limits:  # noqa: E741
    return Limits(
        l.tip_speed_mm_s * MM,
        l.tip_acceleration_mm_s2 * MM,
        l.rotation_speed_deg_s * DEG,
        l.rotation_acceleration_deg_s2 * DEG,
        l.provenance,
        l.note,
        inf if l.tip_jerk_mm_s3 is None else l.tip_jerk_mm_s3 * MM,
        inf if l.rotation_jerk_deg_s3 is None else l.rotation_jerk_deg_s3 * DEG,
    )


def _tolerances(t: TolerancesTable) -> Tolerances:
    lengths = (t.rcm_mm * MM, t.rcm_alarm_mm * MM, t.straightness_mm * MM, t.waypoint_mm * MM)
    return Tolerances(*lengths, t.waypoint_deg * DEG, t.provenance, t.note)


def _trocars(table: ProtocolTable) -> dict[str, Array]:
    places = table.trocars_mm if table.trocar_mm is None else {"": table.trocar_mm}
    return {name: np.array(place) * MM for name, place in places.items()}


def _trocar(p: InsertionTable | PivotTable | CircleTable | RetractionTable, table: ProtocolTable) -> str:
    """Return the trocar that a phase names, or an insertion's only one."""
    only = isinstance(p, InsertionTable) and len(table.trocars_mm) == 1
    return p.trocar or (next(iter(table.trocars_mm)) if only else "")


def _patient(p: PatientTable) -> PatientPlace:
    return PatientPlace(p.body, p.port, p.turn_deg * DEG, tuple(p.replaces), p.provenance, p.note, p.trocar or "")


def _phase(p: PhaseTable, table: ProtocolTable) -> Phase:
    match p:
        case PositioningTable():
            return Positioning(p.name, p.to)
        case JointsTable():
            return Joints(p.name, p.to)
        case AuxiliaryTable():
            return Auxiliary(p.name, *_joint_values(p.joints))
        case InsertionTable():
            return Insertion(p.name, p.depth_mm * MM, p.to, _trocar(p, table))
        case PivotTable():
            return Pivot(p.name, p.to, p.rcm, _trocar(p, table))
        case CircleTable():
            normal = np.array(p.normal, float)
            place = np.array(p.centre_mm) * MM
            return Circle(p.name, place, normal / np.linalg.norm(normal), p.turns, _trocar(p, table))
        case RetractionTable():
            return Retraction(p.name, p.depth_mm * MM, _trocar(p, table))
        case HomeTable():
            return Home(p.name, table.home or table.start)


def _check_phases(table: ProtocolTable, path: str | Path) -> set[str]:
    """Walk the phases as the robot would, and return the waypoints that they use."""

    def wrong(keys: Keys, message: str) -> DescriptionError:
        return error_at(path, keys, message)

    def target(name: str, keys: Keys, why: str, *needs: Literal["position_mm", "depth_mm", "joints"]) -> None:
        if name not in table.waypoints:
            raise wrong(keys, unknown("waypoint", name, table.waypoints))
        if all(getattr(table.waypoints[name], n) is None for n in needs):
            raise wrong(keys, f"waypoint '{name}' has no {' or '.join(needs)}, which {why} needs")

    def once(joints: Mapping[str, float], keys: Keys) -> None:
        moved = [key.rsplit("_", 1)[0] for key in joints]
        for joint in moved:
            if moved.count(joint) > 1:
                raise wrong(keys, f"joint '{joint}' is given twice, in deg and in mm")

    def trocar(name: str | None, kind: str, keys: Keys) -> bool:
        if name is not None and name not in table.trocars_mm:
            raise wrong(
                (*keys, "trocar"), f"{unknown('trocar', name, table.trocars_mm)}: [trocars_mm] gives the places"
            )
        if name is None and kind == "insertion" and len(table.trocars_mm) > 1:
            text = f"[trocars_mm] has {', '.join(table.trocars_mm)}: name the one that this insertion goes through"
            raise wrong((*keys, "type"), f'{text}, trocar = "NAME"')
        return name is not None

    for name, w in table.waypoints.items():
        if sum(given is not None for given in (w.position_mm, w.depth_mm, w.joints)) != 1:
            raise wrong(
                ("waypoints", name),
                "give one of position_mm (a pose of the moved frame), depth_mm (an attitude about the RCM) and joints "
                "(values of driven joints)",
            )
        if (w.angles_deg is None) != (w.joints is not None):
            text = "joints decide the attitude: take angles_deg out" if w.joints is not None else "give angles_deg, too"
            raise wrong(("waypoints", name), text)
        if w.joints is not None:
            once(w.joints, ("waypoints", name, "joints"))
    target(table.start, ("start",), "the start", "position_mm", "joints")
    if table.home is not None:
        target(table.home, ("home",), "home", "position_mm", "joints")

    here: str | None = table.start
    used, names, inside = {table.start, table.home or table.start}, set[str](), table.rcm_mm is not None
    for k, p in enumerate(table.phases):
        keys = ("phases", k)
        if p.name in names:
            raise wrong((*keys, "name"), f"two phases are called '{p.name}'")
        names.add(p.name)
        if p.type not in table.limits:
            raise wrong((*keys, "type"), f"there are no limits for it: add [limits.{p.type}]")
        if inside and p.type in ("positioning", "joints", "insertion", "home"):
            raise wrong(
                (*keys, "type"),
                f"the instrument is still in the patient: put a retraction to depth 0 before this {p.type}",
            )
        if isinstance(p, InsertionTable | PivotTable | CircleTable | RetractionTable):
            inside = trocar(p.trocar, p.type, keys) or inside
        if not inside and p.type in ("pivot", "retraction"):
            raise wrong((*keys, "type"), f"no RCM is registered yet: put an insertion before this {p.type}")
        goal: str | None = None
        match p:
            case PositioningTable():
                goal = p.to
                target(goal, (*keys, "to"), "a positioning", "position_mm")
            case JointsTable():
                goal = p.to
                target(goal, (*keys, "to"), "a motion by the joints", "joints")
            case AuxiliaryTable():
                once(p.joints, (*keys, "joints"))
            case HomeTable():
                goal = table.home or table.start
            case PivotTable(rcm="enforced"):
                goal = p.to
                target(goal, (*keys, "to"), "a pivot with an enforced RCM", "depth_mm")
            case PivotTable():
                goal = p.to
                target(goal, (*keys, "to"), "a pivot with a monitored RCM", "position_mm")
            case InsertionTable():
                inside, goal = True, p.to
                if goal is not None:
                    target(goal, (*keys, "to"), "an insertion", "position_mm")
            case CircleTable():
                goal = None  # it ends where it began
            case RetractionTable():
                inside = p.depth_mm > 0
        if goal is not None:
            used.add(goal)
            if goal == here:
                raise wrong(
                    (*keys, "to" if p.type != "home" else "type"),
                    f"the phase has no length: it begins at '{goal}' already; remove it",
                )
        here = here if p.type in ("circle", "auxiliary") else goal
    return used


def _warnings(table: ProtocolTable, used: set[str], path: str) -> list[Finding]:
    out = [
        Finding(
            "protocol.unused_waypoint",
            "warning",
            f"waypoint '{name}' is not used by any phase",
            where=Path(path).name,
            suggestion="remove it, or add a phase that goes there",
        )
        for name in table.waypoints
        if name not in used
    ]
    last = [p for p in table.phases if p.type in ("insertion", "pivot", "circle", "retraction")]
    outside = table.rcm_mm is None and any(p.type == "insertion" for p in last)
    if outside and not (last[-1].type == "retraction" and last[-1].depth_mm == 0):
        out.append(
            Finding(
                "protocol.ends_inside",
                "warning",
                f"the instrument is still in the patient after the last phase, '{table.phases[-1].name}'",
                where=Path(path).name,
                suggestion="add a retraction",
            )
        )
    types = {p.type for p in table.phases}
    out += [
        Finding(
            "protocol.unused_limits",
            "warning",
            f"no phase is of type {kind}, for which limits are given",
            where=Path(path).name,
        )
        for kind in table.limits
        if kind not in types
    ]
    return [*out, *plausible(table, Path(path).name)]
