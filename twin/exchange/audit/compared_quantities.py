"""The quantities by which files are compared, of links, joints, frames and motors: differences, tolerances, texts."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from twin.core.findings import Severity
from twin.exchange.audit import poses
from twin.exchange.audit.colors import color_difference
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import quantity


def _number(a: float, b: float) -> float:
    """Return the difference of two numbers, relative to the larger one."""
    if a == b:  # also two infinite limits
        return 0.0
    if not (np.isfinite(a) and np.isfinite(b)):
        return np.inf
    return abs(a - b) / max(abs(a), abs(b))


def _row(a: Mapping[str, float], b: Mapping[str, float]) -> float:
    """Return the relative difference between two mappings {joint: factor}; a missing joint has the factor 0."""
    joints = dict.fromkeys((*a, *b))
    factors = np.zeros((len(joints), 2))
    for i, joint in enumerate(joints):
        factors[i] = (a.get(joint, 0.0), b.get(joint, 0.0))
    size = float(np.linalg.norm(factors, axis=0).max(initial=0.0))
    if not size:
        return 0.0
    difference = factors[:, 0] - factors[:, 1]
    return float(np.linalg.norm(difference)) / size


def _coordinates(a: Mapping[str, float], b: Mapping[str, float]) -> float:
    """Return the largest difference of two mappings {joint: coordinate}; infinite if they have other joints."""
    if a.keys() != b.keys():
        return np.inf
    largest = 0.0
    for joint in a:
        largest = max(largest, abs(a[joint] - b[joint]))
    return largest


def _word(a: Any, b: Any) -> float:
    """Return 0 if two values are equal, else 1: words have no distance."""
    return float(a != b)


def _name(a: str, b: str) -> float:
    """Return 0 if two names are equal in letters and digits: formats allow different other characters."""
    return _word(re.sub(r"\W", "_", a), re.sub(r"\W", "_", b))


def _ends(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the larger difference of two limits; limits above 1 m or 1 rad differ by their ratio."""
    differences = []
    for x, y in zip(a, b, strict=True):
        if x == y:  # two infinite limits: their difference is not a number
            differences.append(0.0)
            continue
        smaller = min(abs(x), abs(y))
        differences.append(abs(x - y) / max(1.0, smaller))
    return max(differences)


def _passive(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the largest difference of two entries, each in its own unit."""
    return float(np.abs(np.subtract(a, b)).max())


def _distance(a: Array | float, b: Array | float) -> float:
    return float(np.linalg.norm(np.subtract(a, b)))


def _ratios(a: Array, b: Array) -> float:
    """Return the distance between the ratios of two couplings; infinite if they couple other numbers of joints."""
    if a.shape != b.shape:
        return np.inf
    return _distance(a, b)


def _tensor(a: Array, b: Array) -> float:
    """Return the larger of two differences of tensors of inertia (3, 3).

    The first is that of two entries, relative to the largest entry: products of inertia are small. The second is that
    of the moments about any axis, relative to the moment about this axis: a slender link has a small one about its
    length. Rounding to six digits turns its axes and so changes the small moment more, by `_SLENDER`.
    """
    # Two tensors of zeros are equal: they must not divide by zero.
    largest = max(np.abs(a).max(), np.abs(b).max(), 1e-300)
    by_entry = float(np.abs(a - b).max() / largest)
    return max(by_entry, _SLENDER * _moments_apart(a, b))


def _moments_apart(a: Array, b: Array) -> float:
    """Return the largest relative difference of the moments about an axis; 0 if the first tensor has none about some.

    With a = L L', it is the largest eigenvalue of L^-1 (b - a) L'^-1, by size.
    """
    try:
        L = np.linalg.cholesky((a + a.T) / 2)
    except np.linalg.LinAlgError:  # not positive: reported by itself
        return 0.0
    inverse = np.linalg.inv(L)
    scaled = inverse @ (b - a) @ inverse.T
    return float(np.abs(np.linalg.eigvalsh((scaled + scaled.T) / 2)).max())


def _direction(a: Array, b: Array) -> float:
    return min(_distance(a, b), float(np.linalg.norm(a + b)))


def _sense(a: tuple[Array, bool], b: tuple[Array, bool]) -> float:
    """Return the distance between two unit vectors; their sign is ignored if one of the files states no sign."""
    first, first_signed = a
    second, second_signed = b
    if first_signed and second_signed:
        return _distance(first, second)
    return _direction(first, second)


def _line(a: tuple[Array, Array | None], b: tuple[Array, Array | None]) -> float:
    """Return the distance in m from b's point to line a; if a or b has no direction, the distance of their points."""
    point, direction = a
    other_point, other_direction = b
    shift = other_point - point
    if direction is None or other_direction is None:
        return float(np.linalg.norm(shift))
    return float(np.linalg.norm(np.cross(direction, shift)))


def _place(a: Array, b: Array) -> float:
    """Return the larger of the distance in m and of a tenth of the angle in rad between two poses."""
    angle = float(poses.angle(a[:3, :3], b[:3, :3]))
    # The angle counts by the way of a point 0.1 m from the origin, about the size of a link.
    return max(_distance(a[:3, 3], b[:3, 3]), 0.1 * angle)


def _surface(a: Array, b: Array) -> float:
    """Return the Hausdorff distance in m between the points of two meshes.

    Return 0 if fewer than 70 % of the points of a mesh coincide with points of the other (20 % if both have as many
    points): the meshes then have different triangles, and only `compare_shapes` compares them, by bounding box and
    volume.
    """
    if a.shape == b.shape and np.array_equal(a, b):
        return 0.0
    to_b = _nearest(a, b)
    to_a = _nearest(b, a)
    coinciding = min(np.mean(to_b < ALIKE), np.mean(to_a < ALIKE))
    least_coinciding = 0.2 if len(a) == len(b) else 0.7
    if coinciding < least_coinciding:
        return 0.0
    return float(max(to_b.max(), to_a.max()))


def _nearest(points: Array, others: Array) -> Array:
    """Return the distances (n,) in m of points (n, 3) from the nearest of the other points (m, 3)."""
    # A tree that is neither balanced nor compact is built several times faster, and is asked only once.
    tree = KDTree(others, balanced_tree=False, compact_nodes=False)
    distances, _ = tree.query(points)
    return distances


ALIKE = 3e-6
"""Distance in m below which two points count as equal, despite rounding to 0.001 mm and to single precision."""


SHARE = 5e-4
"""Part of a link's surface that may have another colour: rounding of points changes areas by less than 1e-5 of it.

The heads of its screws are some thousandths of a link's surface, and a colour that is wrong there is seen."""

_SLENDER = 2e-3
"""Weight of a relative difference about any axis: at the tolerance 1e-5 of an inertia it is 0.5 %."""

NOTHING = "nothing"
"""Text of further declarations where a file has none."""


@dataclass(frozen=True)
class ComparisonRule:
    """One compared quantity.

    Attributes:
        difference: function that returns the difference between two values.
        tolerance: maximum difference between equal values.
        unit: unit of the values, and of the difference if `relative` is False.
        relative: whether `difference` returns a relative difference; messages then show the ratio.
        severity: severity of a difference: a "warning" where the motion stays the same, or authors may choose.
        usual: the right value if any source states it, whatever the others state; None if there is no such value.
        by_majority: whether a difference is reported only if the mechanism, or two sources, state the other value.
        is_check: whether reports list the comparison as a check. A proof.json that was written before a quantity was
            compared lacks its check, which is a finding; where only differences count, none is listed.
    """

    difference: Callable[[Any, Any], float]
    tolerance: float
    unit: str = ""
    relative: bool = False
    severity: Severity = "disagreement"
    by_majority: bool = False
    usual: str | None = None
    is_check: bool = True

    @property
    def unit_of_difference(self) -> str:
        """Unit of what `difference` returns; "" for a relative difference."""
        if self.relative:
            return ""
        return self.unit


QUANTITIES: Mapping[str, ComparisonRule] = {
    "weighed": ComparisonRule(_word, 0.0),
    "mass": ComparisonRule(_number, 1e-5, "kg", True),
    "mass centre": ComparisonRule(_distance, 2e-6, "m"),
    "inertia": ComparisonRule(_tensor, 1e-5, "", True),
    "existence": ComparisonRule(_word, 0.0),
    "name": ComparisonRule(_word, 0.0),
    "kind": ComparisonRule(_word, 0.0),
    "links": ComparisonRule(_word, 0.0),
    "place": ComparisonRule(_line, 2e-6, "m"),
    "axis": ComparisonRule(_sense, 1e-5),
    "pose": ComparisonRule(_place, 5e-6, "m"),
    "zero": ComparisonRule(_place, 5e-6, "m"),
    "limits": ComparisonRule(_ends, 1e-5, "m or rad"),
    "soft limits": ComparisonRule(_ends, 1e-5, "m or rad"),
    "cone": ComparisonRule(_ends, 1e-5, "rad"),
    "axis of its cone": ComparisonRule(_direction, 1e-5),
    "driven": ComparisonRule(_word, 0.0),
    "stiffness": ComparisonRule(_number, 1e-5, "N/m or N m/rad", True),
    "damping": ComparisonRule(_number, 1e-5, "N s/m or N m s/rad", True),
    "largest effort": ComparisonRule(_number, 1e-5, "N or N m", True),
    "largest speed": ComparisonRule(_number, 1e-5, "m/s or rad/s", True),
    "largest acceleration": ComparisonRule(_number, 1e-5, "m/s2 or rad/s2", True),
    "largest jerk": ComparisonRule(_number, 1e-5, "m/s3 or rad/s3", True),
    "frame pose": ComparisonRule(_place, 2e-6, "m"),
    "point": ComparisonRule(_distance, 2e-6, "m"),
    "link": ComparisonRule(_word, 0.0),
    "shown": ComparisonRule(_word, 0.0),
    "collides": ComparisonRule(_word, 0.0, is_check=False),
    "surface": ComparisonRule(_surface, ALIKE, "m"),
    "closed": ComparisonRule(_word, 0.0),
    "colours": ComparisonRule(color_difference, SHARE),
    "finish": ComparisonRule(color_difference, SHARE, severity="warning"),
    "gravity": ComparisonRule(_distance, 1e-3, "m/s2"),
    "medium": ComparisonRule(_passive, 1e-9, "(kg/m3, Pa s, wind in m/s)"),
    "collisions of its own links": ComparisonRule(_word, 0.0),
    "held": ComparisonRule(_word, 0.0),
    "ratios": ComparisonRule(_ratios, 1e-5),
    "sum": ComparisonRule(_distance, 1e-6, "m or rad"),
    "opening": ComparisonRule(_distance, 1e-7, "m or rad"),
    "passive": ComparisonRule(_passive, 1e-9),
    "law": ComparisonRule(_word, 0.0),
    "breaks": ComparisonRule(_number, 1e-5, "N", True),
    "weightless": ComparisonRule(_distance, 1e-9),
    "reduction": ComparisonRule(_number, 1e-6, "", True),
    "row": ComparisonRule(_row, 1e-6, "", True),
    "robot": ComparisonRule(_name, 0.0, severity="warning", by_majority=True),
    "name of the tool": ComparisonRule(_word, 0.0),
    "coordinates": ComparisonRule(_coordinates, 1e-5, "m or rad", severity="warning"),
    "home coordinates": ComparisonRule(_coordinates, 1e-5, "m or rad", severity="warning", is_check=False),
    "home": ComparisonRule(_distance, 1e-5, "m or rad", severity="warning", is_check=False),
    "range of control": ComparisonRule(_ends, 1e-5, "m or rad", severity="warning"),
    "further declarations": ComparisonRule(_word, 0.0, usual=NOTHING),
    "declarations of contact or look": ComparisonRule(_word, 0.0, severity="warning", usual=NOTHING),
    "settings of single programs": ComparisonRule(_word, 0.0, severity="warning", usual=NOTHING),
    "rotor inertia": ComparisonRule(_number, 1e-5, "kg m2 or kg", True),
}
"""Rule of comparison for each quantity of links, joints, frames, couplings, motors and the world."""


def difference_text(
    subject: str, name: str, rule: ComparisonRule, own_value: Any, right_value: Any, others: str
) -> str:
    """Return the finding that a file has the value `own_value`, and not the `right_value` of the files `others`."""
    if name == "existence":
        if own_value:
            return f"{subject} is in this file, but not in {others}."
        return f"{subject} is missing; it is in {others}."
    if name in _SAID:
        phrases = _SAID[name]
        return f"{subject} {phrases[bool(own_value)]}; in {others} it {phrases[bool(right_value)]}."
    word = WORDS.get(name, name)
    if rule.relative and isinstance(own_value, int | float):
        ratio = f" (x {own_value / right_value:.4g})" if right_value else ""
        own_text = f"{own_value:.6g} {rule.unit}".rstrip()
        right_text = f"{right_value:.6g} {rule.unit}".rstrip()
        return f"{subject}: {word} is {own_text}; in {others} it is {right_text}{ratio}."
    difference = rule.difference(own_value, right_value)
    if name == "opening":
        return (
            f"{subject} open by {quantity(own_value, 'm')} if 1 g pulls at them, by the parameters of the solver; in "
            f"{others} by {quantity(right_value, 'm')}."
        )
    if name in ("mass centre", "place", "frame pose", "point", "pose", "zero"):
        return f"{subject}: {word} differs by {quantity(difference, 'm')} from {others}."
    if name == "surface":
        return f"{subject}: a point of its mesh is {quantity(difference, 'm')} from the mesh of {others}."
    if name == "colours":
        return f"{subject}: {100 * difference:.3g} % of its surface has a different colour in {others}."
    if name == "finish":
        return f"{subject}: {100 * difference:.3g} % of its surface has another metallic or roughness in {others}."
    if name == "inertia":
        return f"{subject}: inertia differs from {others} by {100 * difference:.3g} %."
    if name == "axis":
        return f"{subject}: axis is {_vector(own_value[0])}; in {others} it is {_vector(right_value[0])}."
    right_text = f"{_plain(right_value)} {rule.unit}".rstrip()
    return f"{subject}: {word} is {_plain(own_value)}; in {others} it is {right_text}."


_SAID = {
    "closed": ("has an open mesh", "has closed meshes"),
    "collides": ("has a mesh whose collider is disabled", "collides"),
    "driven": ("is passive", "is driven"),
    "shown": ("has no mesh", "has a mesh"),
    "weighed": ("has no mass", "has a mass"),
}

WORDS = {
    "frame pose": "pose of the frame on its link",
    "pose": "relative pose of the two links",
    "zero": "relative pose of the two links at zero",
    "place": "axis or centre of the joint",
    "link": "link of the frame",
    "largest effort": "maximum effort",
    "largest speed": "maximum speed",
    "largest acceleration": "maximum acceleration",
    "largest jerk": "maximum jerk",
    "robot": "name of the robot",
    "finish": "metallic and roughness",
    "held": "bodies fixed to the world",
    "shown": "presence of a mesh",
    "weighed": "presence of a mass",
    "closed": "closed or open meshes",
    "driven": "driven or passive",
    "existence": "presence in the file",
    "row": "joint factors of the transmission",
    "opening": "opening of the loops if 1 g pulls at them",
    "point": "position of the point on its link",
    "home": "coordinate at home",
    "home coordinates": "coordinates",
    "reduction": "reduction of its transmission",
    "passive": "stiffness, damping, friction and inertia of the joint itself",
    "law": "quantity that the gains of the drive give",
    "breaks": "force at which the joint breaks",
    "weightless": "share of its weight that is compensated",
}
"""Words for the names of quantities that are not words themselves."""


def _vector(components: Iterable[float]) -> str:
    """Return the components of a vector as text, such as "(0, 0, -9.81)"."""
    return f"({', '.join(map('{:.4g}'.format, components))})"


def _plain(value: Any) -> str:
    """Return a value as text: a vector, a row {joint: factor}, a range, a list of names, or a word."""
    if isinstance(value, np.ndarray):
        return _vector(value)
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
