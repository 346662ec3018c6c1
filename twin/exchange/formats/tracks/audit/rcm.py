"""Check the remote centres of motion (RCM) of a track against the motion of the shaft.

If the protocol enforces an RCM, a distance between shaft axis and stated RCM is a fault. If the RCM is only monitored,
such a distance is allowed. In both cases, if all shaft axes of a phase meet in one point, the stated RCM must be this
point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.ledger import Ledger, Measured, um
from twin.exchange.audit.pose_deviation import POSITION_TOL
from twin.exchange.audit.poses import Array
from twin.exchange.audit.value_text import quantity
from twin.exchange.formats.tracks.audit.number_lists import entry_numbers, report_not_finite

_ENFORCED_DISTANCE = 5e-3
"""Distance in m from the shaft axis up to which an RCM counts as enforced, if the file does not state its mode."""

_CENTER_TOL = 1e-4
"""Maximum distance in m between a stated RCM and the point in which all shaft axes meet."""

_TIME_ROUNDING = 1e-9
"""Difference in s of times of phases and keys that is only rounding: tracks have nine decimals."""

_UNIT_ROUNDING = 1e-6
"""Difference from 1 of the length of a unit vector that is only rounding: tracks have seven decimals."""

_MIN_SPREAD = 1e-4
"""Minimum mean squared sine of the angles between lines and their mean direction for which a centre is computed."""

_DEFAULT_SHAFT_AXIS = [0.0, 0.0, 1.0]
"""Shaft axis in the frames of the tool link, unless the track states that of its moved frame."""


@dataclass(frozen=True)
class _RcmPhase:
    """A phase with an RCM.

    Attributes:
        point: stated RCM (3,) in m.
        enforced: True if the RCM is enforced, False if it is only monitored; None if not stated.
        times: times (k,) in s of the keys in the phase.
        lines: {frame: shaft axis (points (k, 3) in m, directions (k, 3)) at the keys}.
    """

    name: str
    point: Array
    enforced: bool | None
    times: Array
    lines: Mapping[str, tuple[Array, Array]]

    def distances_to_axes(self, point: Array) -> dict[str, Array]:
        """Return {frame: distances (k,) in m between a point and the shaft axis at the k keys}."""
        distances = {}
        for frame, (points, directions) in self.lines.items():
            distances[frame] = np.linalg.norm(np.cross(directions, point - points), axis=1)
        return distances


def check_rcm(data: JsonObject, clip: FileClip, local: Array, ledger: Ledger) -> None:
    """Report shaft axes that miss the RCM of their phase, and RCMs that are not the centre of rotation of the shaft.

    `local` (7 n,) contains the poses of the track's n named frames, each relative to the frame's link: x y z in m, then
    the quaternion x y z w.
    """
    rcm_phases = _rcm_phases(data, clip, local, ledger)
    if rcm_phases is None:
        return
    centers = []
    for rcm_phase in rcm_phases:
        center = _axes_intersection(rcm_phase)
        if center is not None:
            centers.append(center)
    worst = 0.0
    where = ""
    when = ""
    for rcm_phase in rcm_phases:
        # The frame on the shaft is not stated: it is the one whose axis passes nearest to the RCM.
        distances = rcm_phase.distances_to_axes(rcm_phase.point)
        frame = min(distances, key=lambda name: float(distances[name].max()))
        key = int(np.argmax(distances[frame]))
        missed = float(distances[frame][key])
        moment = f"t = {rcm_phase.times[key]:.4g} s"
        if _reports_other_center(rcm_phase, missed, centers, moment, ledger) or rcm_phase.enforced is False:
            continue
        # Tracks of earlier versions do not state the mode: so far from the shaft, an RCM can only have been monitored.
        if missed > _ENFORCED_DISTANCE and rcm_phase.enforced is None:
            text = (
                f"phase '{rcm_phase.name}': the shaft (axis of '{frame}') misses the RCM by {missed * 1e3:.4g} mm; the "
                "file does not state whether the RCM is enforced or only monitored."
            )
            size = Measured(missed * 1e3, unit="mm")
            ledger.add("tracks.rcm_watched", "info", text, rcm_phase.name, size=size, when=moment)
            continue
        if missed >= worst:
            worst = missed
            where = frame
            when = moment
        if missed > POSITION_TOL:
            text = f"phase '{rcm_phase.name}': the shaft (axis of '{frame}') misses the RCM by {quantity(missed, 'm')}."
            ledger.wrong("tracks.rcm", text, frame, size=um(missed, POSITION_TOL), when=moment)
    if where:
        ledger.row("distance of the shaft axis from the RCM", worst, "m", POSITION_TOL, where=where, when=when)


def _reports_other_center(
    rcm_phase: _RcmPhase, missed: float, centers: Sequence[Array], moment: str, ledger: Ledger
) -> bool:
    """Return whether all shaft axes of a phase meet in another point than the stated RCM; report it.

    `missed` is the largest distance in m of the shaft axis from the RCM, `centers` are the points in which the axes of
    phases meet. A phase whose axes are parallel has no such point of its own, but may keep that of another phase.
    """
    for center in centers:
        if not _axis_passes(rcm_phase, center):
            continue
        distance = float(np.linalg.norm(center - rcm_phase.point))
        if not (distance > _CENTER_TOL and missed > POSITION_TOL):
            return False
        coordinates = ", ".join(map("{:.5g}".format, center))
        text = (
            f"phase '{rcm_phase.name}': the shaft rotates about ({coordinates}) m, "
            f"{quantity(distance, 'm')} from the stated RCM."
        )
        ledger.wrong("tracks.rcm", text, rcm_phase.name, size=um(distance, _CENTER_TOL), when=moment)
        return True
    return False


def _rcm_phases(data: JsonObject, clip: FileClip, local: Array, ledger: Ledger) -> list[_RcmPhase] | None:
    """Return the phases with an RCM and a shaft axis; None, with a finding, if the data do not fit together."""
    has_rcm = entry_numbers(data, "phase_has_rcm").ravel()
    points = entry_numbers(data, "phase_rcm").ravel()
    report_not_finite(has_rcm, "phase_has_rcm", ledger)
    report_not_finite(points, "phase_rcm", ledger)
    # the caller reports starts, ends and poses of frames that are not finite
    start = entry_numbers(data, "phase_start").ravel()
    end = entry_numbers(data, "phase_end").ravel()
    names = data.get("frame_names", [])
    links = data.get("frame_links", [])
    phases = data.get("phases", [])
    frames_fit = len(local) == 7 * len(names) and len(links) == len(names)
    phases_fit = len(points) == 3 * len(has_rcm) and len(has_rcm) <= min(len(start), len(end), len(phases))
    if not frames_fit or not phases_fit:
        text = (
            "the lengths of frame_names, frame_links and frames_local, or of phases, phase_start, phase_end, "
            "phase_has_rcm and phase_rcm do not match."
        )
        ledger.wrong("tracks.shape", text, "frames_local")
        return None
    enforced = data.get("phase_rcm_enforced")  # tracks of earlier versions lack this entry
    if enforced is not None and not (isinstance(enforced, list) and len(enforced) == len(has_rcm)):
        text = f"phase_rcm_enforced is not a list with an entry for each of the {len(has_rcm)} phases."
        ledger.wrong("tracks.shape", text, "phase_rcm_enforced")
        return None
    shaft_axis = data.get("shaft_axis", _DEFAULT_SHAFT_AXIS)  # tracks of earlier versions lack this entry
    if not _is_unit_vector(shaft_axis):
        text = f"shaft_axis is {shaft_axis!r}, not a unit vector of three numbers."
        ledger.wrong("tracks.shape", text, "shaft_axis")
        return None
    tool = data.get("tool_link")
    moved_frame = data.get("moved_frame")
    points = points.reshape(-1, 3)
    with_rcm = np.flatnonzero(has_rcm).tolist()
    rcm_phases = []
    for phase in with_rcm:
        inside = (clip.times >= start[phase] - _TIME_ROUNDING) & (clip.times <= end[phase] + _TIME_ROUNDING)
        lines = {}
        for name, link, seven in zip(names, links, local.reshape(-1, 7), strict=True):
            if link == tool and link in clip.links and inside.any():
                T = clip.links[link][inside] @ poses.from_seven(seven)
                axis = shaft_axis if name == moved_frame else _DEFAULT_SHAFT_AXIS
                lines[str(name)] = (T[:, :3, 3], T[:, :3, :3] @ axis)
        if lines:
            is_enforced = None if enforced is None else bool(enforced[phase])
            rcm_phases.append(_RcmPhase(str(phases[phase]), points[phase], is_enforced, clip.times[inside], lines))
    stated = data.get("rcm")
    if isinstance(stated, list) and len(stated) == 3 and with_rcm:
        offset = np.subtract(stated, points[with_rcm[0]])
        distance = float(np.linalg.norm(offset))
        if distance > POSITION_TOL:
            text = f"entry 'rcm' is {quantity(distance, 'm')} from the RCM of the first phase that has an RCM."
            ledger.wrong("tracks.rcm", text, "rcm", size=um(distance))
    return rcm_phases


def _is_unit_vector(value: object) -> bool:
    if not isinstance(value, list) or len(value) != 3:
        return False
    if not all(isinstance(component, int | float) for component in value):
        return False
    return abs(float(np.linalg.norm(value)) - 1) < _UNIT_ROUNDING


def _axes_intersection(rcm_phase: _RcmPhase) -> Array | None:
    """Return the intersection (3,) in m of the shaft axes; None if the axes do not meet or are nearly parallel."""
    for points, directions in rcm_phase.lines.values():
        # The point nearest to all lines solves A x = b, with the projectors onto the planes normal to the lines.
        projectors = np.eye(3) - directions[:, :, None] * directions[:, None, :]
        A = projectors.mean(axis=0)
        b = np.einsum("kij,kj->i", projectors, points) / len(points)
        if np.linalg.eigvalsh(A)[0] < _MIN_SPREAD:
            continue
        center = np.linalg.solve(A, b)
        if np.linalg.norm(np.cross(directions, center - points), axis=1).max() < POSITION_TOL:
            return center
    return None


def _axis_passes(rcm_phase: _RcmPhase, point: Array) -> bool:
    """Return whether the axis of a frame passes through a point during the whole phase."""
    distances_by_frame = rcm_phase.distances_to_axes(point)
    return any(distances.max() < POSITION_TOL for distances in distances_by_frame.values())
