"""The joints that close the loops of a mechanism, as a workspace certificate states them, and their derivatives.

Each such joint is between the ends of two paths of frames and joints, which begin at the base or at the tool:

    T_first_second = inverse(end of the first path) @ end of the second
    closing conditions: entries of T_first_second that are 0 if the joint is closed, such as x and y of its position

Derivatives are those of complex steps, exact to rounding: f'(x) = imag f(x + i h) / h for a tiny h. Neither the
prover's intervals nor its derivatives are used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.core.json_types import JsonMapping

Numbers = NDArray[np.complex128]
Reals = NDArray[np.float64]

_COMPLEX_STEP = 1e-20
"""Step along the imaginary axis; its square is below any rounding."""

_TYPES = ("fixed", "revolute", "prismatic", "cylindrical", "spherical")
"""Types of joints that close loops."""

_MOTIONS = ("turn", "slide")
"""Kinds of the steps of a path that are joints: about and along z."""

_FRAMES = ("frame", "inverse")
"""Kinds of the steps with a constant frame, and with the inverse of one."""


@dataclass(frozen=True)
class StatedPathStep:
    """A step of a path: a constant frame, or a joint.

    Attributes:
        kind: one of `_FRAMES` or `_MOTIONS`.
        frame: pose (4, 4), or (k, 4, 4) for k displaced mechanisms; the identity for a joint.
        joint: number of the joint; -1 for a frame.
        sign: 1 if the joint is passed from parent to child, else -1.
    """

    kind: str
    frame: Reals
    joint: int = -1
    sign: float = 1.0


@dataclass(frozen=True)
class StatedPath:
    """A path to the frame of a closing joint; `from_tool` is whether it begins at the tool, and not at the base."""

    from_tool: bool
    steps: tuple[StatedPathStep, ...]

    def end(self, x: Numbers, tool: Numbers) -> Numbers:
        """Return the poses (k, 4, 4) of the end at joint values x (k, n) and poses (k, 4, 4) of the tool."""
        T: Numbers = np.broadcast_to(np.eye(4, dtype=np.complex128), tool.shape)
        if self.from_tool:
            T = tool
        for step in self.steps:
            if step.kind == "frame":
                T = T @ step.frame.astype(np.complex128)
            elif step.kind == "inverse":
                T = T @ np.linalg.inv(step.frame).astype(np.complex128)
            else:
                T = T @ _motion(step.kind, step.sign * x[:, step.joint])
        return T


@dataclass(frozen=True)
class StatedClosure:
    """A joint that closes a loop; `cone` is the half angle in rad that limits a ball joint, or None."""

    type: str
    cone: float | None
    first: StatedPath
    second: StatedPath


class AxisCosine(NamedTuple):
    """Cosine (k,) of the angle between an axis of a joint and the same axis of its other frame, and its minimum."""

    cosine: Numbers
    minimum: float


@dataclass(frozen=True)
class StatedClosures:
    """All closing joints of a mechanism with `joint_count` coordinates; x (k, n) are those of k states."""

    closures: tuple[StatedClosure, ...]
    joint_count: int

    def conditions(self, x: Numbers, tool: Numbers) -> tuple[Numbers, list[AxisCosine]]:
        """Return the closing conditions (k, rows), in m and as sines, and the cosines of axes."""
        rows = []
        cosines = []
        for closure in self.closures:
            first = closure.first.end(x, tool)
            second = closure.second.end(x, tool)
            R_transposed = np.swapaxes(first[:, :3, :3], 1, 2)
            R_first_second = R_transposed @ second[:, :3, :3]
            shift = (R_transposed @ (second - first)[:, :3, 3:])[..., 0]
            rows += [shift[:, 0], shift[:, 1]]
            if closure.type in ("spherical", "revolute", "fixed"):
                rows.append(shift[:, 2])
            # The products of two axes vanish at right angles; the cosines tell the axes from their opposites.
            if closure.type != "spherical":
                rows += [R_first_second[:, 0, 2], R_first_second[:, 1, 2]]
                cosines.append(AxisCosine(R_first_second[:, 2, 2], 0.0))
            if closure.type in ("prismatic", "fixed"):
                rows.append(R_first_second[:, 0, 1])
                cosines.append(AxisCosine(R_first_second[:, 1, 1], 0.0))
            if closure.cone is not None:
                cosines.append(AxisCosine(R_first_second[:, 2, 2], math.cos(closure.cone)))
        return np.stack(rows, axis=1), cosines

    def by_joints(self, x: Numbers, tool: Numbers, joints: Sequence[int]) -> Reals:
        """Return the derivatives (k, rows, len(joints)) of the conditions by the coordinates with these numbers."""
        columns = []
        for joint in joints:
            stepped = x.real.astype(np.complex128)
            stepped[:, joint] += 1j * _COMPLEX_STEP
            columns.append(self._derivative(stepped, tool))
        if not columns:
            conditions, _ = self.conditions(x, tool)
            return np.zeros((*conditions.shape, 0))
        return np.stack(columns, axis=2)

    def by_tool(self, x: Numbers, tool: Numbers) -> Reals:
        """Return the derivatives (k, rows, 6) by shifts and turns of the tool about its origin, along base's axes."""
        real_x = x.real.astype(np.complex128)
        columns = []
        for axis in range(3):
            stepped_tool = tool.copy()
            stepped_tool[:, axis, 3] += 1j * _COMPLEX_STEP
            columns.append(self._derivative(real_x, stepped_tool))
        for axis in range(3):
            second, third = (axis + 1) % 3, (axis + 2) % 3
            stepped_tool = tool.copy()
            # the velocity of each axis of the tool is the cross product of the unit vector with it
            stepped_tool[:, second, :3] -= 1j * _COMPLEX_STEP * tool[:, third, :3]
            stepped_tool[:, third, :3] += 1j * _COMPLEX_STEP * tool[:, second, :3]
            columns.append(self._derivative(real_x, stepped_tool))
        return np.stack(columns, axis=2)

    def _derivative(self, stepped_x: Numbers, stepped_tool: Numbers) -> Reals:
        """Return the derivatives (k, rows) in the direction of a complex step that x or the tool has taken."""
        conditions, _ = self.conditions(stepped_x, stepped_tool)
        return conditions.imag / _COMPLEX_STEP

    def displaced(self, tolerance: float, count: int, generator: np.random.Generator) -> StatedClosures:
        """Return `count` mechanisms, one for each state: their frames are off by up to a tolerance in m.

        Equal frames are displaced equally, because one joint can be on several paths; the tool's frame is not
        displaced.
        """
        displaced_frames: dict[bytes, Reals] = {}

        def displaced_path(path: StatedPath) -> StatedPath:
            steps = []
            for number, step in enumerate(path.steps):
                is_tool = path.from_tool and number == 0
                if step.kind in _FRAMES and not is_tool:
                    key = step.frame.tobytes()
                    if key not in displaced_frames:
                        frames = np.tile(step.frame, (count, 1, 1))
                        frames[:, :3, 3] += generator.uniform(-tolerance, tolerance, (count, 3))
                        displaced_frames[key] = frames
                    step = replace(step, frame=displaced_frames[key])
                steps.append(step)
            return StatedPath(path.from_tool, tuple(steps))

        closures = []
        for closure in self.closures:
            first = displaced_path(closure.first)
            second = displaced_path(closure.second)
            closures.append(replace(closure, first=first, second=second))
        return StatedClosures(tuple(closures), self.joint_count)

    def largest_redundant_gap(self, tolerance: float) -> float:
        """Return the largest gap in m of loops that follow from others, if each frame is off by a tolerance in m."""
        largest_frame_count = 0
        for closure in self.closures:
            frame_count = 0
            for step in (*closure.first.steps, *closure.second.steps):
                frame_count += step.kind in _FRAMES
            largest_frame_count = max(largest_frame_count, frame_count)
        # each of the three coordinates of a frame may be off by the tolerance
        return largest_frame_count * math.sqrt(3) * tolerance


def stated_closures(data: JsonMapping) -> StatedClosures:
    """Return the closing joints of a certificate; `workspace_certificate` describes its entries.

    Raises:
        ValueError, KeyError, TypeError, IndexError: the certificate was changed.
    """
    joint_count = len(data["joints"])
    closures = []
    for entry in data["closures"]:
        if entry["type"] not in _TYPES:
            raise ValueError(f"a closing joint is {entry['type']!r}")
        first, second = entry["paths"]
        cone: float | None = None
        if entry["cone"] is not None:
            cone = float(entry["cone"])
        closures.append(StatedClosure(entry["type"], cone, _path(first, joint_count), _path(second, joint_count)))
    return StatedClosures(tuple(closures), joint_count)


def _path(entry: JsonMapping, joint_count: int) -> StatedPath:
    steps = []
    for kind, *values in entry["steps"]:
        if kind in _FRAMES:
            (rows,) = values
            frame = np.eye(4)
            frame[:3] = np.array(rows, float)
            steps.append(StatedPathStep(kind, frame))
        elif kind in _MOTIONS:
            joint, sign = values
            # Python would count a negative number from the last joint.
            if not 0 <= joint < joint_count:
                raise ValueError(f"there is no joint {joint}")
            steps.append(StatedPathStep(kind, np.eye(4), joint, float(sign)))
        else:
            raise ValueError(f"a step is {kind!r}")
    return StatedPath(bool(entry["from_tool"]), tuple(steps))


def _motion(kind: str, value: Numbers) -> Numbers:
    """Return the motions (k, 4, 4) of a joint: a turn about z, or a slide along z, by values (k,) in rad or m."""
    motion = np.zeros((len(value), 4, 4), complex)
    motion[:] = np.eye(4)
    if kind == "slide":
        motion[:, 2, 3] = value
        return motion
    motion[:, 0, 0] = motion[:, 1, 1] = np.cos(value)
    motion[:, 1, 0] = np.sin(value)
    motion[:, 0, 1] = -motion[:, 1, 0]
    return motion
