"""The mechanism's side of a proof: bodies placed joint by joint with exact values, and the joints that must then fit.

Nothing here knows the equations: the values of the joints are given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof import form as forms
from twin.proof import values
from twin.proof.constants import ROOTS, ExactNumber, decimal, exact_angle
from twin.proof.form import Form
from twin.proof.values import Angle, Scalar, Value

ARM = 0.5
"""Distance in m at which differences of directions count."""

LENGTH_TOLERANCE = 1e-10
"""Distance in m within which a length of the CAD is taken as a decimal, or as a decimal multiplied by a root."""

ANGLE_TOLERANCE = 1e-9
"""Difference in rad within which an angle of the CAD is taken as a multiple of 30 or 45 degrees, or as a parameter."""

_COARSE_GRID = 10**5
"""Decimals of what remains of a length after a multiple of a parameter is subtracted: 10 micrometres in m."""

_PARTS = (Fraction(1), Fraction(1, 2), Fraction(2), Fraction(1, 3))
"""Multiples of a parameter that are parts of lengths in drawings."""

_LARGEST_PART = 6
"""Largest numerator and denominator of a part of a parameter in a formula."""

Matrix = list[list[Scalar]]
"""A pose (4, 4), as rows."""


class ExactMechanism:
    """A mechanism whose numbers have exact forms.

    A body is represented by the frame of the first joint that holds it: between two joint frames of one body are the
    lengths and angles of the drawing, whatever frame the CAD gave to the body.

    Attributes:
        mechanism: the mechanism.
        states: number k of states.
        unrecognised: numbers without an exact form, as texts with their body.
        recognised: {length of the CAD as text: its exact form}, for lengths that are no decimals.
        largest: the largest difference in m or rad between a number and its exact form.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        states: int,
        angles: Mapping[str, Angle],
        lengths: Mapping[str, Fraction],
        formulas: bool,
    ) -> None:
        """Choose the frames of the bodies.

        Args:
            mechanism: the mechanism.
            states: number of states.
            angles: {parameter of the equations: angle}; an angle of the CAD may be a sum with one.
            lengths: {parameter of the equations: length in m}; lengths of the CAD may contain them.
            formulas: whether lengths that are parts of a parameter are this part in formulas.
        """
        self.mechanism = mechanism
        self.states = states
        self.unrecognised: list[str] = []
        self.recognised: dict[str, str] = {}
        self.largest = 0.0
        self._angles = angles
        self._lengths = lengths
        self._formulas = formulas
        self._links: dict[tuple[str, str], Matrix] = {}
        self._frames = {mechanism.base: np.eye(4)}
        for joint in mechanism.joints:
            self._frames.setdefault(joint.child, joint.T_child_joint)
            self._frames.setdefault(joint.parent, joint.T_parent_joint)

    def link(self, body: str, T_body_frame: Array, what: str) -> Matrix:
        """Return the pose of a frame of a body, given in the frame of the CAD, in the frame of its first joint."""
        key = (body, T_body_frame.tobytes().hex())
        if key not in self._links:
            T = spatial.inverse(self._frames[body]) @ T_body_frame
            self._links[key] = self._link(T, f"{what} on {body}")
        return self._links[key]

    def point(self, body: str, p_body: Array, what: str) -> list[Scalar]:
        """Return a point (3,) of a body, given in the frame of the CAD, in the frame of its first joint."""
        T = spatial.inverse(self._frames[body])
        p = T[:3, :3] @ p_body + T[:3, 3]
        return [self._length(float(x), f"point {what} on {body}") for x in p]

    def _link(self, T: Array, what: str) -> Matrix:
        """Return a pose as turn about z, shift, turn about x (common normal), shift along z, turn about z."""
        z = T[:3, 2]
        p = T[:3, 3]
        lean = math.hypot(z[0], z[1])
        alpha = math.atan2(lean, z[2])
        theta = 0.0
        along = 0.0
        shift = p
        if lean > ANGLE_TOLERANCE:
            normal = np.array([-z[1], z[0], 0.0]) / lean
            theta = math.atan2(normal[1], normal[0])
            # the feet of the common normal on both axes
            foot, distance, along = np.linalg.solve(np.column_stack([[0.0, 0.0, 1.0], normal, z]), p)
            shift = np.array([distance, 0.0, foot])
        normal = np.array([math.cos(theta), math.sin(theta), 0.0])
        phi = math.atan2(T[:3, 0] @ np.cross(z, normal), T[:3, 0] @ normal)
        bend = self._angle(alpha, what)
        distance = self._length(float(shift[0]), what)
        aside = self._length(float(shift[1]), what)
        foot, beyond = self._feet(float(shift[2]), float(along), alpha, bend, what)
        matrix = compose(turn(self._angle(theta, what), "z"), shifted([distance, aside, foot]))
        matrix = compose(matrix, turn(bend, "x"))
        zero = values.constant(0.0, self.states)
        matrix = compose(matrix, shifted([zero, zero, beyond]))
        return compose(matrix, turn(self._angle(phi, what), "z"))

    def _feet(self, foot: float, along: float, alpha: float, bend: Angle, what: str) -> tuple[Scalar, Scalar]:
        """Return the distances of the feet of the common normal from the origins of both frames.

        If an origin lies at decimal distances from the first axis, the feet are `height - offset / sin(bend)` and
        `offset cos(bend) / sin(bend)`.
        """
        if decimal(along, LENGTH_TOLERANCE) is None and abs(math.sin(2 * alpha)) > ANGLE_TOLERANCE:
            offset = decimal(along * math.tan(alpha), LENGTH_TOLERANCE)
            if offset is not None:
                height = decimal(foot + float(offset) / math.sin(alpha), LENGTH_TOLERANCE)
                if height is not None:
                    scaled = values.product(values.exact(offset, self.states), values.reciprocal(bend.sine))
                    first = values.difference(values.exact(height, self.states), scaled)
                    return first, values.product(scaled, bend.cosine)
        return self._length(foot, what), self._length(along, what)

    def _length(self, value: float, what: str) -> Scalar:
        """Return a length in m: a decimal, a decimal and a root, or a sum with a multiple of a parameter."""
        drawn = decimal(value, LENGTH_TOLERANCE)
        if drawn is not None:
            return self._recognised(drawn, value)
        for length in self._lengths.values():
            for radicand in (1, *ROOTS):
                for part in (*_PARTS, *(-part for part in _PARTS)):
                    factor = part * length
                    rest = value - float(factor) * radicand**0.5
                    fraction = Fraction(round(rest * _COARSE_GRID), _COARSE_GRID)
                    if abs(float(fraction) - rest) <= LENGTH_TOLERANCE:
                        return self._recognised(ExactNumber(fraction, factor, radicand), value)
        self.unrecognised.append(f"{value * 1e3:.9g} mm of {what}")
        return values.unknown(np.full(self.states, value))

    def _angle(self, value: float, what: str) -> Angle:
        """Return an angle in rad: a multiple of 30 or 45 degrees, or a sum of one with a parameter."""
        fixed = self._multiple(value)
        if fixed is not None:
            return fixed
        for parameter in self._angles.values():
            for signed in (parameter, values.turned_back(parameter)):
                fixed = self._multiple(math.remainder(value - signed.published, 2 * math.pi))
                if fixed is not None:
                    return values.turned(fixed, signed)
        self.unrecognised.append(f"{math.degrees(value):.9g} deg of {what}")
        real = np.full(self.states, value)
        return Angle(values.unknown(np.cos(real)), values.unknown(np.sin(real)), real)

    def _multiple(self, value: float) -> Angle | None:
        found = exact_angle(value, ANGLE_TOLERANCE)
        if found is None:
            return None
        cosine, sine = found
        exact_value = math.atan2(float(sine), float(cosine))
        self.largest = max(self.largest, abs(math.remainder(value - exact_value, 2 * math.pi)))
        real = np.full(self.states, exact_value)
        return Angle(values.exact(cosine, self.states), values.exact(sine, self.states), real)

    def _recognised(self, found: ExactNumber, value: float) -> Scalar:
        self.largest = max(self.largest, abs(float(found) - value))
        if found.radicand != 1 and found.factor:
            self.recognised[f"{value * 1e3:.9g} mm"] = f"{found.in_mm} mm"
        length = values.exact(found, self.states)
        if self._formulas and found.factor and not found.rational:
            return replace(length, form=self._form(found) or length.form)
        return length

    def _form(self, found: ExactNumber) -> Form | None:
        """Return a length as a part of a parameter; None if it is none."""
        for name, length in self._lengths.items():
            if not length:
                continue
            part = found.factor / length
            if part.denominator <= _LARGEST_PART and abs(part.numerator) <= _LARGEST_PART:
                root = forms.number(ExactNumber(Fraction(0), part, found.radicand))
                return forms.product(root, forms.variable(name))
        return None


# ------------------------------------------------------------------------------------------- poses


def compose(A: Matrix, B: Matrix) -> Matrix:
    """Return A B of two poses."""
    rows = []
    for i in range(3):
        row = []
        for j in range(4):
            entry = A[i][3] if j == 3 else None
            for k in range(3):
                term = values.product(A[i][k], B[k][j])
                entry = term if entry is None else values.total(entry, term)
            row.append(entry)
        rows.append(row)
    return [*rows, B[3]]


def inverse(A: Matrix) -> Matrix:
    """Return the inverse of a pose: the transposed rotation, and the origin of the other frame."""
    states = len(A[0][0].real)
    rows = []
    for i in range(3):
        moved = values.constant(0.0, states)
        for k in range(3):
            moved = values.difference(moved, values.product(A[k][i], A[k][3]))
        rows.append([A[0][i], A[1][i], A[2][i], moved])
    return [*rows, A[3]]


def identity(states: int) -> Matrix:
    """Return the pose without motion."""
    return [[values.constant(float(i == j), states) for j in range(4)] for i in range(4)]


def turn(angle: Angle, axis: Literal["x", "z"]) -> Matrix:
    """Return the rotation about the x or the z axis."""
    T = identity(len(angle.real))
    first, second = {"x": (1, 2), "z": (0, 1)}[axis]
    T[first][first] = angle.cosine
    T[first][second] = values.minus(angle.sine)
    T[second][first] = angle.sine
    T[second][second] = angle.cosine
    return T


def shifted(p: Sequence[Scalar]) -> Matrix:
    """Return the translation by a vector (3,)."""
    T = identity(len(p[0].real))
    for i in range(3):
        T[i][3] = p[i]
    return T


def motion(joint: Joint, value: Value, states: int) -> Matrix:
    """Return the motion of a joint at the value of its coordinate: about z, or along z."""
    zero = values.constant(0.0, states)
    if joint.type == "revolute":
        return turn(values.angle(value), "z")
    if joint.type == "prismatic":
        return shifted([zero, zero, values.scalar(value)])
    return identity(states)


def moved(T: Matrix, p: Sequence[Scalar]) -> list[Scalar]:
    """Return a point (3,) of a body in the frame of its pose T."""
    out = []
    for i in range(3):
        coordinate = T[i][3]
        for k in range(3):
            coordinate = values.total(coordinate, values.product(T[i][k], p[k]))
        out.append(coordinate)
    return out


# ------------------------------------------------------------------------------------------- bodies


@dataclass(frozen=True)
class PlacedBodies:
    """Poses of bodies in base, and the joints that were not needed to place them.

    Attributes:
        poses: {body: pose of the frame of its first joint}.
        closing: joints between placed bodies, whose conditions remain to be shown.
        missing: bodies that no joint with a known value reaches.
    """

    poses: dict[str, Matrix]
    closing: list[Joint]
    missing: list[str]


def frames(exact: ExactMechanism, joint: Joint) -> tuple[Matrix, Matrix]:
    """Return the two frames of a joint, on its parent and on its child."""
    what = f"joint {joint.name}"
    first = exact.link(joint.parent, joint.T_parent_joint, what)
    return first, exact.link(joint.child, joint.T_child_joint, what)


def place(exact: ExactMechanism, joints: Mapping[str, Value], T_base_tool: Matrix | None) -> PlacedBodies:
    """Place bodies from the base, and from the tool if its pose is given, by joints with known values.

    Args:
        exact: the mechanism.
        joints: {joint: its value}; a joint without a value places no body.
        T_base_tool: pose of the tool frame; None if the joints determine it.
    """
    mechanism = exact.mechanism
    poses = {mechanism.base: identity(exact.states)}
    if T_base_tool is not None:
        tool = mechanism.frame(mechanism.tool)
        T_body_tool = exact.link(tool.body, tool.T_body_frame, f"frame {tool.name}")
        poses[tool.body] = compose(T_base_tool, inverse(T_body_tool))
    pending = list(mechanism.joints)
    advanced = True
    while advanced:
        advanced = False
        for joint in list(pending):
            placed = {joint.parent, joint.child} & set(poses)
            if len(placed) != 1 or not (joint.type == "fixed" or joint.name in joints):
                continue
            T_parent_joint, T_child_joint = frames(exact, joint)
            T_joint_child = inverse(T_child_joint)
            step = T_parent_joint
            if joint.type != "fixed":
                step = compose(step, motion(joint, joints[joint.name], exact.states))
            T_parent_child = compose(step, T_joint_child)
            if joint.parent in poses:
                poses[joint.child] = compose(poses[joint.parent], T_parent_child)
            else:
                poses[joint.parent] = compose(poses[joint.child], inverse(T_parent_child))
            pending.remove(joint)
            advanced = True
    closing = [joint for joint in pending if joint.parent in poses and joint.child in poses]
    missing = [body.name for body in mechanism.bodies if body.name not in poses]
    return PlacedBodies(poses, closing, missing)


def slides(exact: ExactMechanism, placed: PlacedBodies) -> Iterator[tuple[str, str, list[Scalar]]]:
    """Yield (body, sentence, numbers that are zero) of bodies between a slide and a ball joint, as a cannula.

    Such a body is not placed; the centre of its ball must be on the line along which it slides.
    """
    for name in placed.missing:
        joints = [joint for joint in exact.mechanism.joints if name in (joint.parent, joint.child)]
        kinds = {joint.type: joint for joint in joints}
        if len(joints) != 2 or set(kinds) != {"prismatic", "spherical"}:
            continue
        slide = kinds["prismatic"]
        ball = kinds["spherical"]
        if any(_other_end(joint, name)[0] not in placed.poses for joint in joints):
            continue
        carrier, T_carrier_slide = _other_end(slide, name)
        holder, T_holder_ball = _other_end(ball, name)
        T_base_slide = compose(placed.poses[carrier], exact.link(carrier, T_carrier_slide, f"joint {slide.name}"))
        T_base_ball = compose(placed.poses[holder], exact.link(holder, T_holder_ball, f"joint {ball.name}"))
        centre = compose(inverse(T_base_slide), T_base_ball)
        T_body_slide = exact.link(name, _own_end(slide, name), f"joint {slide.name}")
        T_body_ball = exact.link(name, _own_end(ball, name), f"joint {ball.name}")
        own = compose(inverse(T_body_slide), T_body_ball)
        numbers = [values.difference(centre[i][3], own[i][3]) for i in range(2)]
        yield name, f"{carrier} slides through the ball of {name} in {holder}", numbers


def _other_end(joint: Joint, body: str) -> tuple[str, Array]:
    """Return the body at the other end of a joint, and the joint's frame there."""
    if joint.child == body:
        return joint.parent, joint.T_parent_joint
    return joint.child, joint.T_child_joint


def _own_end(joint: Joint, body: str) -> Array:
    """Return the joint's frame on a body."""
    if joint.child == body:
        return joint.T_child_joint
    return joint.T_parent_joint


def conditions(exact: ExactMechanism, placed: PlacedBodies, joint: Joint, value: Value | None) -> Iterator[Scalar]:
    """Yield the numbers that are zero if a joint fits between two placed bodies.

    The relative pose of the two joint frames must be the motion of the joint: a ball has its centre in the socket, a
    pin has its axis in the bore; if the value of the coordinate is given, it must be this value.
    """
    T_parent_joint, T_child_joint = frames(exact, joint)
    T_base_first = compose(placed.poses[joint.parent], T_parent_joint)
    T_base_second = compose(placed.poses[joint.child], T_child_joint)
    T = compose(inverse(T_base_first), T_base_second)
    if value is not None and joint.type in ("revolute", "prismatic"):
        T = compose(inverse(motion(joint, value, exact.states)), T)
        yield from deviations(T, identity(exact.states))
        return
    if joint.type == "free":
        return
    yield T[0][3]
    yield T[1][3]
    if joint.type in ("fixed", "revolute", "spherical"):
        yield T[2][3]
    if joint.type in ("revolute", "cylindrical", "prismatic", "fixed"):
        yield _at_arm(T[0][2])
        yield _at_arm(T[1][2])
    if joint.type in ("prismatic", "fixed"):
        yield _at_arm(T[1][0])


def deviations(A: Matrix, B: Matrix) -> Iterator[Scalar]:
    """Yield the differences of the entries of two poses."""
    for i in range(3):
        for j in range(3):
            yield _at_arm(values.difference(A[i][j], B[i][j]))
        yield values.difference(A[i][3], B[i][3])


def _at_arm(entry: Scalar) -> Scalar:
    """Return a difference of directions whose real value is a distance in m."""
    return replace(entry, real=ARM * entry.real)
