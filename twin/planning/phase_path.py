"""The phases of a protocol as paths with exact derivatives in s; each begins at the end of the previous one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol as Interface

import numpy as np

from twin.core import spatial
from twin.core.errors import ProtocolError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.planning.long_turns import hint
from twin.planning.path import Path, fit
from twin.planning.path_kinematics import PathKinematics
from twin.planning.protocol import Phase, Protocol, trocar_of
from twin.planning.protocol.course import Course, Motion, rotation
from twin.planning.protocol.phase import PhaseEnd, PhaseStart

_NO_LENGTH = 1e-9
"""Change in m and rad below which a phase counts as having no length."""

_LARGEST_TAIL = 1e-6
"""Largest accepted truncation error (m, rad) of a joint's series; a larger error means that the path is not smooth."""


@dataclass(frozen=True)
class PhasePath(Course):
    """One phase as a path.

    Attributes:
        phase: the phase of the protocol.
        waypoint: name of the waypoint at the end of the phase; None if there is none.
        extra_joints: auxiliary joints: (index in q, value at the start, value at the end), in m or rad.
    """

    phase: Phase
    waypoint: str | None
    extra_joints: tuple[tuple[int, float, float], ...]

    def joints(self, s: Array, kinematics: PathKinematics) -> Array:
        """Return the driven joint values (k, n) at s (k,); NaN where the equations have no solution."""
        q = kinematics.inverse(self.motion(s).Ts_base_tool)
        for i, start, end in self.extra_joints:
            q[:, i] = start + s * (end - start)
        return q

    def driven(self, kinematics: PathKinematics, where: str) -> Path:
        """Return the path of the driven joints, as a series.

        Raises:
            ProtocolError: a joint has a kink or jump; the message begins with `where`.
        """
        series = fit(lambda s: self.joints(s, kinematics))
        if np.max(series.tail) > _LARGEST_TAIL:
            j = int(np.argmax(series.tail))
            raise ProtocolError(
                f"{where}: joint {kinematics.joint_names[j]} is not a smooth function of the path (a kink or "
                f"jump of about {series.tail[j]:.2g} m or rad): the path passes close to a singularity, or the "
                "inverse kinematics changes the working mode"
            )
        return series

    def motion(self, s: Array) -> Motion:
        """Return the motion of the phase at the path parameters s (k,)."""
        return self.phase.motion(self, np.asarray(s, float))

    def angles(self, s: float) -> Array:
        """Return the angles (3,) in rad at s, about the axes of `order`."""
        return self.angles0 + s * (self.angles1 - self.angles0)

    def depth(self, s: float) -> float:
        """Return the insertion depth in m at the path parameter s; NaN if no RCM is registered."""
        return self.phase.depth_at(self, s)


class Guide(Interface):
    """Interface of an object that replaces paths by the mechanism's motion; see `mechanism_follower`."""

    def start(self, T_tool_frame: Array) -> tuple[Array, Array]:
        """Return angles (3,) in rad and position (3,) in m of the moved frame at the start of the protocol."""
        ...

    def along(self, path: PhasePath) -> PhasePath:
        """Return a phase with the actual motion of the mechanism."""
        ...


def build(protocol: Protocol, T_tool_frame: Array, guide: Guide | None = None) -> tuple[PhasePath, ...]:
    """Return the phases of a protocol as paths, each beginning at the end of the previous one.

    Args:
        protocol: the protocol.
        T_tool_frame: (4, 4) pose of `protocol.frame` in the tool frame.
        guide: moves the mechanism along each phase; None: the tool follows every phase exactly in all directions.

    Raises:
        ProtocolError: a phase has no length; a phase has joint values, but there is no guide; a retraction ends deeper
            than it begins; or the shaft misses the RCM or the trocar.
    """
    n_tool = T_tool_frame[:3, :3] @ protocol.shaft_axis
    if guide is None:
        angles, tip = protocol.waypoints[protocol.start].require_pose(protocol.name)
    else:
        angles, tip = guide.start(T_tool_frame)
    rcm = protocol.rcm
    if rcm is not None:
        _require_rcm(protocol, rcm, tip, rotation(angles, protocol.rotation) @ n_tool)
    rcm_mode = None
    paths: list[PhasePath] = []
    for phase in protocol.phases:
        shaft = rotation(angles, protocol.rotation) @ n_tool
        rcm = _in_trocar(protocol, phase, rcm, tip, shaft)
        depth = np.nan
        if rcm is not None:
            depth = float((tip - rcm) @ shaft)
        start = PhaseStart(
            protocol=protocol.name,
            where=_where(protocol, phase),
            waypoints=protocol.waypoints,
            order=protocol.rotation,
            n_tool_shaft=n_tool,
            tolerance=protocol.tolerances.rcm,
            by_mechanism=guide is not None,
            angles=angles,
            tip=tip,
            shaft=shaft,
            rcm=rcm,
            rcm_mode=rcm_mode,
            depth=depth,
        )
        end = phase.end_after(start)
        if phase.has_length:
            _require_length(protocol, start, end)
        start_depth = depth
        if phase.registers_rcm:  # where the phase begins: the depth there is zero, whatever it was before
            start_depth = 0.0
        path = PhasePath(
            T_tool_frame=np.asarray(T_tool_frame, float),
            n_tool_shaft=n_tool,
            order=protocol.rotation,
            angles0=angles,
            angles1=end.angles,
            tip0=tip,
            tip1=end.tip,
            rcm=end.rcm,
            rcm_mode=end.rcm_mode,
            depth0=start_depth,
            depth1=end.depth,
            phase=phase,
            waypoint=end.waypoint,
            extra_joints=(),
        )
        if guide is not None:
            path = _guided(path, guide, protocol)
        paths.append(path)
        # the mechanism may end beside the pose that was prescribed: the next phase begins where it is
        angles = path.angles1
        tip = path.tip1
        rcm_mode = path.rcm_mode
        rcm = end.rcm
        if phase.releases_rcm():
            rcm = None
    return tuple(paths)


def _guided(path: PhasePath, guide: Guide, protocol: Protocol) -> PhasePath:
    """Return a phase with the motion of the mechanism; an error names long turns, which may be its cause."""
    try:
        return guide.along(path)
    except ProtocolError as error:
        turn_hint = hint(path, path.phase.name, protocol.waypoints.get(path.waypoint or ""))
        if turn_hint:
            raise ProtocolError(f"{error}{turn_hint}") from error
        raise


def _require_rcm(protocol: Protocol, rcm: Array, tip: Array, shaft: Array) -> None:
    """Raise `ProtocolError` if the shaft (3,) through the tip (3,) misses the RCM (3,) that is there from the start."""
    missed = spatial.point_to_line(rcm, tip, shaft)
    if missed > protocol.tolerances.rcm:
        raise ProtocolError(
            f"{protocol.name}: rcm_mm is the RCM from the start, but the shaft at '{protocol.start}' misses this "
            f"RCM by {missed / MM:.3f} mm (allowed: {protocol.tolerances.rcm / MM:g} mm)"
        )


def _require_length(protocol: Protocol, start: PhaseStart, end: PhaseEnd) -> None:
    """Raise `ProtocolError` if a phase ends with the pose at which it begins.

    The pose at a waypoint with joint values is not known here.
    """
    if end.waypoint is not None and protocol.waypoints[end.waypoint].joints is not None:
        return
    same_tip = np.linalg.norm(end.tip - start.tip) < _NO_LENGTH
    same_angles = np.linalg.norm(end.angles - start.angles) < _NO_LENGTH
    if same_tip and same_angles:
        x, y, z = (start.tip / MM).tolist()
        a, b, c = (start.angles / DEG).tolist()
        place = f"({x:.3f}, {y:.3f}, {z:.3f}) mm, ({a:.3f}, {b:.3f}, {c:.3f}) deg"
        raise start.error(f"the phase has no length: it is at {place}; remove it")


def _in_trocar(protocol: Protocol, phase: Phase, rcm: Array | None, tip: Array, shaft: Array) -> Array | None:
    """Return the RCM (3,) in base at the start of a phase: the registered RCM, or the trocar that the phase names.

    The tip must be at the trocar when an insertion starts, so that the shaft passes exactly through the RCM.
    """
    name = trocar_of(phase)
    if not name:
        return rcm
    trocar = protocol.trocars[name]
    allowed = protocol.tolerances.rcm
    if phase.registers_rcm:
        missed = float(np.linalg.norm(trocar - tip))
        what = f"tip is {missed / MM:.3f} mm from"
    else:
        missed = float(spatial.point_to_line(trocar, tip, shaft))
        what = f"shaft is {missed / MM:.3f} mm beside"
    if missed > allowed:
        text = f"at the start of the phase, the {what} trocar '{name}' (allowed: {allowed / MM:g} mm)"
        raise ProtocolError(f"{_where(protocol, phase)}: {text}")
    # an RCM within the tolerance stays, so that the shaft passes exactly through it
    if rcm is not None and np.linalg.norm(rcm - trocar) <= allowed:
        return rcm
    return trocar


def _where(protocol: Protocol, phase: Phase) -> str:
    """Return the names of protocol and phase, for messages."""
    return f"{protocol.name}: phase '{phase.name}' ({phase.type})"
