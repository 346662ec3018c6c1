"""A number of a file that places a joint or a link, with file and line, and what another value of it would move."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from twin.comparison.dh_statements import CellStatement
from twin.comparison.side import Axis, RobotSide, plain_name
from twin.core import spatial
from twin.core.spatial import Array

Role = Literal["shift", "turn", "axis"]

_SHORTEST_LENGTH = 1e-9
"""Length of a direction, or of a quaternion, below which it is none."""


@dataclass(frozen=True)
class NumberStatement:
    """One attribute with numbers that place a joint or a link.

    Attributes:
        file, line: where it stands.
        what: element and attribute, such as "joint 'a' origin xyz".
        role: "shift" and "turn" place a link in its parent, "axis" is the direction of a joint.
        values: its numbers.
        kind: how a "turn" is written: "rpy", "euler:<sequence>", "quat"; else "".
        unit: size of an angle in rad.
        link: name of the link or body that it places, or on which the axis is.
        joints, links: names of all joints and links that it moves.
        R_parent_link: (3, 3), for a "shift": the rotation of the same element; its numbers are along the parent's axes.
    """

    file: str
    line: int
    what: str
    role: Role
    values: tuple[float, ...]
    kind: str
    unit: float
    link: str
    joints: frozenset[str]
    links: frozenset[str]
    R_parent_link: Array | None = None

    def applied(self, side: RobotSide, values: Sequence[float] | Array) -> RobotSide | None:
        """Return the side with other numbers here; None without this link in the side, or for an axis of length 0."""
        T_base_link = _frame_of_link(side, self.link)
        if T_base_link is None:
            return None
        if self.role == "axis":
            return self._with_axis(side, T_base_link, values)
        step = self._link_motion(values)
        if step is None:
            return None
        motion = T_base_link @ step @ spatial.inverse(T_base_link)
        axes = []
        for axis in side.axes:
            names = _stated_names(axis)
            if names <= self.joints:
                axis = axis.moved_by(motion)
            elif not names.isdisjoint(self.joints):
                return None  # it parts hinges that stand for a ball
            axes.append(axis)
        frames = {}
        for name, (group, T) in side.frames.items():
            frames[name] = (group, motion @ T if plain_name(name) in self.links else T)
        return replace(side, axes=tuple(axes), frames=frames)

    def moves(self, axis: Axis) -> bool:
        """Return whether other numbers move the line of a joint of the side."""
        return not self.joints.isdisjoint(_stated_names(axis))

    def _with_axis(self, side: RobotSide, T_base_link: Array, values: Sequence[float] | Array) -> RobotSide | None:
        """Return the side with another direction of an axis, whose components are along those of the link."""
        length = float(np.linalg.norm(values))
        if not length > _SHORTEST_LENGTH:  # true also for NaN
            return None
        # files state directions of any length
        direction = T_base_link[:3, :3] @ (np.asarray(values, float) / length)
        axes = []
        for axis in side.axes:
            if plain_name(axis.name) in self.joints:
                axis = replace(axis, direction=direction)
            axes.append(axis)
        return replace(side, axes=tuple(axes))

    def _link_motion(self, values: Sequence[float] | Array) -> Array | None:
        """Return the motion (4, 4) of the link in its own frame if the numbers change to `values`."""
        if self.role == "turn":
            old = self.rotation(self.values)
            new = self.rotation(values)
            if old is None or new is None:
                return None
            return spatial.pose(old.T @ new)
        shift = np.asarray(values, float) - np.asarray(self.values, float)
        # the numbers are along the axes of the parent, the step is along those of the link
        if self.R_parent_link is not None:
            shift = self.R_parent_link.T @ shift
        return spatial.pose(p=shift)

    def own_rotation(self) -> Array | None:
        """Return the rotation (3, 3) that a "turn" states; None if its numbers are no rotation."""
        return self.rotation(self.values)

    def rotation(self, values: Sequence[float] | Array) -> Array | None:
        """Return the rotation (3, 3) that a "turn" would state with other numbers; None if they are no rotation."""
        if self.kind == "quat":
            if not np.linalg.norm(values) > _SHORTEST_LENGTH:
                return None
            return spatial.matrix_from_quat_wxyz(values)
        angles = np.asarray(values, float) * self.unit
        if self.kind == "rpy":
            return _rotation_product(angles[::-1], "zyx")
        return _rotation_product(angles, self.kind.removeprefix("euler:"))


@dataclass(frozen=True)
class PlaceStatement:
    """Position and rotation of one element, together.

    Attributes:
        shift, turn: the two.
        role: "place".
    """

    shift: NumberStatement
    turn: NumberStatement
    role: Literal["place"] = "place"

    @property
    def file(self) -> str:
        """Where it stands."""
        return self.shift.file

    @property
    def line(self) -> int:
        """The first of the lines."""
        return min(self.shift.line, self.turn.line)

    @property
    def what(self) -> str:
        """The element, such as "joint 'a' origin"."""
        return _element_name(self.shift)

    @property
    def values(self) -> tuple[float, ...]:
        """Its numbers, those of the position first."""
        return (*self.shift.values, *self.turn.values)

    def moves(self, axis: Axis) -> bool:
        """Return whether another place moves the line of a joint of the side."""
        return self.shift.moves(axis)

    def applied(self, side: RobotSide, values: Sequence[float] | Array) -> RobotSide | None:
        """Return the side with another place here; None without this link in the side, or if it is no place."""
        turned = self.turn.applied(side, values[3:])
        R_parent_link = self.turn.rotation(values[3:])
        if turned is None or R_parent_link is None:
            return None
        # the link has turned: the same shift is along other axes of it
        return replace(self.shift, R_parent_link=R_parent_link).applied(turned, values[:3])


def place_statements_of(statements: Sequence[NumberStatement | CellStatement]) -> list[PlaceStatement]:
    """Return the elements that state position and rotation."""
    place_statements = []
    for shift, turn in itertools.pairwise(statements):
        if not isinstance(shift, NumberStatement) or not isinstance(turn, NumberStatement):
            continue
        if (shift.role, turn.role) == ("shift", "turn") and _element_name(shift) == _element_name(turn):
            place_statements.append(PlaceStatement(shift, turn))
    return place_statements


def _element_name(statement: NumberStatement) -> str:
    """Return the element of a statement, such as "joint 'a' origin"."""
    element, _, _ = statement.what.rpartition(" ")
    return element


def _rotation_product(angles: Array, sequence: str) -> Array:
    """Return the product (3, 3) of rotations about axes: lower case about moving axes, upper case about fixed axes."""
    numbers = list(map("xyz".index, sequence.lower()))
    axes = np.eye(3)[numbers]
    steps = spatial.exp_so3(np.asarray(angles, float)[:, None] * axes)
    R = np.eye(3)
    for step, letter in zip(steps, sequence, strict=True):
        if letter.islower():
            R = R @ step
        else:
            R = step @ R
    return R


def _stated_names(axis: Axis) -> set[str]:
    """Return the plain names of the joints that the file states for a joint: its parts, or itself."""
    return set(axis.merged_names) or {plain_name(axis.name)}


def _frame_of_link(side: RobotSide, link: str) -> Array | None:
    """Return T_base_link (4, 4) of a link, given by its plain name; None if the side does not have it."""
    for name, (_, T) in side.frames.items():
        if plain_name(name) == link:
            return T
    return None
