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
from twin.planning.protocol.model import Limits, PatientPlace, Protocol, TrajectoryTolerances
from twin.planning.protocol.phase_table import PhaseTable
from twin.planning.protocol.phases.insertion import InsertionTable
from twin.planning.protocol.plausibility import plausible
from twin.planning.protocol.protocol_file import ProtocolFile
from twin.planning.protocol.protocol_state import ProtocolState
from twin.planning.protocol.tables import LimitsTable, PatientTable, ProtocolTable, TolerancesTable, WaypointTable
from twin.planning.protocol.waypoint import Waypoint, joint_values
from twin.schema import error_at, load_toml

_UNIT_TOLERANCE = 1e-6
"""Largest difference of the length of a written unit vector from 1: rounding to seven digits."""


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
    norm = np.linalg.norm(axis)
    if abs(norm - 1) > _UNIT_TOLERANCE:
        hint = "it is zero"
        if norm > 0:
            hint = f"write {[round(float(x), 9) for x in axis / norm]}"
        raise error_at(path, ("shaft_axis",), f"the vector is not a unit vector: {hint}")
    if folder is None:
        folder = Path(path).parent
    protocol_file = ProtocolFile(
        path=path,
        waypoints=table.waypoints,
        trocars=tuple(table.trocars_mm),
        home=table.home or table.start,
        folder=folder,
        reader=read,
    )
    _check_waypoints(table, protocol_file)
    used_waypoints = _check_phases(table, protocol_file)
    waypoints = {}
    for name, waypoint_table in table.waypoints.items():
        waypoints[name] = _waypoint(name, waypoint_table)
    phases = []
    for index, phase_table in enumerate(table.phases):
        phases.append(phase_table.phase(protocol_file.at_phase(index)))
    rcm = None
    if table.rcm_mm is not None:
        rcm = np.array(table.rcm_mm) * MM
    free = None
    if table.free is not None:
        free = frozenset(table.free)
    patient = None
    if table.patient is not None:
        patient = _patient(table.patient)
    return Protocol(
        name=table.name,
        title=table.title,
        source=table.source,
        robot=table.robot,
        frame=table.frame,
        shaft_axis=axis / norm,
        start=table.start,
        waypoints=waypoints,
        phases=tuple(phases),
        limits={kind: _limits(limits) for kind, limits in table.limits.items()},
        tolerances=_tolerances(table.tolerances),
        rotation=table.rotation,
        trocars=_trocars(table),
        rcm=rcm,
        free=free,
        patient=patient,
        no_patient=table.no_patient or "",
        timing=table.timing,
        findings=tuple(_warnings(table, used_waypoints, str(path))),
    )


def _waypoint(name: str, table: WaypointTable) -> Waypoint:
    """Return a waypoint in SI; a key that the table does not have is None, angles without a value are zero."""
    position = None
    if table.position_mm is not None:
        position = np.array(table.position_mm) * MM
    depth = None
    if table.depth_mm is not None:
        depth = table.depth_mm * MM
    angles = np.zeros(3)
    if table.angles_deg is not None:
        angles = np.array(table.angles_deg) * DEG
    waypoint = Waypoint(name, angles, position, depth, table.label or name, table.provenance, table.note)
    if table.joints is None:
        return waypoint
    joints, angle_joints = joint_values(table.joints)
    return replace(waypoint, joints=joints, angle_joints=angle_joints)


def _limits(table: LimitsTable) -> Limits:
    """Return limits in SI; a jerk without a limit is infinite."""
    tip_jerk = inf
    if table.tip_jerk_mm_s3 is not None:
        tip_jerk = table.tip_jerk_mm_s3 * MM
    rotation_jerk = inf
    if table.rotation_jerk_deg_s3 is not None:
        rotation_jerk = table.rotation_jerk_deg_s3 * DEG
    return Limits(
        table.tip_speed_mm_s * MM,
        table.tip_acceleration_mm_s2 * MM,
        table.rotation_speed_deg_s * DEG,
        table.rotation_acceleration_deg_s2 * DEG,
        table.provenance,
        table.note,
        tip_jerk,
        rotation_jerk,
    )


def _tolerances(table: TolerancesTable) -> TrajectoryTolerances:
    """Return tolerances in SI."""
    return TrajectoryTolerances(
        table.rcm_mm * MM,
        table.rcm_alarm_mm * MM,
        table.straightness_mm * MM,
        table.waypoint_mm * MM,
        table.waypoint_deg * DEG,
        table.provenance,
        table.note,
    )


def _trocars(table: ProtocolTable) -> dict[str, Array]:
    """Return positions (3,) in m of the trocars; the only trocar is named ""."""
    if table.trocar_mm is not None:
        return {"": np.array(table.trocar_mm) * MM}
    return {name: np.array(position) * MM for name, position in table.trocars_mm.items()}


def _patient(table: PatientTable) -> PatientPlace:
    """Return the place of the patient in SI."""
    return PatientPlace(
        table.body,
        table.port,
        table.turn_deg * DEG,
        tuple(table.replaces),
        table.provenance,
        table.note,
        table.trocar or "",
    )


def _check_waypoints(table: ProtocolTable, protocol_file: ProtocolFile) -> None:
    """Check the keys of each waypoint, and that the robot can start and end at the waypoints named for it.

    Raises:
        DescriptionError: a waypoint has too few or too many keys; or the first waypoint or `home` has no pose.
    """
    for name, waypoint_table in table.waypoints.items():
        keys = [waypoint_table.position_mm, waypoint_table.depth_mm, waypoint_table.joints]
        if keys.count(None) != 2:
            raise protocol_file.error(
                ("waypoints", name),
                "give exactly one of position_mm (a pose of the moved frame), depth_mm (an orientation about the RCM) "
                "and joints (values of driven joints)",
            )
        if waypoint_table.joints is None and waypoint_table.angles_deg is None:
            raise protocol_file.error(("waypoints", name), "also give angles_deg")
        if waypoint_table.joints is not None and waypoint_table.angles_deg is not None:
            raise protocol_file.error(("waypoints", name), "the joints set the orientation: remove angles_deg")
        if waypoint_table.joints is not None:
            protocol_file.require_distinct_joints(waypoint_table.joints, ("waypoints", name, "joints"))
    protocol_file.require_waypoint(table.start, "start", "the start", "position_mm", "joints")
    if table.home is not None:
        protocol_file.require_waypoint(table.home, "home", "home", "position_mm", "joints")


def _check_phases(table: ProtocolTable, protocol_file: ProtocolFile) -> set[str]:
    """Check each phase against those before it; return the names of the waypoints that they use.

    Raises:
        DescriptionError: two phases have the same name, a phase has no limits or cannot follow the phases before it.
    """
    state = ProtocolState(protocol_file, table.start, has_rcm=table.rcm_mm is not None)
    names = set[str]()
    for index, phase in enumerate(table.phases):
        state.begin_phase(index)
        if phase.name in names:
            raise state.protocol_file.error("name", f"two phases are named '{phase.name}'")
        names.add(phase.name)
        if phase.kind() not in table.limits:
            raise state.protocol_file.error("type", f"limits are missing: add [limits.{phase.kind()}]")
        phase.advance(state)
    return state.used_waypoints


def _warnings(table: ProtocolTable, used_waypoints: set[str], path: str) -> list[Finding]:
    """Return the warnings on a protocol whose phases use the waypoints named in `used_waypoints`."""
    file = Path(path).name
    warnings = []
    for name in table.waypoints:
        if name not in used_waypoints:
            warnings.append(
                warning(
                    "protocol.unused_waypoint",
                    file,
                    f"waypoint '{name}' is not used by any phase",
                    suggestion="remove the waypoint, or add a phase that moves to it",
                )
            )
    is_inserted = False
    last_inside: PhaseTable | None = None  # the last phase in the patient
    for phase in table.phases:
        if phase.in_patient:
            last_inside = phase
            is_inserted |= isinstance(phase, InsertionTable)
    # an instrument that is in the patient from the start, may stay there
    if is_inserted and table.rcm_mm is None and last_inside is not None and not last_inside.releases_rcm():
        warnings.append(
            warning(
                "protocol.ends_inside",
                file,
                f"the instrument is still in the patient after the last phase, '{table.phases[-1].name}'",
                suggestion="add a retraction",
            )
        )
    types = {phase.kind() for phase in table.phases}
    for kind in table.limits:
        if kind not in types:
            warnings.append(
                warning("protocol.unused_limits", file, f"limits.{kind} is not used: no phase has this type")
            )
    return [*warnings, *plausible(table, file)]
