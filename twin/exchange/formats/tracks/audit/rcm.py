"""Check the remote centres of motion (RCM) of a track against the motion of the shaft.

If the protocol enforces an RCM, a distance between shaft axis and stated RCM is a fault. If the RCM is only monitored,
such a distance is allowed. In both cases, if all shaft axes of a phase meet in one point, the stated RCM must be this
point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import POSITION_TOL, Ledger, Measured, quantity, um

SHAFT = 5e-3
"""Distance in m from the shaft axis up to which an RCM counts as enforced, if the file does not state its mode."""

BESIDE = 1e-4
"""Maximum distance in m between a stated RCM and the point in which all shaft axes meet."""

SPREAD = 1e-4
"""Minimum mean squared sine of the angles between lines and their mean direction for which a centre is computed."""


@dataclass(frozen=True)
class _Stay:
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

    def missed(self, point: Array) -> dict[str, Array]:
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
    stays = _stays(data, clip, local, ledger)
    if stays is None:
        return
    centers = []
    for stay in stays:
        center = _center(stay)
        if center is not None:
            centers.append(center)
    worst = 0.0
    where = ""
    when = ""
    for stay in stays:
        # The frame on the shaft is not stated: it is the one whose axis stays nearest to the RCM.
        distances = stay.missed(stay.point)
        largest = {name: float(values.max()) for name, values in distances.items()}
        frame = min(largest, key=largest.__getitem__)
        k = int(np.argmax(distances[frame]))
        missed = float(distances[frame][k])
        moment = f"t = {stay.times[k]:.4g} s"
        if _is_beside(stay, missed, centers, moment, ledger) or stay.enforced is False:
            continue
        if missed > SHAFT and stay.enforced is None:
            text = (
                f"phase '{stay.name}': the shaft (axis of '{frame}') misses the RCM by {missed * 1e3:.4g} mm; the "
                "file does not state whether the RCM is enforced or only monitored."
            )
            size = Measured(missed * 1e3, unit="mm")
            ledger.add("tracks.rcm_watched", "info", text, stay.name, size=size, when=moment)
            continue
        if missed >= worst:
            worst = missed
            where = frame
            when = moment
        if missed > POSITION_TOL:
            text = f"phase '{stay.name}': the shaft (axis of '{frame}') misses the RCM by {quantity(missed, 'm')}."
            ledger.wrong("tracks.rcm", text, frame, size=um(missed, POSITION_TOL), when=moment)
    if where:
        ledger.row("distance of the shaft axis from the RCM", worst, "m", POSITION_TOL, where=where, when=when)


def _is_beside(stay: _Stay, missed: float, centers: Sequence[Array], moment: str, ledger: Ledger) -> bool:
    """Return whether all shaft axes of a phase meet in another point than the stated RCM; report it.

    `missed` is the largest distance in m of the shaft axis from the RCM, `centers` are the points in which the axes of
    phases meet. A phase whose axes are parallel has no such point of its own, but may keep that of another phase.
    """
    for center in centers:
        if not _passes(stay, center):
            continue
        distance = float(np.linalg.norm(center - stay.point))
        if not (distance > BESIDE and missed > POSITION_TOL):
            return False
        coordinates = ", ".join(f"{c:.5g}" for c in center)
        text = (
            f"phase '{stay.name}': the shaft rotates about ({coordinates}) m, "
            f"{quantity(distance, 'm')} from the stated RCM."
        )
        ledger.wrong("tracks.rcm", text, stay.name, size=um(distance, BESIDE), when=moment)
        return True
    return False


def _stays(data: JsonObject, clip: FileClip, local: Array, ledger: Ledger) -> list[_Stay] | None:
    """Return the phases with an RCM and a shaft axis; None, with a finding, if the data do not fit together."""
    has_rcm = _array(data, "phase_has_rcm")
    points = _array(data, "phase_rcm")
    start = _array(data, "phase_start")
    end = _array(data, "phase_end")
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
    shaft_axis = data.get("shaft_axis", _Z)  # tracks of earlier versions lack this entry
    if not _is_unit(shaft_axis):
        text = f"shaft_axis is {shaft_axis!r}, not a unit vector of three numbers."
        ledger.wrong("tracks.shape", text, "shaft_axis")
        return None
    tool = data.get("tool_link")
    moved = data.get("moved_frame")
    points = points.reshape(-1, 3)
    with_rcm = np.flatnonzero(has_rcm).tolist()
    stays = []
    for i in with_rcm:
        inside = (clip.times >= start[i] - 1e-9) & (clip.times <= end[i] + 1e-9)
        lines = {}
        for name, link, seven in zip(names, links, local.reshape(-1, 7), strict=True):
            if link == tool and link in clip.links and inside.any():
                T = clip.links[link][inside] @ poses.from_seven(seven)
                axis = shaft_axis if name == moved else _Z
                lines[str(name)] = (T[:, :3, 3], T[:, :3, :3] @ axis)
        if lines:
            must = None if enforced is None else bool(enforced[i])
            stays.append(_Stay(str(phases[i]), points[i], must, clip.times[inside], lines))
    stated = data.get("rcm")
    if isinstance(stated, list) and len(stated) == 3 and with_rcm:
        offset = np.subtract(stated, points[with_rcm[0]])
        distance = float(np.linalg.norm(offset))
        if distance > POSITION_TOL:
            text = f"entry 'rcm' is {quantity(distance, 'm')} from the RCM of the first phase that has an RCM."
            ledger.wrong("tracks.rcm", text, "rcm", size=um(distance))
    return stays


_Z = [0.0, 0.0, 1.0]
"""Shaft axis in the frames of the tool link, unless the track states that of its moved frame."""


def _array(data: JsonObject, key: str) -> Array:
    return np.array(data.get(key, []), float).ravel()


def _is_unit(value: Any) -> bool:
    if not isinstance(value, list) or len(value) != 3:
        return False
    if not all(isinstance(x, int | float) for x in value):
        return False
    return abs(float(np.linalg.norm(value)) - 1) < 1e-6


def _center(stay: _Stay) -> Array | None:
    """Return the intersection (3,) in m of the shaft axes; None if the axes do not meet or are nearly parallel."""
    for points, directions in stay.lines.values():
        # The point nearest to all lines solves A x = b, with the projectors onto the planes normal to the lines.
        projectors = np.eye(3) - directions[:, :, None] * directions[:, None, :]
        A = projectors.mean(axis=0)
        b = np.einsum("kij,kj->i", projectors, points) / len(points)
        if np.linalg.eigvalsh(A)[0] < SPREAD:
            continue
        center = np.linalg.solve(A, b)
        if np.linalg.norm(np.cross(directions, center - points), axis=1).max() < POSITION_TOL:
            return center
    return None


def _passes(stay: _Stay, point: Array) -> bool:
    """Return whether the axis of a frame passes through a point during the whole phase."""
    return any(distances.max() < POSITION_TOL for distances in stay.missed(point).values())
