"""Read a protocol file and check that each phase can follow the phases before it."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np

from twin.core.findings import Finding, warning
from twin.core.foreign.budget import read_bytes
from twin.core.foreign.once import Read
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.protocol.model import Limits, PatientPlace, Protocol, Tolerances
from twin.planning.protocol.phase import Walk
from twin.planning.protocol.phases.insertion import InsertionTable
from twin.planning.protocol.plausible import plausible
from twin.planning.protocol.tables import LimitsTable, PatientTable, ProtocolTable, TolerancesTable, WaypointTable
from twin.planning.protocol.waypoint import Waypoint, joint_values
from twin.schema import error_at, load_toml


def load_protocol(path: str | Path, read: Read = read_bytes, folder: Path | None = None) -> Protocol:
    """Read the protocol in a TOML file.

    Args:
        path: the TOML file.
        read: returns the bytes of a file.
        folder: folder of the files that phases name; default: that of the TOML file.

    Raises:
        DescriptionError: the file is invalid, or a phase cannot follow the phases before it; the message contains file,
            line, key and a suggestion.
    """
    table = load_toml(path, ProtocolTable, read)
    axis = np.array(table.shaft_axis)
    if abs(np.linalg.norm(axis) - 1) > 1e-6:
        n = np.linalg.norm(axis)
        hint = f"write {[round(float(x), 9) for x in axis / n]}" if n > 0 else "it is zero"
        raise error_at(path, ("shaft_axis",), f"the vector is not a unit vector: {hint}")
    walk = _walked(table, path, Path(path).parent if folder is None else folder, read)
    protocol = Protocol(
        name=table.name,
        title=table.title,
        source=table.source,
        robot=table.robot,
        frame=table.frame,
        shaft_axis=axis / np.linalg.norm(axis),
        start=table.start,
        waypoints={name: _waypoint(name, w) for name, w in table.waypoints.items()},
        phases=tuple(walk.read(k, p) for k, p in enumerate(table.phases)),
        limits={kind: _limits(limits) for kind, limits in table.limits.items()},
        tolerances=_tolerances(table.tolerances),
        rotation=table.rotation,
        trocars=_trocars(table),
        rcm=None if table.rcm_mm is None else np.array(table.rcm_mm) * MM,
        free=None if table.free is None else frozenset(table.free),
        patient=None if table.patient is None else _patient(table.patient),
        no_patient=table.no_patient or "",
        timing=table.timing,
        findings=tuple(_warnings(table, walk.used, str(path))),
    )
    return protocol


def _waypoint(name: str, w: WaypointTable) -> Waypoint:
    position = None if w.position_mm is None else np.array(w.position_mm) * MM
    depth = None if w.depth_mm is None else w.depth_mm * MM
    angles = np.zeros(3) if w.angles_deg is None else np.array(w.angles_deg) * DEG
    out = Waypoint(name, angles, position, depth, w.label or name, w.provenance, w.note)
    if w.joints is None:
        return out
    joints, angles = joint_values(w.joints)
    return replace(out, joints=joints, angle_joints=angles)


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


def _patient(p: PatientTable) -> PatientPlace:
    return PatientPlace(p.body, p.port, p.turn_deg * DEG, tuple(p.replaces), p.provenance, p.note, p.trocar or "")


def _walked(table: ProtocolTable, path: str | Path, folder: Path, read: Read) -> Walk:
    """Return the state after all phases, each checked against the phases before it."""
    home = table.home or table.start
    trocars, inside = tuple(table.trocars_mm), table.rcm_mm is not None
    walk = Walk(path, table.waypoints, trocars, table.start, home, inside, folder, read)
    for name, w in table.waypoints.items():
        if sum(given is not None for given in (w.position_mm, w.depth_mm, w.joints)) != 1:
            raise error_at(
                path,
                ("waypoints", name),
                "give exactly one of position_mm (a pose of the moved frame), depth_mm (an orientation about the RCM) "
                "and joints (values of driven joints)",
            )
        if (w.angles_deg is None) != (w.joints is not None):
            text = (
                "the joints set the orientation: remove angles_deg" if w.joints is not None else "also give angles_deg"
            )
            raise error_at(path, ("waypoints", name), text)
        if w.joints is not None:
            walk.once(w.joints, ("waypoints", name, "joints"))
    walk.target(table.start, ("start",), "the start", "position_mm", "joints")
    if table.home is not None:
        walk.target(table.home, ("home",), "home", "position_mm", "joints")
    names = set[str]()
    for k, p in enumerate(table.phases):
        if p.name in names:
            raise error_at(path, ("phases", k, "name"), f"two phases are named '{p.name}'")
        names.add(p.name)
        if p.kind() not in table.limits:
            raise error_at(path, ("phases", k, "type"), f"limits are missing: add [limits.{p.kind()}]")
        walk.follow(k, p)
    return walk


def _warnings(table: ProtocolTable, used: set[str], path: str) -> list[Finding]:
    out = [
        warning(
            "protocol.unused_waypoint",
            Path(path).name,
            f"waypoint '{name}' is not used by any phase",
            suggestion="remove the waypoint, or add a phase that moves to it",
        )
        for name in table.waypoints
        if name not in used
    ]
    last = [p for p in table.phases if p.in_patient]
    outside = table.rcm_mm is None and any(isinstance(p, InsertionTable) for p in last)
    if outside and not last[-1].leaves():
        out.append(
            warning(
                "protocol.ends_inside",
                Path(path).name,
                f"the instrument is still in the patient after the last phase, '{table.phases[-1].name}'",
                suggestion="add a retraction",
            )
        )
    types = {p.kind() for p in table.phases}
    out += [
        warning("protocol.unused_limits", Path(path).name, f"limits.{kind} is not used: no phase has this type")
        for kind in table.limits
        if kind not in types
    ]
    return [*out, *plausible(table, Path(path).name)]
