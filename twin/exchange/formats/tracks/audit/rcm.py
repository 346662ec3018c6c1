"""Check the remote centres of motion (RCM) of a track against the motion of the shaft.

If the protocol enforces an RCM, a distance between shaft axis and stated RCM is a fault. If the RCM is only monitored,
such a distance is allowed. In both cases, if all shaft axes of a phase meet in one point, the stated RCM must be this
point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.motion import FileClip
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
        return {n: np.linalg.norm(np.cross(d, point - p), axis=1) for n, (p, d) in self.lines.items()}


def check_rcm(data: JsonObject, clip: FileClip, local: Array, ledger: Ledger) -> None:
    """Report shaft axes that miss the RCM of their phase, and RCMs that are not the centre of rotation of the shaft.

    `local` (7 n,) contains the poses of the track's n named frames, each relative to the frame's link: x y z in m, then
    the quaternion x y z w.
    """
    stays = _stays(data, clip, local, ledger)
    if stays is None:
        return
    centres = [c for s in stays if (c := _centre(s)) is not None]
    worst, where, when = 0.0, "", ""
    for stay in stays:
        distances = stay.missed(stay.point)
        name = min(distances, key=lambda n: float(distances[n].max()))
        k = int(np.argmax(distances[name]))
        missed, at = float(distances[name][k]), f"t = {stay.times[k]:.4g} s"
        centre = next((c for c in centres if _through(stay, c)), None)
        beside = 0.0 if centre is None else float(np.linalg.norm(centre - stay.point))
        if centre is not None and beside > BESIDE and missed > POSITION_TOL:
            text = (
                f"phase '{stay.name}': the shaft rotates about ({', '.join(f'{c:.5g}' for c in centre)}) m, "
                f"{quantity(beside, 'm')} from the stated RCM."
            )
            ledger.wrong("tracks.rcm", text, stay.name, size=um(beside, BESIDE), when=at)
            continue
        if stay.enforced is False:
            continue
        if missed > SHAFT and stay.enforced is None:
            text = (
                f"phase '{stay.name}': the shaft (axis of '{name}') misses the RCM by {missed * 1e3:.4g} mm; the "
                "file does not state whether the RCM is enforced or only monitored."
            )
            ledger.add("tracks.rcm_watched", "info", text, stay.name, size=Measured(missed * 1e3, unit="mm"), when=at)
            continue
        if missed >= worst:
            worst, where, when = missed, name, at
        if missed > POSITION_TOL:
            text = f"phase '{stay.name}': the shaft (axis of '{name}') misses the RCM by {quantity(missed, 'm')}."
            ledger.wrong("tracks.rcm", text, name, size=um(missed, POSITION_TOL), when=at)
    if where:
        ledger.row("distance of the shaft axis from the RCM", worst, "m", POSITION_TOL, where=where, when=when)


def _stays(data: JsonObject, clip: FileClip, local: Array, ledger: Ledger) -> list[_Stay] | None:
    has, point, start, end = (
        np.array(data.get(k, []), float).ravel() for k in ("phase_has_rcm", "phase_rcm", "phase_start", "phase_end")
    )
    names, on, phases = data.get("frame_names", []), data.get("frame_links", []), data.get("phases", [])
    fits = len(local) == 7 * len(names) and len(on) == len(names) and len(point) == 3 * len(has)
    if not fits or len(has) > min(len(start), len(end), len(phases)):
        text = (
            "the lengths of frame_names, frame_links and frames_local, or of phases, phase_start, phase_end, "
            "phase_has_rcm and phase_rcm do not match."
        )
        ledger.wrong("tracks.shape", text, "frames_local")
        return None
    enforced = data.get("phase_rcm_enforced")  # tracks of earlier versions lack this entry
    if enforced is not None and not (isinstance(enforced, list) and len(enforced) == len(has)):
        text = f"phase_rcm_enforced is not a list with an entry for each of the {len(has)} phases."
        ledger.wrong("tracks.shape", text, "phase_rcm_enforced")
        return None
    tool, stated = data.get("tool_link"), data.get("rcm")
    moved, along = data.get("moved_frame"), data.get("shaft_axis", [0.0, 0.0, 1.0])  # absent in earlier versions
    if not _is_unit(along):
        text = f"shaft_axis is {along!r}, not a unit vector of three numbers."
        ledger.wrong("tracks.shape", text, "shaft_axis")
        return None
    out = []
    for i in np.flatnonzero(has).tolist():
        inside = (clip.times >= start[i] - 1e-9) & (clip.times <= end[i] + 1e-9)
        lines = {}
        for name, link, seven in zip(names, on, local.reshape(-1, 7), strict=True):
            if link == tool and link in clip.links and inside.any():
                T = clip.links[link][inside] @ poses.from_seven(seven)
                axis = along if name == moved else [0.0, 0.0, 1.0]
                lines[str(name)] = (T[:, :3, 3], T[:, :3, :3] @ axis)
        if lines:
            must = None if enforced is None else bool(enforced[i])
            out.append(_Stay(str(phases[i]), point[3 * i : 3 * i + 3], must, clip.times[inside], lines))
    if isinstance(stated, list) and len(stated) == 3 and has.any():
        first = point[3 * int(np.flatnonzero(has)[0]) :][:3]
        off = float(np.linalg.norm(np.subtract(stated, first)))
        if off > POSITION_TOL:
            text = f"entry 'rcm' is {quantity(off, 'm')} from the RCM of the first phase that has an RCM."
            ledger.wrong("tracks.rcm", text, "rcm", size=um(off))
    return out


def _is_unit(value: Any) -> bool:
    numbers = isinstance(value, list) and len(value) == 3 and all(isinstance(x, int | float) for x in value)
    return numbers and abs(float(np.linalg.norm(value)) - 1) < 1e-6


def _centre(stay: _Stay) -> Array | None:
    """Return the intersection (3,) in m of the shaft axes; None if the axes do not meet or are nearly parallel."""
    for p, d in stay.lines.values():
        P = np.eye(3) - d[:, :, None] * d[:, None, :]
        A, b = P.mean(axis=0), np.einsum("kij,kj->i", P, p) / len(p)
        if np.linalg.eigvalsh(A)[0] < SPREAD:
            continue
        centre = np.linalg.solve(A, b)
        if np.linalg.norm(np.cross(d, centre - p), axis=1).max() < POSITION_TOL:
            return centre
    return None


def _through(stay: _Stay, point: Array) -> bool:
    return any(off.max() < POSITION_TOL for off in stay.missed(point).values())
