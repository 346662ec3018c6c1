"""Rules for the elements of a URDF, an expanded xacro and a SDF: numbers as they are printed, with their lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from xml.etree.ElementTree import Element

import numpy as np

from twin.checking.found import CheckFinding

ElementPlace = Callable[[Element, str], tuple[str, int]]
"""(element, "joint/NAME/limit") to (file relative to the checked folder, line or 0)."""

_MOVING = ("revolute", "continuous", "prismatic")

_KEYS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

_SLACK = 1e-6
"""Relative tolerance of the triangle inequality: the tensor of a flat plate is at the limit."""

_NOTHING = 1e-14
"""Moment in kg m2 up to which a tensor is zero: exporters print 1e-20 for zero; 1 mg with a size of 1 mm has 1e-13."""

_FULL_TURN = 6.5
"""Angle in rad from which one of an origin may be in degrees; slightly more than 2 pi."""

_MANY_TURNS = 29.0
"""Limit of an angle in rad from which it may be in degrees: more than four turns, and less than 30 degrees."""

_MOST_DEGREES = 720.0
"""Largest limit that is taken for degrees; larger limits mean none."""


@dataclass(frozen=True)
class Elements:
    """The elements of a file.

    Attributes:
        root: the root element; the <robot>, or the <sdf>.
        sdf: whether the file is a SDF, whose numbers are texts of elements; those of a URDF are attributes.
        place: where elements are.
    """

    root: Element
    sdf: bool
    place: ElementPlace

    def found(self, rule: str, element: Element, path: str, subject: str, message: str) -> CheckFinding:
        """Return a finding on an element."""
        file, line = self.place(element, path)
        return CheckFinding(rule, file, subject, f"{subject}: {message}", line)


def check_elements(elements: Elements) -> Iterator[CheckFinding]:
    """Yield the findings on names, limits, axes, origins, mimics and inertias."""
    if elements.sdf:
        for model in elements.root.iter("model"):
            for link in model.findall("link"):
                yield from _inertia(elements, link)
            for joint in model.findall("joint"):
                yield from _sdf_limits(elements, joint)
        return
    yield from _names(elements)
    for link in elements.root.findall("link"):
        yield from _inertia(elements, link)
        yield from _origins(elements, link, "link")
    joints: dict[str, Element] = {}
    for joint in elements.root.findall("joint"):
        joints[joint.get("name", "")] = joint
    for joint in joints.values():
        yield from _urdf_limits(elements, joint)
        yield from _origins(elements, joint, "joint")
        yield from _axis(elements, joint)
        yield from _mimic(elements, joint, joints)


def number(text: str | None) -> float | None:
    """Return the finite number in a text, or None."""
    try:
        value = float((text or "").strip())
    except ValueError:
        return None
    if not math.isfinite(value):
        return None
    return value


def rounding(text: str) -> float:
    """Return half a unit of the last decimal of a printed number; 0 for a whole number, which is exact."""
    try:
        exponent = Decimal(text.strip()).as_tuple().exponent
    except InvalidOperation:
        return 0.0
    if not isinstance(exponent, int) or exponent >= 0:
        return 0.0
    return 0.5 * 10.0**exponent


# -- names and structure --------------------------------------------------------------------------


def _names(elements: Elements) -> Iterator[CheckFinding]:
    links: dict[str, Element] = {}
    for kind in ("link", "joint"):
        seen: set[str] = set()
        for element in elements.root.findall(kind):
            name = element.get("name", "")
            if kind == "link":
                links.setdefault(name, element)
            if name in seen:
                yield elements.found(
                    "names/duplicate", element, f"{kind}/{name}", f"{kind} '{name}'", "the name is used twice"
                )
            seen.add(name)
    yield from _tree(elements, links)


def _tree(elements: Elements, links: dict[str, Element]) -> Iterator[CheckFinding]:
    """Yield findings on unknown links, links with two parents, and several roots or cycles."""
    above: dict[str, str] = {}
    whole = True
    for joint in elements.root.findall("joint"):
        name = joint.get("name", "")
        ends: list[str] = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = "" if element is None else element.get("link", "")
            ends.append(link)
            if link not in links:
                whole = False
                text = f"its {end} '{link}' does not exist"
                if not link:
                    text = f"it has no {end}"
                yield elements.found(
                    "names/unknown",
                    joint if element is None else element,
                    f"joint/{name}/{end}",
                    f"joint '{name}'",
                    text,
                )
        child = ends[1]
        if child in above:
            whole = False
            text = f"its child '{child}' is also the child of joint '{above[child]}'"
            yield elements.found("names/tree", joint, f"joint/{name}", f"joint '{name}'", text)
        above.setdefault(child, name)
    roots = [link for link in links if link not in above]
    if links and whole and len(roots) != 1:
        shown = ", ".join(f"'{root}'" for root in roots[:4])
        text = f"the file has {len(roots)} root links ({shown}), expected one"
        if not roots:
            text = "the file has no root link: its joints form a cycle"
        file, line = elements.place(elements.root, "")
        if roots:
            file, line = elements.place(links[roots[-1]], f"link/{roots[-1]}")
        yield CheckFinding("names/tree", file, "the tree", text[0].upper() + text[1:], line)


# -- inertia --------------------------------------------------------------------------------------


def _inertia(elements: Elements, link: Element) -> Iterator[CheckFinding]:
    inertial = link.find("inertial")
    if inertial is None:
        return
    mass_element = inertial.find("mass")
    tensor = inertial.find("inertia")
    if mass_element is None or tensor is None:
        return
    name = link.get("name", "")
    subject = f"link '{name}'"
    mass = number(mass_element.text if elements.sdf else mass_element.get("value"))
    texts: list[str] = []
    for key in _KEYS:
        given = tensor.findtext(key) if elements.sdf else tensor.get(key)
        default = "1" if elements.sdf and key in _KEYS[:3] else "0"
        texts.append(given or default)
    values = [number(text) for text in texts]
    if mass is None or None in values:
        return  # the reader tells what is wrong
    xx, yy, zz, xy, xz, yz = (value or 0.0 for value in values)
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    none = bool(np.abs(matrix).max() < _NOTHING)
    mass_path = f"link/{name}/inertial/mass"
    path = f"link/{name}/inertial/inertia"
    if mass < 0 or (mass == 0 and not none):
        text = f"mass {mass:g} kg (must be above 0)"
        if mass == 0:
            text += ", although its moments are not zero"
        yield elements.found("inertia/mass", mass_element, mass_path, subject, text)
    elif none:
        text = f"all moments are 0, with a mass of {mass:g} kg"
        yield elements.found("inertia/zero", tensor, path, subject, text)
    if none:
        return
    slack = sum(rounding(text) for text in texts[:3]) + 2.0 * sum(rounding(text) for text in texts[3:])
    low, middle, high = (float(moment) for moment in np.linalg.eigvalsh(matrix))
    shown = f"principal moments {low:.4g}, {middle:.4g}, {high:.4g} kg m2"
    if low < -_SLACK * high:
        rule = "inertia/positive"
        if low >= -slack and high > 0:
            rule = "inertia/rounded"
        yield elements.found(rule, tensor, path, subject, f"{shown}: the smallest must be above 0")
    elif low <= 0 and high <= (max(low, 0.0) + middle) * (1.0 + _SLACK):
        yield elements.found("inertia/zero", tensor, path, subject, f"{shown}: the smallest is 0")
    elif high > (low + middle) * (1.0 + _SLACK):
        rule = "inertia/triangle"
        if high - low - middle <= slack:
            rule = "inertia/rounded"
        text = f"{shown}: the largest must not exceed the sum of the others, {low + middle:.4g}"
        yield elements.found(rule, tensor, path, subject, text)


# -- joints ---------------------------------------------------------------------------------------


def _urdf_limits(elements: Elements, joint: Element) -> Iterator[CheckFinding]:
    kind = joint.get("type", "")
    if kind not in _MOVING:
        return
    name = joint.get("name", "")
    subject = f"joint '{name}'"
    path = f"joint/{name}/limit"
    limit = joint.find("limit")
    if limit is None:
        if kind != "continuous":
            yield elements.found("limits/missing", joint, f"joint/{name}", subject, f"a {kind} joint needs a <limit>")
        return
    missing = [key for key in ("effort", "velocity") if limit.get(key) is None]
    if missing and kind != "continuous":
        text = f"<limit> has no {' and no '.join(missing)}"
        yield elements.found("limits/missing", limit, path, subject, text)
    for key, rule, least in (("velocity", "limits/velocity", 0.0), ("effort", "limits/effort", -1e-300)):
        value = number(limit.get(key))
        if value is not None and value <= least:
            yield elements.found(rule, limit, path, subject, f"{key} {value:g} (must be above 0)")
    lower = number(limit.get("lower", "0"))
    upper = number(limit.get("upper", "0"))
    if kind == "continuous" or lower is None or upper is None:
        return
    stated = limit.get("lower") is not None or limit.get("upper") is not None
    yield from _range(elements, limit, path, subject, kind, (lower, upper), stated)
    yield from _soft(elements, joint, lower, upper)


def _range(
    elements: Elements,
    limit: Element,
    path: str,
    subject: str,
    kind: str,
    values: tuple[float, float],
    stated: bool = True,
) -> Iterator[CheckFinding]:
    """Yield the findings on the limits `values` (lower, upper) in rad or m; `stated`: whether the file has them."""
    lower, upper = values
    unit = "m" if kind == "prismatic" else "rad"
    shown = f"lower {lower:g} and upper {upper:g} {unit}"
    if lower > upper:
        yield elements.found("limits/order", limit, path, subject, f"{shown}: lower must be below upper")
    elif lower == upper:
        text = f"{shown}: the joint cannot move"
        if not stated:
            text = "lower and upper are not stated, so both are 0: the joint cannot move"
        yield elements.found("limits/fixed", limit, path, subject, text)
    elif lower > 0 or upper < 0:
        yield elements.found("limits/zero", limit, path, subject, f"{shown}: 0 is outside")
    if kind == "revolute" and _in_degrees(lower, upper):
        text = f"{shown} are {upper - lower:g} rad, or {(upper - lower) / (2 * math.pi):.0f} turns"
        yield elements.found("limits/degrees", limit, path, subject, text)


def _in_degrees(lower: float, upper: float) -> bool:
    """Return whether limits in rad are many turns, and look like degrees: multiples of 5 up to two turns."""
    largest = max(abs(lower), abs(upper))
    if not _MANY_TURNS < largest <= _MOST_DEGREES:
        return False
    if largest in (100.0, 500.0):  # what authors write for a joint without limits
        return False
    return lower % 5.0 == 0.0 and upper % 5.0 == 0.0


def _soft(elements: Elements, joint: Element, lower: float, upper: float) -> Iterator[CheckFinding]:
    safety = joint.find("safety_controller")
    if safety is None or lower >= upper:
        return
    low = number(safety.get("soft_lower_limit"))
    high = number(safety.get("soft_upper_limit"))
    if low is None or high is None or low == high:  # both 0: not stated
        return
    if low < lower - 1e-9 or high > upper + 1e-9:
        name = joint.get("name", "")
        text = f"soft limits {low:g} .. {high:g} are not inside the limits {lower:g} .. {upper:g}"
        yield elements.found("limits/soft", safety, f"joint/{name}/safety_controller", f"joint '{name}'", text)


def _sdf_limits(elements: Elements, joint: Element) -> Iterator[CheckFinding]:
    kind = joint.get("type", "")
    name = joint.get("name", "")
    for axis in joint.findall("axis"):
        limit = axis.find("limit")
        if limit is None:
            continue
        lower = number(limit.findtext("lower"))
        upper = number(limit.findtext("upper"))
        if lower is None or upper is None:
            continue
        path = f"joint/{name}/axis/limit"
        if kind in ("revolute", "prismatic", "screw"):
            yield from _range(elements, limit, path, f"joint '{name}'", kind, (lower, upper))


def _origins(elements: Elements, element: Element, kind: str) -> Iterator[CheckFinding]:
    """Yield findings on angles that look like degrees."""
    name = element.get("name", "")
    for origin in element.iter("origin"):
        angles = [number(text) for text in (origin.get("rpy") or "").split()]
        for angle in angles:
            if angle is not None and abs(angle) > _FULL_TURN and angle % 5.0 == 0.0:
                text = f"rpy '{origin.get('rpy')}' has {angle:g} rad"
                yield elements.found("origin/degrees", origin, f"{kind}/{name}/origin", f"{kind} '{name}'", text)
                break


def _axis(elements: Elements, joint: Element) -> Iterator[CheckFinding]:
    axis = joint.find("axis")
    if axis is None or joint.get("type") not in _MOVING:
        return
    values = [number(text) for text in (axis.get("xyz") or "").split()]
    if len(values) == 3 and None not in values and not any(values):
        name = joint.get("name", "")
        yield elements.found("axis/zero", axis, f"joint/{name}/axis", f"joint '{name}'", "the axis is 0 0 0")


def _mimic(elements: Elements, joint: Element, joints: dict[str, Element]) -> Iterator[CheckFinding]:
    mimic = joint.find("mimic")
    if mimic is None:
        return
    name = joint.get("name", "")
    leader = mimic.get("joint", "")
    if leader not in joints:
        text = f"it follows joint '{leader}', which does not exist"
    elif leader == name:
        text = "it follows itself"
    else:
        return
    yield elements.found("mimic/leader", mimic, f"joint/{name}/mimic", f"joint '{name}'", text)
