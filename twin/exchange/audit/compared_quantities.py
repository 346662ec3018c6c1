"""The quantities by which files are compared, of links, joints, frames and motors: differences, tolerances, texts.

A new quantity is one entry of `QUANTITIES`, and one call of `FileView.state` in `stated_values`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Severity
from twin.exchange.audit import value_differences as differences
from twin.exchange.audit.colors import color_difference
from twin.exchange.audit.value_differences import Value
from twin.exchange.audit.value_text import quantity

NOTHING = "nothing"
"""Text of further declarations where a file has none."""

MAX_OTHER_SHARE = 5e-4
"""Part of a link's surface that may have another colour: rounding of points changes areas by less than 1e-5 of it.

The heads of its screws are some thousandths of a link's surface, and a colour that is wrong there is seen."""


@dataclass(frozen=True)
class FoundDifference:
    """The value of a quantity in a file that is not the right one.

    Attributes:
        subject: what has the quantity, such as "joint 'q1'".
        words: the quantity in words.
        rule: its rule.
        stated: the value in the file.
        expected: the right value.
        size: the difference of the two, as the rule measures it.
        others: the files with the right value, as text.
    """

    subject: str
    words: str
    rule: ComparisonRule
    stated: Value
    expected: Value
    size: float
    others: str


Message = Callable[[FoundDifference], str]
"""Function that returns the text of a finding."""

Difference = Callable[[Value, Value], float]
"""Function that returns the difference of two values of a quantity."""


def _values_message(found: FoundDifference) -> str:
    expected_text = f"{_value_text(found.expected)} {found.rule.unit}".rstrip()
    return f"{found.subject}: {found.words} is {_value_text(found.stated)}; in {found.others} it is {expected_text}."


def _ratio_message(found: FoundDifference) -> str:
    """Return the message of two numbers, with their ratio."""
    ratio = f" (x {found.stated / found.expected:.4g})" if found.expected else ""
    stated_text = f"{found.stated:.6g} {found.rule.unit}".rstrip()
    expected_text = f"{found.expected:.6g} {found.rule.unit}".rstrip()
    return f"{found.subject}: {found.words} is {stated_text}; in {found.others} it is {expected_text}{ratio}."


def _existence_message(found: FoundDifference) -> str:
    if found.stated:
        return f"{found.subject} is in this file, but not in {found.others}."
    return f"{found.subject} is missing; it is in {found.others}."


def _predicate_message(false: str, true: str) -> Message:
    """Return the message of a value that is False or True, with the predicates for both."""
    phrases = (false, true)

    def message(found: FoundDifference) -> str:
        stated_phrase = phrases[bool(found.stated)]
        expected_phrase = phrases[bool(found.expected)]
        return f"{found.subject} {stated_phrase}; in {found.others} it {expected_phrase}."

    return message


def _distance_message(found: FoundDifference) -> str:
    return f"{found.subject}: {found.words} differs by {quantity(found.size, 'm')} from {found.others}."


def _pose_message(found: FoundDifference) -> str:
    """Return the message of two poses: by which distance, angle or both they differ more than the tolerance."""
    shift, angle = differences.shift_and_angle(found.expected, found.stated)
    parts = []
    if shift > found.rule.tolerance:
        parts.append(quantity(shift, "m"))
    if differences.ANGLE_ARM * angle > found.rule.tolerance:
        parts.append(f"{math.degrees(angle):.4g} deg")
    size = " and ".join(parts) or quantity(found.size, "m")  # not finite: none of the two exceeds the tolerance
    return f"{found.subject}: {found.words} differs by {size} from {found.others}."


def _surface_message(found: FoundDifference) -> str:
    return f"{found.subject}: a point of its mesh is {quantity(found.size, 'm')} from the mesh of {found.others}."


def _share_message(what: str) -> Message:
    """Return the message of the share of a link's surface that has another look."""

    def message(found: FoundDifference) -> str:
        return f"{found.subject}: {100 * found.size:.3g} % of its surface has {what} in {found.others}."

    return message


def _inertia_message(found: FoundDifference) -> str:
    """Return the message of two tensors: by how much entries differ, or else the moments about one axis."""
    by_entry = differences.entry_difference(found.expected, found.stated)
    by_moment = differences.moment_difference(found.expected, found.stated)
    if differences.SLENDER_WEIGHT * by_moment > by_entry:
        return (
            f"{found.subject}: moment of inertia about one axis differs from {found.others} by {100 * by_moment:.3g} %."
        )
    return f"{found.subject}: inertia differs from {found.others} by {100 * by_entry:.3g} %."


def _axis_message(found: FoundDifference) -> str:
    stated_direction, _ = found.stated
    expected_direction, _ = found.expected
    stated_text = _vector_text(stated_direction)
    return (
        f"{found.subject}: {found.words} is {stated_text}; in {found.others} it is {_vector_text(expected_direction)}."
    )


def _opening_message(found: FoundDifference) -> str:
    stated_text = f"{found.stated:.4g} {found.rule.unit}"
    expected_text = f"{found.expected:.4g} {found.rule.unit}"
    return (
        f"{found.subject} open by {stated_text} if 1 g pulls at them, by the parameters of the solver; in "
        f"{found.others} by {expected_text}."
    )


def _vector_text(components: Iterable[float]) -> str:
    """Return the components of a vector as text, such as "(0, 0, -9.81)"."""
    return f"({', '.join(map('{:.4g}'.format, components))})"


def _value_text(value: Value) -> str:
    """Return a value as text: a vector, a row {joint: factor}, a range, a list of names, or a word."""
    if isinstance(value, np.ndarray):
        return _vector_text(value)
    if isinstance(value, Mapping):
        terms = []
        for joint, factor in value.items():
            terms.append(f"{factor:.9g} {joint}")
        return " + ".join(terms) or "nothing"
    if isinstance(value, tuple):
        if value and all(isinstance(entry, int | float) for entry in value):
            numbers = list(map("{:g}".format, value))
            if len(numbers) == 2:
                return " .. ".join(numbers)
            return f"({', '.join(numbers)})"
        return ", ".join(map(str, value)) or "nothing"
    return str(value)


@dataclass(frozen=True)
class ComparisonRule:
    """One compared quantity.

    Attributes:
        difference: function that returns the difference between two values.
        tolerance: maximum difference between equal values.
        unit: unit of the values, and of the difference if `relative` is False.
        relative: whether `difference` returns a relative difference.
        severity: severity of a difference: a "warning" where the motion stays the same, or authors may choose.
        by_majority: whether a difference is reported only if the mechanism, or two sources, state the other value.
        usual: the right value if any source states it, whatever the others state; None if there is no such value.
        is_check: whether reports list the comparison as a check. A proof.json that was written before a quantity was
            compared lacks its check, which is a finding; where only differences count, none is listed.
        words: the quantity as text; "": its name is words.
        message: function that returns the text of a finding.
    """

    difference: Difference
    tolerance: float
    unit: str = ""
    relative: bool = False
    severity: Severity = "disagreement"
    by_majority: bool = False
    usual: str | None = None
    is_check: bool = True
    words: str = ""
    message: Message = _values_message

    @property
    def unit_of_difference(self) -> str:
        """Unit of what `difference` returns; "" for a relative difference."""
        if self.relative:
            return ""
        return self.unit


def _equality(
    words: str = "",
    message: Message = _values_message,
    *,
    severity: Severity = "disagreement",
    usual: str | None = None,
    is_check: bool = True,
) -> ComparisonRule:
    """Return the rule of values that are equal or not: words, names, truth values."""
    return ComparisonRule(
        differences.word_difference,
        0.0,
        severity=severity,
        usual=usual,
        is_check=is_check,
        words=words,
        message=message,
    )


def _relative_number(unit: str, words: str = "", tolerance: float = 1e-5) -> ComparisonRule:
    """Return the rule of numbers whose relative difference counts; 1e-5 is above the rounding to six digits."""
    return ComparisonRule(differences.number_difference, tolerance, unit, True, words=words, message=_ratio_message)


def _position(words: str = "", difference: Difference = differences.distance) -> ComparisonRule:
    """Return the rule of positions: two are rounded to 0.001 mm in each coordinate."""
    return ComparisonRule(difference, 2e-6, "m", words=words, message=_distance_message)


def _pose(words: str, tolerance: float) -> ComparisonRule:
    """Return the rule of poses, with a tolerance in m that counts an angle by `ANGLE_ARM`."""
    return ComparisonRule(differences.pose_difference, tolerance, "m", words=words, message=_pose_message)


_MASS_MESSAGE = _predicate_message("has no mass", "has a mass")
_MESH_MESSAGE = _predicate_message("has no mesh", "has a mesh")
_DRIVEN_MESSAGE = _predicate_message("is passive", "is driven")
_COLLIDER_MESSAGE = _predicate_message("has a mesh whose collider is disabled", "collides")
_CLOSED_MESSAGE = _predicate_message("has an open mesh", "has closed meshes")
_JOINT_DYNAMICS_WORDS = "stiffness, damping, friction and inertia of the joint itself"
_M_OR_RAD = "m or rad"

QUANTITIES: Mapping[str, ComparisonRule] = {
    # Of links: True or False, numbers, (3,), (3, 3).
    "weighed": _equality("presence of a mass", _MASS_MESSAGE),
    "mass": _relative_number("kg"),
    "mass centre": _position(),
    "inertia": ComparisonRule(differences.inertia_difference, 1e-5, "", True, message=_inertia_message),
    # Of everything: True or False.
    "existence": _equality("presence in the file", _existence_message),
    # Of joints: name; kind as `FileJoint.kind`; tuple of the names of its links, in alphabetical order.
    "name": _equality(),
    "kind": _equality(),
    "links": _equality(),
    # Of a joint on one link: (point (3,), direction (3,) or None); (direction (3,), whether its sign counts).
    "place": _position("axis or centre of the joint", differences.line_difference),
    "axis": ComparisonRule(differences.axis_difference, 1e-5, message=_axis_message),
    # Poses (4, 4) of the second link in the first: of a fixed joint; of another at its coordinate 0.
    "pose": _pose("relative pose of the two links", 5e-6),
    "zero": _pose("relative pose of the two links at zero", 5e-6),
    # Of joints and motors, as `FileDrive` and `FileMotor` state them.
    "limits": ComparisonRule(differences.limit_difference, 1e-5, _M_OR_RAD),
    "soft limits": ComparisonRule(differences.limit_difference, 1e-5, _M_OR_RAD),
    "cone": ComparisonRule(differences.limit_difference, 1e-5, "rad"),
    "axis of its cone": ComparisonRule(differences.direction_difference, 1e-5),
    "driven": _equality("driven or passive", _DRIVEN_MESSAGE),
    "stiffness": _relative_number("N/m or N m/rad"),
    "damping": _relative_number("N s/m or N m s/rad"),
    "largest effort": _relative_number("N or N m", "maximum effort"),
    "largest speed": _relative_number("m/s or rad/s", "maximum speed"),
    "largest acceleration": _relative_number("m/s2 or rad/s2", "maximum acceleration"),
    "largest jerk": _relative_number("m/s3 or rad/s3", "maximum jerk"),
    # Of frames and points: pose (4, 4) or position (3,) on the link; name of the link.
    "frame pose": _pose("pose of the frame on its link", 2e-6),
    "point": _position("position of the point on its link"),
    "link": _equality("link of the frame"),
    # Of the meshes of links: True or False; points (n, 3); {colour: share of the surface}.
    "shown": _equality("presence of a mesh", _MESH_MESSAGE),
    "collides": _equality("", _COLLIDER_MESSAGE, is_check=False),
    "surface": ComparisonRule(
        differences.surface_difference, differences.SAME_POINT_TOL, "m", message=_surface_message
    ),
    "closed": _equality("closed or open meshes", _CLOSED_MESSAGE),
    "colours": ComparisonRule(color_difference, MAX_OTHER_SHARE, message=_share_message("a different colour")),
    "finish": ComparisonRule(
        color_difference,
        MAX_OTHER_SHARE,
        severity="warning",
        words="metallic and roughness",
        message=_share_message("another metallic or roughness"),
    ),
    # Of the world, as `FileMechanism` states them; "held" is the tuple of `FileMechanism.immobile_links`.
    "gravity": ComparisonRule(differences.distance, 1e-3, "m/s2"),
    "medium": ComparisonRule(differences.largest_difference, 1e-9, "(kg/m3, Pa s, wind in m/s)"),
    "collisions of its own links": _equality(),
    "held": _equality("bodies fixed to the world"),
    # Of couplings in reduced row echelon form: ratios (n,) of the joints, and their constant.
    "ratios": ComparisonRule(differences.ratio_difference, 1e-5),
    "sum": ComparisonRule(differences.distance, 1e-6, _M_OR_RAD),
    # Of the loops: twin writes parameters by which they open by 0.1 um or urad at most.
    "opening": ComparisonRule(
        differences.distance,
        1e-7,
        _M_OR_RAD,
        words="opening of the loops if 1 g pulls at them",
        message=_opening_message,
    ),
    # Further ones of joints, links and motors, as `FileDrive`, `FileMechanism` and `FileMotor` state them.
    "passive": ComparisonRule(differences.largest_difference, 1e-9, words=_JOINT_DYNAMICS_WORDS),
    "law": _equality("quantity that the gains of the drive give"),
    "breaks": _relative_number("N", "force at which the joint breaks"),
    "weightless": ComparisonRule(differences.distance, 1e-9, words="share of its weight that is compensated"),
    "reduction": _relative_number("", "reduction of its transmission", tolerance=1e-6),
    "row": ComparisonRule(differences.row_difference, 1e-6, "", True, words="joint factors of the transmission"),
    # Of the robot and its postures: names, {joint: coordinate}, a coordinate.
    "robot": ComparisonRule(
        differences.name_difference, 0.0, severity="warning", by_majority=True, words="name of the robot"
    ),
    "name of the tool": _equality(),
    "coordinates": ComparisonRule(differences.coordinate_difference, 1e-5, _M_OR_RAD, severity="warning"),
    "home coordinates": ComparisonRule(
        differences.coordinate_difference, 1e-5, _M_OR_RAD, severity="warning", is_check=False, words="coordinates"
    ),
    "home": ComparisonRule(
        differences.distance, 1e-5, _M_OR_RAD, severity="warning", is_check=False, words="coordinate at home"
    ),
    "range of control": ComparisonRule(differences.limit_difference, 1e-5, _M_OR_RAD, severity="warning"),
    # Of what formats declare beside all others: text.
    "further declarations": _equality(usual=NOTHING),
    "declarations of contact or look": _equality(severity="warning", usual=NOTHING),
    "settings of single programs": _equality(severity="warning", usual=NOTHING),
    "rotor inertia": _relative_number("kg m2 or kg"),
}
"""Rule of comparison for each quantity of links, joints, frames, couplings, motors and the world."""


def words_of(name: str) -> str:
    """Return a quantity of `QUANTITIES` in words."""
    return QUANTITIES[name].words or name


def difference_text(subject: str, name: str, stated: Value, expected: Value, size: float, others: str) -> str:
    """Return the finding that a file states the value `stated`, and not the value `expected` of the files `others`.

    `size` is the difference of the two, by the rule of the quantity `name`.
    """
    rule = QUANTITIES[name]
    return rule.message(FoundDifference(subject, words_of(name), rule, stated, expected, size, others))
