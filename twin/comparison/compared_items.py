"""What a fit says about two sides: conventions that differ, and joints whose place on their link differs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin.comparison.convention_sizes import is_base_moved, moved_zeros, zero_of
from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import FrameGap, carrier_of_groups, frame_gaps
from twin.comparison.line_gaps import FitSolution
from twin.comparison.matching import Matching
from twin.comparison.unknowns import Unknowns
from twin.core import spatial
from twin.core.json_types import JsonObject
from twin.core.quantity import deg, mm, moved
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_PARALLEL_SINE = 1e-6
"""Sine of the angle of two lines below which they are parallel."""

_SMALLEST_SHOWN = 1e-9
"""Length in m, angle in rad, or part of a unit vector that is not told."""


@dataclass(frozen=True)
class NumberEdit:
    """A number of a file whose edit makes the two sides agree at one place.

    Attributes:
        side: label of the side.
        file, line: place of the number; line 0 if unknown.
        what: the number in the terms of its format: "joint_3 origin xyz[2]".
        old, new: its text, and the text to write.
        confirmed: whether the edited file was read and compared again.
        obstacle: why no other text of this number alone removes the difference, as in a macro of a xacro that is used
            several times; `new` is then "".
    """

    side: str
    file: str
    line: int
    what: str
    old: str
    new: str
    confirmed: bool = False
    obstacle: str = ""

    def text(self) -> str:
        """Return the edit as one line."""
        place = f"{self.file}:{self.line}" if self.line else self.file
        if self.obstacle:
            return f"{place}: {self.what} is {self.old}, but {self.obstacle}"
        return f"{place}: {self.what}: {self.old} → {self.new}"

    def as_dict(self) -> JsonObject:
        """Return the edit as plain data."""
        return {
            "side": self.side,
            "file": self.file,
            "line": self.line,
            "what": self.what,
            "old": self.old,
            "new": self.new,
            "confirmed": self.confirmed,
            "obstacle": self.obstacle,
        }


@dataclass(frozen=True)
class ComparedItem:
    """One convention or one difference.

    Attributes:
        kind: "base frame", "zero", "sign", "name", "order" (of the driven joints, or which are driven),
            "tool frame" or "link".
        joint: name of the joint in the second side; "" if the item belongs to none.
        link: name of the link, for "link" and "tool frame".
        text: one sentence.
        shift: size of the shift in m.
        turn: size of the rotation in rad.
        edits: edits, each of which removes the item.
    """

    kind: str
    joint: str
    text: str
    link: str = ""
    shift: float = 0.0
    turn: float = 0.0
    edits: tuple[NumberEdit, ...] = field(default=())

    @property
    def moves_geometry(self) -> bool:
        """Whether the item is a change of lines or frames, which numbers of a file state."""
        return self.kind not in ("name", "order")

    def with_edits(self, edits: Sequence[NumberEdit]) -> ComparedItem:
        """Return the item with edits."""
        return replace(self, edits=tuple(edits))

    def as_dict(self) -> JsonObject:
        """Return the item as plain data, lengths in mm and angles in degrees."""
        return {
            "kind": self.kind,
            "joint": self.joint,
            "link": self.link,
            "text": self.text,
            "shift_mm": self.shift / MM,
            "turn_deg": self.turn / DEG,
            "edits": [edit.as_dict() for edit in self.edits],
        }


def compared_items(problem: FitProblem, matching: Matching, solution: FitSolution) -> list[ComparedItem]:
    """Return the conventions and the differences of a solution, differences last."""
    unknowns = solution.unknowns
    items_of_solution = _name_items(problem, matching)
    items_of_solution += _base_items(problem, unknowns)
    items_of_solution += _joint_items(problem, unknowns)
    items_of_solution += _tool_items(problem, unknowns)
    items_of_solution += _link_items(problem, unknowns)
    return items_of_solution


def _name_items(problem: FitProblem, matching: Matching) -> list[ComparedItem]:
    """Return an item for each pair of joints with other names, one for another order, and those of `_drive_items`."""
    items_of_names = []
    for first, second in matching.renamed:
        text = f"joint '{first}' of {problem.first.label} is joint '{second}' of {problem.second.label}"
        items_of_names.append(ComparedItem("name", second, text))
    partners = {}
    for axis, partner in zip(problem.axes, problem.second.axes, strict=True):
        partners[axis.name] = partner.name
    # of the joints that motors of both sides drive, with the names of the second side
    driven_by_first = []
    for name in problem.first.driven_joints:
        if name in partners:
            driven_by_first.append(partners[name])
    order_of_second = [name for name in problem.second.driven_joints if name in driven_by_first]
    order_of_first = [name for name in driven_by_first if name in order_of_second]
    if order_of_first != order_of_second:
        text = (
            f"the order of the joints is {', '.join(order_of_first)} in {problem.first.label}, "
            f"{', '.join(order_of_second)} in {problem.second.label}"
        )
        items_of_names.append(ComparedItem("order", "", text))
    items_of_names += _drive_items(problem)
    return items_of_names


def _drive_items(problem: FitProblem) -> list[ComparedItem]:
    """Return an item for each joint that one side drives as several joints, while no motor of the other drives it."""
    items_of_drives = []
    for i, axis in enumerate(problem.axes):
        partner = problem.second.axes[i]
        if axis.active == partner.active or axis.closes_loop or not (axis.merged_axes or partner.merged_axes):
            continue
        driven = problem.second if partner.active else problem.first
        passive = problem.first if partner.active else problem.second
        parts = (*axis.merged_axes, *partner.merged_axes)
        part_names = [part.name for part in parts]
        text = (
            f"motors of {driven.label} drive joint '{partner.name}' ({', '.join(part_names)}), "
            f"none of {passive.label} does"
        )
        items_of_drives.append(ComparedItem("order", partner.name, text))
    return items_of_drives


def _base_items(problem: FitProblem, unknowns: Unknowns) -> list[ComparedItem]:
    """Return the moved base frame as an item in a list; [] if it is not moved."""
    if not is_base_moved(problem, unknowns):
        return []
    shift = unknowns.base[3:]
    turn = unknowns.base[:3]
    size = shift_and_turn_text(shift, turn)
    text = f"the base frame of {problem.first.label} is moved by {size} in that of {problem.second.label}"
    link = problem.second.groups[0].bodies[0]
    length = float(np.linalg.norm(shift))
    return [ComparedItem("base frame", "", text, link, length, float(np.linalg.norm(turn)))]


def _joint_items(problem: FitProblem, unknowns: Unknowns) -> list[ComparedItem]:
    """Return an item for each joint with another sign, then for each with another zero."""
    items_of_joints = []
    for i in unknowns.flipped_joints:
        name = problem.second.axes[i].name
        text = f"joint '{name}' turns the other way"
        if problem.kinds[i] == "prismatic":
            text = f"joint '{name}' slides the other way"
        items_of_joints.append(ComparedItem("sign", name, text, turn=np.pi))
    for i in moved_zeros(problem, unknowns):
        name = problem.second.axes[i].name
        shift = zero_of(problem, unknowns, i)
        is_angle = problem.axes[i].is_angle
        size = moved(shift, is_angle)
        first = problem.first.label
        second = problem.second.label
        text = f"the zero of joint '{name}' is moved: {first} is at {size} where {second} is at 0"
        if is_angle:
            items_of_joints.append(ComparedItem("zero", name, text, turn=abs(shift)))
        else:
            items_of_joints.append(ComparedItem("zero", name, text, shift=abs(shift)))
    return items_of_joints


def _tool_items(problem: FitProblem, unknowns: Unknowns) -> list[ComparedItem]:
    """Return an item for each leaf link whose frames are moved; the size is that of the first frame."""
    moved_frames: dict[int, list[FrameGap]] = {}
    for gap in frame_gaps(problem, unknowns):
        if gap.leaf and gap.differs(problem):
            moved_frames.setdefault(gap.joint, []).append(gap)
    items_of_tools = []
    for joint, frames in moved_frames.items():
        quoted_names = []
        for gap in frames:
            quoted_names.append(f"'{gap.name}'")
        names = ", ".join(quoted_names)
        # the frames of one link move together: the first shows how far
        gap = frames[0]
        shift = gap.T[:3, 3]
        turn = spatial.log_so3(gap.T[:3, :3])
        noun = "frame" if len(frames) == 1 else "frames"
        size = shift_and_turn_text(shift, turn)
        text = f"{noun} {names} of {problem.first.label} moved by {size} in that of {problem.second.label}"
        name = problem.second.axes[joint].name
        length = float(np.linalg.norm(shift))
        items_of_tools.append(ComparedItem("tool frame", name, text, gap.name, length, float(np.linalg.norm(turn))))
    return items_of_tools


def _link_items(problem: FitProblem, unknowns: Unknowns) -> list[ComparedItem]:
    """Return an item for each deviating joint: its place on its parent link, or its axis alone."""
    items_of_links = []
    for k, deviation in enumerate(unknowns.deviating):
        assert unknowns.deviations is not None
        i = deviation.joint
        values = unknowns.deviations[k]
        axis = problem.axes[i]
        second = problem.second.axes[i]
        turn = problem.frames[i] @ values[:3]
        shift = problem.frames[i] @ values[3:]
        link = problem.second.groups[second.parent].bodies[-1]
        text = f"the place of joint '{second.name}' on link '{link}' differs by {shift_and_turn_text(shift, turn)}"
        if deviation.axis_only:
            text = f"the axis of joint '{second.name}' on link '{link}' is turned by {shift_and_turn_text(shift, turn)}"
        before = carrier_of_groups(problem).get(axis.parent)
        if before is not None:
            text += f" ({_line_distances_text(problem, before, i)})"
        length = float(np.linalg.norm(shift))
        items_of_links.append(ComparedItem("link", second.name, text, link, length, float(np.linalg.norm(turn))))
    return items_of_links


def _line_distances_text(problem: FitProblem, i: int, k: int) -> str:
    """Return the distance and the angle of the lines of two joints of one link in both sides."""
    name = problem.second.axes[i].name
    parts = []
    for points, directions in (
        (problem.points, problem.directions),
        (problem.target_points, problem.target_directions),
    ):
        distance, angle = line_distance(points[i], directions[i], points[k], directions[k])
        parts.append(f"{mm(distance)} at {deg(angle)}")
    if parts[0] == parts[1]:
        return f"its axis and that of '{name}' are {parts[0]} in both"
    return f"its axis and that of '{name}': {parts[0]} in {problem.first.label}, {parts[1]} in {problem.second.label}"


def line_distance(p_first: Array, d_first: Array, p_second: Array, d_second: Array) -> tuple[float, float]:
    """Return the distance in m and the angle in rad of two lines, each by a point and a direction."""
    normal = np.cross(d_first, d_second)
    sine = float(np.linalg.norm(normal))
    between = p_second - p_first
    angle = float(np.arctan2(sine, d_first @ d_second))
    if sine < _PARALLEL_SINE:
        return float(np.linalg.norm(np.cross(between, d_first))), angle
    return abs(float(between @ normal)) / sine, angle


def shift_and_turn_text(shift: Array, turn: Array) -> str:
    """Return a shift (3,) in m and a rotation vector (3,) in rad as text."""
    length = float(np.linalg.norm(shift))
    angle = float(np.linalg.norm(turn))
    parts = []
    if length > _SMALLEST_SHOWN:
        parts.append(f"{mm(length)} along {_direction_text(shift / length)}")
    if angle > _SMALLEST_SHOWN:
        parts.append(f"{deg(angle)} about {_direction_text(turn / angle)}")
    return " and ".join(parts) or "nothing"


def motion_text(T: Array) -> str:
    """Return a motion (4, 4) as text."""
    return shift_and_turn_text(T[:3, 3], spatial.log_so3(T[:3, :3]))


def frame_item(kind: str, text: str, T: Array) -> ComparedItem:
    """Return the convention of a frame that is moved by T (4, 4)."""
    shift = float(np.linalg.norm(T[:3, 3]))
    return ComparedItem(kind, "", text, shift=shift, turn=float(spatial.rotation_angle(T[:3, :3])))


def _direction_text(unit: Array) -> str:
    """Return a unit vector (3,) as text: the name of an axis, or its components."""
    for i, name in enumerate("xyz"):
        if abs(unit[i]) > 1 - _SMALLEST_SHOWN:
            sign = "-" if unit[i] < 0 else ""
            return f"{sign}{name}"
    rounded = np.round(unit, 3) + 0.0  # without the sign of -0.0
    return f"({rounded[0]:g}, {rounded[1]:g}, {rounded[2]:g})"
