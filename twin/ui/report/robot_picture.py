"""The robot of a report at the worst moment, with the place of the fault marked: drawn, and to be turned."""

from __future__ import annotations

import base64
import inspect
import io
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from twin.api import Robot
from twin.core import units
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.format import deviation, seconds, shown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body
from twin.model.mechanism import Mechanism
from twin.reference.states import Assembly
from twin.validation.result import Report, Residual

MAX_TRIANGLES = 70_000
"""Maximum number of triangles in a page; meshes with more are made coarser."""

_FAULT_COLOR = (214, 40, 40)
"""Colour (sRGB, 0 to 255) of the links at the place of the fault."""

_QUANTISATION_STEPS = 32767
"""Vertices are stored as integers up to this number; it is the largest extent of the robot."""

_FINEST_GRID = 64.0
"""Number of cells along the largest side of a mesh, in the first attempt to make the mesh coarser."""

_COARSEST_GRID = 4.0
"""Number of cells below which a mesh is not made coarser: its shape could not be recognised."""

_COARSENING = 1.4
"""Factor between two attempts; about a half of the triangles remain, because their number goes with its square."""


@dataclass(frozen=True)
class RobotPicture:
    """A robot in one state, with the place of the first cause of a report.

    Attributes:
        vertices: (n, 3) in m in the base frame.
        triangles: (m, 3) indices of vertices.
        colors: (m, 3) uint8, sRGB.
        marked: names of the links at the place of the fault; () if no part of the mechanism is named.
        mark: (3,) place of the fault in m in the base frame; None: no place.
        label: name of the place, and the size of the deviation.
        moment: the state that is shown, as text.
        line: file and line that describe the part or phase; "" if unknown.
    """

    vertices: Array
    triangles: np.ndarray
    colors: np.ndarray
    marked: tuple[str, ...]
    mark: Array | None
    label: str
    moment: str
    line: str

    @cached_property
    def data(self) -> str:
        """The picture for the script of the page, as JSON that is safe within an HTML element."""
        low = self.vertices.min(axis=0)
        extent = float(np.max(self.vertices.max(axis=0) - low)) or 1.0
        steps = np.round((self.vertices - low) / extent * _QUANTISATION_STEPS).astype("<i2")
        mark = None
        if self.mark is not None:
            mark = _micrometres(self.mark)
        content = {
            "low": _micrometres(low),
            "step": extent / _QUANTISATION_STEPS,
            "vertices": _base64(steps),
            "triangles": _base64(self.triangles.astype("<u4")),
            "colors": _runs(self.colors),
            "mark": mark,
            "label": self.label,
        }
        # a label with "</script>" would end the element
        return json.dumps(content).replace("<", "\\u003c")

    @cached_property
    def png(self) -> str:
        """The picture from the standard direction as base64 of a PNG file; "" without the package Pillow."""
        try:
            from PIL import Image
        except ImportError:
            return ""
        from twin.ui.report.raster import shaded_picture

        pixels = shaded_picture(self.vertices, self.triangles, self.colors, self.mark)
        # a palette makes the file smaller, and a robot has few shades
        image = Image.fromarray(pixels).convert("P", palette=Image.Palette.ADAPTIVE, colors=128)
        buffer = io.BytesIO()
        image.save(buffer, "PNG", optimize=True)
        return base64.b64encode(buffer.getvalue()).decode()


def picture_of(robot: Robot, report: Report) -> RobotPicture | None:
    """Return the robot at the moment of the largest deviation of the first cause; without a cause, at its home.

    Return None if the robot has no meshes, or cannot be assembled.
    """
    head: Finding | None = None
    places: tuple[str, ...] = ()
    label = ""
    moment_of_head: tuple[float, str] | None = None
    if report.causes:
        cause = report.causes[0]
        head = cause.head
        places = _names(head.where)
        if cause.side == "CAD":
            # the message names both parts that do not fit
            places = (*places, *re.findall(r"'(\w+)'", head.message))
        label = head.where
        if head.size is not None:
            label += f"  {shown(head.size, head.unit)}"
        moment_of_head = _moment(report, head)
    try:
        bound = robot
        if robot.files is not None:
            bound = robot.bound(robot.protocol(report.protocol))
        assembly, moment = _state(bound, report, moment_of_head)
        mechanism = bound.mechanism
    except TwinError:
        return None
    marked, mark = _place(mechanism, assembly, places)
    rcm = _rcm(head)
    if rcm is not None:
        marked, _ = _place(mechanism, assembly, ("tool",))
        mark = rcm
        # "RCM at (1, 2, 3) mm  4 mm" becomes "RCM  4 mm": the picture shows the place
        before, _, _ = label.partition(" at ")
        _, _, after = label.rpartition(")")
        label = before + after.removeprefix(" mm")
    parts = _triangles(mechanism, assembly, marked)
    if parts is None:
        return None
    vertices, triangles, colors = parts
    line = _line(robot, report, places)
    return RobotPicture(vertices, triangles, colors, marked, mark, label, moment, line)


def _names(where: str) -> tuple[str, ...]:
    """Return the names in the place of a finding, such as ("s1", "s2") of "s1, s2"; the whole text is the first."""
    names = [where]
    for part in re.split(r"[,\s]+", where):
        if part:
            names.append(part)
    return tuple(dict.fromkeys(names))


def _moment(report: Report, head: Finding) -> tuple[float, str] | None:
    """Return (time in s, text) of a finding's largest deviation; None if it has no time."""
    worst: Residual | None = None
    for row in report.residuals:
        if row.name != head.where or row.agrees or not np.isfinite(row.t):
            continue
        if worst is None or _times_tolerance(row) > _times_tolerance(worst):
            worst = row
    if worst is not None:
        size = deviation(worst.worst, worst.unit, worst.tolerance)
        return worst.t, f"{worst.phase}, t = {seconds(worst.t)}: {size}"
    # without a residual of that name, the time that the finding's text states
    stated = re.search(r"\bt = ([\d.]+) s", head.when)
    if stated is None:
        return None
    return float(stated[1]), head.when


def _times_tolerance(row: Residual) -> float:
    """Return the worst value of a residual as a multiple of its tolerance; without a tolerance, the value itself."""
    return row.worst / (row.tolerance or 1.0)


def _rcm(head: Finding | None) -> Array | None:
    """Return the RCM (3,) in m in base that is the place of a finding; None if the place is something else."""
    if head is None:
        return None
    stated = re.match(r"RCM at \(([-\d.]+), ([-\d.]+), ([-\d.]+)\) mm", head.where)
    if stated is None:
        return None
    return np.array([float(value) for value in stated.groups()]) * MM


def _state(robot: Robot, report: Report, moment: tuple[float, str] | None) -> tuple[Assembly, str]:
    """Return the state at a moment (time in s, text) of the protocol, and a text; without one, the posture home."""
    model = robot.reference()
    t = report.series.get("t")
    q = report.series.get("q")
    note = ""
    if moment is not None and t is not None and q is not None and len(t) == len(q) > 0:
        k = int(np.argmin(np.abs(t - moment[0])))
        try:
            return model.solve(q[k]), f"the worst moment: {moment[1]}"
        except TwinError:
            # the joint values of wrong equations need not be reachable
            note = "; the joint values of the equations at the worst moment cannot be assembled"
    home = robot.mechanism.home
    if home is None:
        return model.home(), f"as drawn{note}"
    return model.solve(home), f"at home{note}"


def _place(mechanism: Mechanism, assembly: Assembly, names: tuple[str, ...]) -> tuple[tuple[str, ...], Array | None]:
    """Return the links that the names denote, and the place (3,) in m in base of the first one; ((), None) if none."""
    links: list[str] = []
    first_place: Array | None = None
    for name in names:
        denoted = _denoted(mechanism, name)
        if denoted is None:
            continue
        link, p_link = denoted
        if link not in links:
            links.append(link)
        if first_place is None:
            first_place = (assembly.link_poses[link] @ np.append(p_link, 1.0))[:3]
    return tuple(links), first_place


def _denoted(mechanism: Mechanism, name: str) -> tuple[str, Array] | None:
    """Return (link, point (3,) in m in its frame) of a named point, joint, frame or body; None: there is none.

    Where several have the name, the first kind in this order is meant.
    """
    for point in mechanism.points:
        if point.name == name:
            return point.body, point.p_body
    for joint in mechanism.joints:
        if joint.name == name:
            return joint.child, joint.T_child_joint[:3, 3]
    for frame in mechanism.frames:
        if frame.name == name:
            return frame.body, frame.T_body_frame[:3, 3]
    if name == "tool":
        frame = mechanism.frame(mechanism.tool)
        return frame.body, frame.T_body_frame[:3, 3]
    for body in mechanism.bodies:
        if body.name == name:
            return name, _middle(body)
    return None


def _middle(body: Body) -> Array:
    """Return the middle (3,) in m of the box around the meshes of a body; without meshes, its origin."""
    vertices = [mesh.vertices for mesh in body.meshes if len(mesh.vertices)]
    if not vertices:
        return np.zeros(3)
    corners = np.concatenate(vertices)
    return 0.5 * (corners.min(axis=0) + corners.max(axis=0))


def _triangles(
    mechanism: Mechanism, assembly: Assembly, marked: tuple[str, ...]
) -> tuple[Array, np.ndarray, np.ndarray] | None:
    """Return (vertices (n, 3) in base, triangles (m, 3), colours (m, 3)) of all links; None without meshes."""
    count = 0
    for body in mechanism.bodies:
        for mesh in body.meshes:
            count += len(mesh.triangles)
    if not count:
        return None
    vertices: list[Array] = []
    triangles: list[np.ndarray] = []
    colors: list[np.ndarray] = []
    start = 0
    for body in mechanism.bodies:
        T = assembly.link_poses[body.name]
        for mesh in body.meshes:
            points = mesh.vertices
            faces = np.asarray(mesh.triangles)
            if not len(faces):
                continue
            if count > MAX_TRIANGLES:
                points, faces = _coarser(points, faces, MAX_TRIANGLES / count)
            vertices.append(points @ T[:3, :3].T + T[:3, 3])
            triangles.append(faces + start)
            color = [round(255 * units.srgb(c)) for c in mesh.color_rgba[:3]]
            if body.name in marked:
                color = list(_FAULT_COLOR)
            colors.append(np.tile(np.array(color, np.uint8), (len(faces), 1)))
            start += len(points)
    return np.concatenate(vertices), np.concatenate(triangles), np.concatenate(colors)


def _coarser(vertices: Array, triangles: np.ndarray, share: float) -> tuple[Array, np.ndarray]:
    """Return a mesh with about the given share of the triangles: vertices within one cell of a grid become one."""
    low = vertices.min(axis=0)
    extent = float(np.max(np.ptp(vertices, axis=0))) or 1.0
    cells = _FINEST_GRID
    while True:
        cell = np.floor((vertices - low) / extent * cells).astype(np.int64)
        _, first, of_vertex = np.unique(cell, axis=0, return_index=True, return_inverse=True)
        faces = of_vertex.reshape(-1)[triangles]
        a, b, c = faces.T
        # a triangle with two corners in one cell has become a line or a point
        proper = (a != b) & (b != c) & (c != a)
        if proper.sum() <= share * len(triangles) or cells < _COARSEST_GRID:
            return vertices[first], faces[proper]
        cells /= _COARSENING


def _line(robot: Robot, report: Report, names: tuple[str, ...]) -> str:
    """Return "FILE:LINE" of what is to be edited; "" if it is not found.

    For equations, this is the parameter that the fix sets to another value. For the CAD, it is the table of the
    description with one of the names; for the protocol, the table of the phase or joint.
    """
    if robot.files is None or not report.causes:
        return ""
    cause = report.causes[0]
    if cause.side == "equations":
        parameters = re.findall(r"(\w+) = \S+ \S* ?instead of", report.cure)
        # a table of a user's file, "a": mm(1), or an entry of a built-in robot, mm("a", 1)
        return _first_line(_sources(robot), parameters, r"\s*(?:\w+\()?[\"']{0}[\"']\s*[:,]")
    files = [robot.files.description]
    if cause.side == "protocol":
        when = cause.head.when
        # a phase with spaces in its name is quoted
        names = (*re.findall(r"'([\w ]+)'", when), *_names(when), *names)
        files.insert(0, robot.files.protocol(report.protocol))
    return _first_line(files, names, r'\s*name\s*=\s*"{0}"|\s*\[\w+\.{0}\]')


def _sources(robot: Robot) -> list[Path]:
    """Return the files with the equations of a robot: its own, then those that robots of one kind share."""
    files: list[Path] = []
    if robot.files is not None and robot.files.formula is not None:
        files.append(robot.files.formula)
    for equation in robot.formula.equations:
        for function in equation.variants.values():
            code = getattr(inspect.unwrap(function), "__code__", None)
            if code is not None:
                files.append(Path(code.co_filename))
    return [file for file in dict.fromkeys(files) if file.is_file()]


def _first_line(files: Sequence[Path], names: Sequence[str], pattern: str) -> str:
    """Return "FILE:LINE" of the first line that matches the pattern of a name; "" if there is none."""
    for file in files:
        try:
            lines = file.read_text("utf-8", "replace").splitlines()
        except OSError:
            continue
        for name in names:
            place = re.compile(pattern.format(re.escape(name)))
            for number, text in enumerate(lines, 1):
                if place.match(text):
                    return f"{_short(file)}:{number}"
    return ""


def _short(file: Path) -> str:
    """Return a path relative to the working directory, if it is in it."""
    try:
        return str(file.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(file)


def _runs(colors: np.ndarray) -> list[list[int]]:
    """Return [number of triangles, red, green, blue] of each sequence of triangles with one colour."""
    runs: list[list[int]] = []
    differs_from_last = np.any(np.diff(colors.astype(int), axis=0), axis=1)
    changes = np.flatnonzero(differs_from_last) + 1
    for begin, end in pairwise([0, *changes, len(colors)]):
        runs.append([int(end - begin), *colors[begin].tolist()])
    return runs


def _micrometres(point: Array) -> list[float]:
    """Return a point (3,) in m, rounded to 1 µm: more digits would only lengthen the page."""
    return [round(float(v), 6) for v in point]


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
