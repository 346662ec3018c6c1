"""Rules for the elements of a URDF, an expanded xacro and a SDF: numbers as they are printed, with their lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from xml.etree.ElementTree import Element

import numpy as np

from twin.checking.check_finding import CheckFinding

ElementPlace = Callable[[Element, str], tuple[str, int]]
"""(element, "joint/NAME/limit") to (file relative to the checked folder, line or 0)."""

_MOVING = ("revolute", "continuous", "prismatic")

_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")

_TRIANGLE_TOLERANCE = 1e-6
"""Relative tolerance of the triangle inequality: the tensor of a flat plate is at the limit."""

_ZERO_MOMENT = 1e-14
"""Moment in kg m2 up to which a tensor is zero: exporters print 1e-20 for zero; 1 mg with a size of 1 mm has 1e-13."""

_DEGREE_STEP = 5.0
"""Angles in degrees are usually multiples of this; an angle in rad hardly ever is."""

_LIMITS_FOR_NONE = (100.0, 500.0)
"""Limits in rad that authors write for a joint without limits."""

_ROUNDING = 1e-9
"""Difference in rad or m of a soft limit from a limit that is a rounding error."""

_LARGEST_WRONG_EFFORT = -1e-300
"""Efforts up to this are wrong; 0 is accepted."""

_MAX_ORIGIN_ANGLE = 6.5
"""Angle in rad from which one of an origin may be in degrees; slightly more than 2 pi."""

_MAX_PLAUSIBLE_LIMIT = 29.0
"""Limit of an angle in rad from which it may be in degrees: more than four turns, and less than 30 degrees."""

_MAX_DEGREES = 720.0
"""Largest limit that is taken for degrees; larger limits mean none."""

_ROOTS_SHOWN = 4
"""Number of root links that a message names."""


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

    def finding(self, rule: str, element: Element, path: str, subject: str, message: str) -> CheckFinding:
        """Return a finding on an element."""
        file, line = self.place(element, path)
        return CheckFinding(rule, file, subject, message=f"{subject}: {message}", line=line)


def check_elements(elements: Elements) -> Iterator[CheckFinding]:
    """Yield the findings on names, limits, axes, origins, mimics and inertias."""
    if elements.sdf:
        for model in elements.root.iter("model"):
            for link in model.findall("link"):
                yield from _inertia(elements, link)
            for joint in model.findall("joint"):
                yield from _sdf_limits(elements, joint)
        return
    yield from _unique_names(elements)
    for link in elements.root.findall("link"):
        yield from _inertia(elements, link)
        yield from _origins_in_degrees(elements, link, "link")
    joints: dict[str, Element] = {}
    for joint in elements.root.findall("joint"):
        joints[joint.get("name", "")] = joint
    for joint in joints.values():
        yield from _urdf_limits(elements, joint)
        yield from _origins_in_degrees(elements, joint, "joint")
        yield from _nonzero_axis(elements, joint)
        yield from _mimic_leader(elements, joint, joints)


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


def _unique_names(elements: Elements) -> Iterator[CheckFinding]:
    """Yield findings on names of links and joints that are used twice, and on the tree that they form."""
    links: dict[str, Element] = {}
    for kind in ("link", "joint"):
        known_names: set[str] = set()
        for element in elements.root.findall(kind):
            name = element.get("name", "")
            if kind == "link":
                links.setdefault(name, element)
            if name in known_names:
                yield elements.finding(
                    "names/duplicate", element, f"{kind}/{name}", f"{kind} '{name}'", "the name is used twice"
                )
            known_names.add(name)
    yield from _tree_structure(elements, links)


def _tree_structure(elements: Elements, links: dict[str, Element]) -> Iterator[CheckFinding]:
    """Yield findings on unknown links, links with two parents, and several roots or cycles."""
    above: dict[str, str] = {}
    is_complete = True
    for joint in elements.root.findall("joint"):
        name = joint.get("name", "")
        ends: list[str] = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = "" if element is None else element.get("link", "")
            ends.append(link)
            if link not in links:
                is_complete = False
                text = f"its {end} '{link}' does not exist"
                if not link:
                    text = f"it has no {end}"
                yield elements.finding(
                    "names/unknown",
                    joint if element is None else element,
                    f"joint/{name}/{end}",
                    f"joint '{name}'",
                    text,
                )
        child = ends[1]
        if child in above:
            is_complete = False
            text = f"its child '{child}' is also the child of joint '{above[child]}'"
            yield elements.finding("names/tree", joint, f"joint/{name}", f"joint '{name}'", text)
        above.setdefault(child, name)
    roots = [link for link in links if link not in above]
    if links and is_complete and len(roots) != 1:
        root_names = ", ".join([f"'{root}'" for root in roots[:_ROOTS_SHOWN]])
        text = f"the file has {len(roots)} root links ({root_names}), expected one"
        if not roots:
            text = "the file has no root link: its joints form a cycle"
        file, line = elements.place(elements.root, "")
        if roots:
            file, line = elements.place(links[roots[-1]], f"link/{roots[-1]}")
        yield CheckFinding("names/tree", file, "the tree", message=text[0].upper() + text[1:], line=line)


# -- inertia --------------------------------------------------------------------------------------


def _inertia(elements: Elements, link: Element) -> Iterator[CheckFinding]:
    """Yield findings on mass and moments of a link that no body can have."""
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
    texts = _moment_texts(elements, tensor)
    moments = []
    for text in texts:
        moment = number(text)
        if moment is not None:
            moments.append(moment + 0.0)  # + 0.0: no -0.0 in messages
    if mass is None or len(moments) < len(_MOMENTS):
        return  # the reader tells what is wrong
    xx, yy, zz, xy, xz, yz = moments
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    is_zero = bool(np.abs(matrix).max() < _ZERO_MOMENT)
    path = f"link/{name}/inertial/inertia"
    if mass < 0 or (mass == 0 and not is_zero):
        text = f"mass {mass:g} kg (must be above 0)"
        if mass == 0:
            text += ", although its moments are not zero"
        yield elements.finding("inertia/mass", mass_element, f"link/{name}/inertial/mass", subject, text)
    elif is_zero:
        text = f"all moments are 0, with a mass of {mass:g} kg"
        yield elements.finding("inertia/zero", tensor, path, subject, text)
    if not is_zero:
        yield from _principal_moments(elements, tensor, path, subject, matrix=matrix, texts=texts)


def _moment_texts(elements: Elements, tensor: Element) -> list[str]:
    """Return the six moments as they are printed, in the order of `_MOMENTS`, with the defaults of the format."""
    texts: list[str] = []
    for key in _MOMENTS:
        stated_text = tensor.findtext(key) if elements.sdf else tensor.get(key)
        default = "0"
        if elements.sdf and key in _MOMENTS[:3]:
            default = "1"  # SDF: a moment about an axis that is not stated is 1 kg m2
        texts.append(stated_text or default)
    return texts


def _principal_moments(
    elements: Elements, tensor: Element, path: str, subject: str, *, matrix: np.ndarray, texts: list[str]
) -> Iterator[CheckFinding]:
    """Yield findings on the principal moments of an inertia matrix (3, 3) in kg m2, printed as six `texts`."""
    # by how much rounding can change a principal moment: each product stands at two places of the matrix
    slack = sum(map(rounding, texts[:3])) + 2.0 * sum(map(rounding, texts[3:]))
    low, middle, high = np.linalg.eigvalsh(matrix).tolist()
    moments_text = f"principal moments {low:.4g}, {middle:.4g}, {high:.4g} kg m2"
    if low < -_TRIANGLE_TOLERANCE * high:
        rule = "inertia/positive"
        if low >= -slack and high > 0:
            rule = "inertia/rounded"
        yield elements.finding(rule, tensor, path, subject, f"{moments_text}: the smallest must be above 0")
    elif low <= 0 and high <= (max(low, 0.0) + middle) * (1.0 + _TRIANGLE_TOLERANCE):
        yield elements.finding("inertia/zero", tensor, path, subject, f"{moments_text}: the smallest is 0")
    elif high > (low + middle) * (1.0 + _TRIANGLE_TOLERANCE):
        rule = "inertia/triangle"
        if high - low - middle <= slack:
            rule = "inertia/rounded"
        text = f"{moments_text}: the largest must not exceed the sum of the others, {low + middle:.4g}"
        yield elements.finding(rule, tensor, path, subject, text)


# -- joints ---------------------------------------------------------------------------------------


def _urdf_limits(elements: Elements, joint: Element) -> Iterator[CheckFinding]:
    """Yield findings on the limits of a joint of a URDF: missing, not positive, in a wrong order or unit."""
    kind = joint.get("type", "")
    if kind not in _MOVING:
        return
    name = joint.get("name", "")
    subject = f"joint '{name}'"
    path = f"joint/{name}/limit"
    limit = joint.find("limit")
    if limit is None:
        if kind != "continuous":
            yield elements.finding("limits/missing", joint, f"joint/{name}", subject, f"a {kind} joint needs a <limit>")
        return
    missing = []
    for key in ("effort", "velocity"):
        if limit.get(key) is None:
            missing.append(key)
    if missing and kind != "continuous":  # readers of ROS accept a continuous joint without limits
        text = f"<limit> has no {' and no '.join(missing)}"
        yield elements.finding("limits/missing", limit, path, subject, text)
    for key, rule, least in (("velocity", "limits/velocity", 0.0), ("effort", "limits/effort", _LARGEST_WRONG_EFFORT)):
        value = number(limit.get(key))
        if value is not None and value <= least:
            yield elements.finding(rule, limit, path, subject, f"{key} {value:g} (must be above 0)")
    # URDF: a limit that is not stated is 0
    lower = number(limit.get("lower", "0"))
    upper = number(limit.get("upper", "0"))
    if kind == "continuous" or lower is None or upper is None:
        return
    stated = limit.get("lower") is not None or limit.get("upper") is not None
    yield from _limit_order(elements, limit, path, subject, kind, (lower, upper), stated)
    yield from _soft_limits(elements, joint, lower, upper)


def _limit_order(
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
    limits_text = f"lower {lower:g} and upper {upper:g} {unit}"
    if lower > upper:
        yield elements.finding("limits/order", limit, path, subject, f"{limits_text}: lower must be below upper")
    elif lower == upper:
        text = f"{limits_text}: the joint cannot move"
        if not stated:
            text = "lower and upper are not stated, so both are 0: the joint cannot move"
        yield elements.finding("limits/fixed", limit, path, subject, text)
    elif lower > 0 or upper < 0:
        yield elements.finding("limits/zero", limit, path, subject, f"{limits_text}: 0 is outside")
    if kind == "revolute" and _in_degrees(lower, upper):
        text = f"{limits_text} are {upper - lower:g} rad, or {(upper - lower) / (2 * math.pi):.0f} turns"
        yield elements.finding("limits/degrees", limit, path, subject, text)


def _in_degrees(lower: float, upper: float) -> bool:
    """Return whether limits in rad are many turns, and look like degrees: multiples of 5 up to two turns."""
    largest = max(abs(lower), abs(upper))
    if not _MAX_PLAUSIBLE_LIMIT < largest <= _MAX_DEGREES:
        return False
    if largest in _LIMITS_FOR_NONE:
        return False
    return lower % _DEGREE_STEP == 0.0 and upper % _DEGREE_STEP == 0.0


def _soft_limits(elements: Elements, joint: Element, lower: float, upper: float) -> Iterator[CheckFinding]:
    """Yield a finding if the soft limits of a joint are not inside its limits in rad or m."""
    safety = joint.find("safety_controller")
    if safety is None or lower >= upper:
        return
    low = number(safety.get("soft_lower_limit"))
    high = number(safety.get("soft_upper_limit"))
    if low is None or high is None or low == high:  # both 0: not stated
        return
    if low < lower - _ROUNDING or high > upper + _ROUNDING:
        name = joint.get("name", "")
        text = f"soft limits {low:g} .. {high:g} are not inside the limits {lower:g} .. {upper:g}"
        yield elements.finding("limits/soft", safety, f"joint/{name}/safety_controller", f"joint '{name}'", text)


def _sdf_limits(elements: Elements, joint: Element) -> Iterator[CheckFinding]:
    """Yield findings on the limits of the axes of a joint of a SDF."""
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
            yield from _limit_order(elements, limit, path, f"joint '{name}'", kind, (lower, upper))


def _origins_in_degrees(elements: Elements, element: Element, kind: str) -> Iterator[CheckFinding]:
    """Yield findings on angles that look like degrees."""
    name = element.get("name", "")
    for origin in element.iter("origin"):
        for angle in map(number, (origin.get("rpy") or "").split()):
            if angle is not None and abs(angle) > _MAX_ORIGIN_ANGLE and angle % _DEGREE_STEP == 0.0:
                text = f"rpy '{origin.get('rpy')}' has {angle:g} rad"
                yield elements.finding("origin/degrees", origin, f"{kind}/{name}/origin", f"{kind} '{name}'", text)
                break


def _nonzero_axis(elements: Elements, joint: Element) -> Iterator[CheckFinding]:
    """Yield a finding if the axis of a moving joint is zero."""
    axis = joint.find("axis")
    if axis is None or joint.get("type") not in _MOVING:
        return
    values = list(map(number, (axis.get("xyz") or "").split()))
    if values == [0.0, 0.0, 0.0]:
        name = joint.get("name", "")
        yield elements.finding("axis/zero", axis, f"joint/{name}/axis", f"joint '{name}'", "the axis is 0 0 0")


def _mimic_leader(elements: Elements, joint: Element, joints: dict[str, Element]) -> Iterator[CheckFinding]:
    """Yield a finding if a joint follows itself, or none of the `joints` of the file."""
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
    yield elements.finding("mimic/leader", mimic, f"joint/{name}/mimic", f"joint '{name}'", text)
