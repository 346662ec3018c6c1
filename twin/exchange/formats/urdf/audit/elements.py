"""Check the elements of a URDF: required attributes, elements that may be there once, names, materials and masses.

Parsers such as urdfdom reject an element without a required attribute, or take the first of two; which parser does
what differs, so that such a file is a different robot for each.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from xml.etree import ElementTree as ET

from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.urdf.audit.attributes import repeated
from twin.exchange.formats.urdf.audit.transmissions import check_transmission_elements

_REQUIRED_ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "link": ("name",),
    "joint": ("name", "type"),
    "parent": ("link",),
    "child": ("link",),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "mesh": ("filename",),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "limit": ("effort", "velocity"),
    "axis": ("xyz",),
    "mimic": ("joint",),
    "safety_controller": ("k_velocity",),
    "color": ("rgba",),
    "material": ("name",),
}
"""Required attributes of elements."""

_OPTIONAL_ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "link": ("type",),
    "origin": ("xyz", "rpy"),
    "mesh": ("scale",),
    "limit": ("lower", "upper"),
    "mimic": ("multiplier", "offset"),
    "dynamics": ("damping", "friction"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit", "k_position"),
    "calibration": ("rising", "falling"),
    "visual": ("name",),
    "collision": ("name",),
}
"""Further attributes of elements."""

_SINGLE_CHILDREN: Mapping[str, tuple[str, ...]] = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material"),
    "collision": ("origin", "geometry"),
    "geometry": ("mesh", "box", "sphere", "cylinder"),
    "joint": (
        *("parent", "child", "origin", "axis", "limit", "dynamics", "mimic", "safety_controller", "calibration"),
    ),
}
"""Elements that may be in an element once."""

_REQUIRED_CHILDREN: Mapping[str, tuple[str, ...]] = {
    "inertial": ("mass", "inertia"),
    "visual": ("geometry",),
    "collision": ("geometry",),
    "joint": ("parent", "child"),
}
"""Elements that must be in an element."""

_REPEATABLE_CHILDREN: Mapping[str, tuple[str, ...]] = {"link": ("visual", "collision")}
"""Elements that may be in an element several times."""

_LIMITED_JOINT_TYPES = ("revolute", "prismatic")
"""Types of joints that need a limit."""

_COLORED_MESH_SUFFIXES = (".dae", ".glb", ".gltf")
"""Suffixes of mesh files that have colours of their own."""

_MISSPELLING_SIMILARITY = 0.75
"""Similarity (0..1) from which an unknown name is a known one with a mistake in it."""

_MOST_MASSLESS = 0.25
"""Share of the moving links without mass up to which they are mistakes; in other files, the author states no masses."""


def check_elements(root: ET.Element, ledger: Ledger) -> None:
    """Report elements of a URDF that parsers reject or read in different ways."""
    for element in root:
        if element.tag in ("link", "joint", "material"):
            _check_element(element, str(element.get("name") or ""), ledger)
    _check_tags(root, ("link", "joint", "material", "transmission", "gazebo", "ros2_control", "sensor"), "", ledger)
    defined: list[str] = []
    for material in root.findall("material"):
        if material.find("color") is not None or material.find("texture") is not None:  # others only name a material
            defined.append(str(material.get("name")))
    for name in repeated(defined):
        text = f"two materials are named '{name}': readers such as urdfdom reject the second one."
        ledger.wrong("urdf.duplicate_name", text, name, suggestion="define each material once")
    _check_materials(root, ledger)
    _check_masses(root, ledger)
    _check_repeated_shapes(root, ledger)
    check_transmission_elements(root, ledger)


def _check_element(element: ET.Element, owner: str, ledger: Ledger) -> None:
    """Report what an element of the link, joint or material `owner` lacks or has twice, and what is in it."""
    tag = str(element.tag)
    place = f"<{tag}>" if tag in ("link", "joint") else f"<{tag}> of '{owner}'"
    for key in _REQUIRED_ATTRIBUTES.get(tag, ()):
        if key not in element.attrib:
            text = f"{place} has no attribute '{key}': readers such as urdfdom reject it."
            code = "urdf.limits" if tag == "limit" else "urdf.attribute"
            ledger.wrong(code, text, owner, suggestion=f"write {key}")
    vocabulary = (*_REQUIRED_ATTRIBUTES.get(tag, ()), *_OPTIONAL_ATTRIBUTES.get(tag, ()))
    for key in element.attrib:
        attribute = _resembled(key, vocabulary)
        if attribute and attribute not in element.attrib:
            text = f"{place} has the attribute '{key}', which no reader knows; '{attribute}' is missing."
            ledger.add("urdf.attribute", "warning", text, owner, suggestion=f"write {attribute}")
    for child in _SINGLE_CHILDREN.get(tag, ()):
        count = len(element.findall(child))
        if count > 1:
            text = f"{place} has {count} elements <{child}>, expected one: readers take the first, or the last."
            ledger.wrong("urdf.repeated", text, owner, suggestion="keep one of them")
    for child in _REQUIRED_CHILDREN.get(tag, ()):
        if element.find(child) is None:
            text = f"{place} has no <{child}>: readers such as urdfdom reject it."
            ledger.wrong("urdf.element", text, owner, suggestion=f"write <{child}>")
    if tag == "joint" and element.get("type") in _LIMITED_JOINT_TYPES and element.find("limit") is None:
        text = f"joint '{owner}' is {element.get('type')}, but has no <limit>: readers such as urdfdom reject it."
        ledger.wrong("urdf.limits", text, owner, suggestion="write its limits")
    if tag == "geometry" and not {child.tag for child in element} & {*_SINGLE_CHILDREN[tag]}:
        text = f"<geometry> of '{owner}' has no shape: readers such as urdfdom reject it."
        ledger.wrong("urdf.element", text, owner, suggestion="write a shape")
    _check_tags(element, (*_SINGLE_CHILDREN.get(tag, ()), *_REPEATABLE_CHILDREN.get(tag, ())), owner, ledger)
    for child in element:
        if child.tag in _SINGLE_CHILDREN or child.tag in _REQUIRED_ATTRIBUTES or child.tag in _OPTIONAL_ATTRIBUTES:
            _check_element(child, owner, ledger)


def _check_tags(element: ET.Element, vocabulary: tuple[str, ...], owner: str, ledger: Ledger) -> None:
    """Report children whose tag is nearly one of `vocabulary`: readers skip them."""
    for child in element:
        tag = _resembled(str(child.tag), vocabulary)
        if tag:
            text = f"<{child.tag}> in <{element.tag}> is an element that no reader knows; <{tag}> may be meant."
            where = owner or str(child.get("name") or "")
            ledger.add("urdf.element", "warning", text, where, suggestion=f"write <{tag}>")


def _resembled(word: str, vocabulary: tuple[str, ...]) -> str:
    """Return the word of `vocabulary` that an unknown word resembles; "" without one."""
    if word in vocabulary or not vocabulary:
        return ""
    matches = difflib.get_close_matches(word, vocabulary, 1, _MISSPELLING_SIMILARITY)
    return matches[0] if matches else ""


def _check_materials(root: ET.Element, ledger: Ledger) -> None:
    """Report visual shapes without a material if most others have one."""
    without_material = []
    count = 0
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is not None and str(mesh.get("filename")).lower().endswith(_COLORED_MESH_SUFFIXES):
                continue
            count += 1
            if visual.find("material") is None:
                without_material.append((str(link.get("name")), str(visual.get("name") or "")))
    if 2 * len(without_material) >= count:
        return
    others = count - len(without_material)
    for link, name in without_material:
        text = f"link '{link}': the shape '{name}' has no material, but {others} others have one."
        ledger.add("urdf.no_material", "warning", text, link, suggestion="give the shape its material")


def _check_masses(root: ET.Element, ledger: Ledger) -> None:
    """Report links without mass that a joint moves, if at most a quarter of all links that joints move have none."""
    moving_links = set()
    for joint in root.findall("joint"):
        child = joint.find("child")
        if child is not None and joint.get("type") not in ("fixed", None):
            moving_links.add(str(child.get("link")))
    count = 0
    massless: list[str] = []
    for link in root.findall("link"):
        if link.get("name") not in moving_links:
            continue
        count += 1
        if link.find("inertial") is None:
            massless.append(str(link.get("name")))
    if len(massless) > _MOST_MASSLESS * count:
        return
    others = count - len(massless)
    for name in massless:
        text = (
            f"link '{name}' has no <inertial>, but a joint moves it; {others} other moving links have one. Simulators "
            "such as Gazebo leave out a link without mass, with its joint."
        )
        ledger.add("urdf.massless", "warning", text, name, suggestion="write its mass")


def _check_repeated_shapes(root: ET.Element, ledger: Ledger) -> None:
    """Report shapes that a link has twice, at the same place."""
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            shapes: list[str] = []
            for element in link.findall(tag):
                # As text, so that shapes with the same content are equal; behind an element is the space of its line.
                shapes.append(ET.tostring(element, encoding="unicode").strip())
            for shape in repeated(shapes):
                name = str(ET.fromstring(shape).get("name") or tag)
                owner = str(link.get("name"))
                text = f"link '{owner}' has the {tag} shape '{name}' {shapes.count(shape)} times."
                ledger.add("urdf.repeated", "warning", text, owner, suggestion="keep one of them")
