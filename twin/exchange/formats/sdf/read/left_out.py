"""Report the elements of an SDF that are not read."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from twin.exchange.read.imported_robot import Findings
from twin.exchange.read.xml_file import Xml

_READ_ELEMENTS = {
    "model": {"link", "joint", "frame", "pose"},
    "link": {"visual", "collision", "inertial", "pose"},
    "joint": {"parent", "child", "axis", "pose"},
    "axis": {"xyz", "limit", "mimic"},
    "limit": {"lower", "upper", "velocity", "effort"},
    "visual": {"geometry", "material", "pose", "transparency"},
    "material": {"diffuse"},
}
"""{name of a parent element: names of the child elements that are read}."""

_HARMLESS = {
    *("static", "self_collide", "allow_auto_disable", "enable_wind", "gravity", "cast_shadows", "ambient"),
    *("specular", "emissive", "lighting", "laser_retro", "meta", "must_be_base_link", "physics", "kinematic"),
}
"""Elements that affect only simulation or lighting; they are reported as notes, not as warnings."""

_TEXTS_WITHOUT_EFFECT = ("0", "0.0", "-1", "inf", "1e+16", "1e16", "")
"""Texts for which an element has no effect; an unread element with one of these texts is not reported."""


def find_left_out(model: Element, xml: Xml) -> Findings:
    """Return findings on the elements of a model, and of the world around it, that are not read."""
    findings = Findings()
    if xml.root.find("world") is not None:
        unread_elements: set[str] = set()
        for world in xml.root.findall("world"):
            for element in world:
                unread_elements.add(str(element.tag))
        unread_elements -= {"model", "gravity"}
        if unread_elements:
            listed = ", ".join(sorted(unread_elements))
            findings.note("unread", f"the elements {listed} of the world are not read.", "world")
    _report_children(model, "model", f"model '{model.get('name')}'", findings)
    return findings


def _report_children(element: Element, kind: str, where: str, findings: Findings) -> None:
    """Report the children of an element of a kind, a key of `_READ_ELEMENTS`, that are not read, and those in them."""
    for child in element:
        tag = str(child.tag)
        name = child.get("name")
        label = f"{where}, {tag}"
        if name:
            label += f" '{name}'"
        if tag == "collision" and element.find("visual") is not None:
            findings.note("collision", f"{label} is not imported: the visual meshes are used for collision.", where)
        elif tag not in _READ_ELEMENTS[kind]:
            _report_unread(child, tag, where, findings)
        elif tag in _READ_ELEMENTS:
            if tag in ("link", "joint"):  # their names are unique in the model, so no more is needed
                label = f"{tag} '{name}'"
            _report_children(child, tag, label, findings)


def _report_unread(child: Element, tag: str, where: str, findings: Findings) -> None:
    """Report an element that is not read: a note if it has no effect on the mechanism, else a warning."""
    if tag in ("dynamics", "stiffness", "dissipation"):
        values: list[str] = []
        for element in child.iter():  # begins with `child` itself, which may have a value or children
            text = (element.text or "").strip()
            if len(element) == 0 and text not in _TEXTS_WITHOUT_EFFECT:
                values.append(f"{element.tag} {text}")
        if values:
            listed = ", ".join(values)
            findings.warn("friction", f"{where}: {listed} is not imported.", where)
    elif tag == "plugin" and child.find(".//joint_name") is not None:
        text = f"{where}: of <plugin> '{child.get('name', '')}', only the names of the driven joints are read."
        findings.note("unread", text, where)
    elif tag == "initial_position" and (child.text or "").strip() in _TEXTS_WITHOUT_EFFECT:
        return  # the joint starts at zero, as without it
    elif tag in _HARMLESS:
        findings.note("unread", f"{where}: <{tag}> is not imported.", where)
    else:
        findings.warn("unread", f"{where}: <{tag}> is not read.", where)
