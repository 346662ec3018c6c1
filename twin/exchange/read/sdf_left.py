"""Report data of an SDF model that a mechanism cannot hold; each finding names the element."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from twin.core.findings import Finding
from twin.exchange.read.source import note, warning
from twin.exchange.read.xml import Xml

_READ = {
    "model": {"link", "joint", "frame", "pose"},
    "link": {"visual", "collision", "inertial", "pose"},
    "joint": {"parent", "child", "axis", "pose"},
    "axis": {"xyz", "limit", "mimic", "initial_position"},
    "limit": {"lower", "upper", "velocity", "effort"},
    "visual": {"geometry", "material", "pose", "transparency"},
    "material": {"diffuse"},
}
"""Names of the child elements that are read, by name of the parent element."""

_HARMLESS = {"static", "self_collide", "allow_auto_disable", "enable_wind", "gravity", "cast_shadows", "ambient"}
_HARMLESS |= {"specular", "emissive", "lighting", "laser_retro", "meta", "must_be_base_link", "physics", "kinematic"}
"""Elements that affect only simulation or lighting: reported as notes."""

_EMPTY = ("0", "0.0", "-1", "inf", "1e+16", "1e16", "")
"""Values that have no effect and are not reported."""


def left_out(model: Element, xml: Xml) -> list[Finding]:
    """Return findings on data of the model that are not imported."""
    found: list[Finding] = []
    if xml.root.find("world") is not None:
        others = sorted({str(e.tag) for w in xml.root.findall("world") for e in w} - {"model"})
        if others:
            found.append(note("unread", f"the elements {', '.join(others)} of the world are not read.", "world"))
    pose = model.find("pose")
    if pose is not None and (pose.text or "").strip():
        found.append(
            note(
                "unread", f"the model's pose in the world, {(pose.text or '').strip()[:60]}, is not imported.", "model"
            )
        )
    _walk(model, "model", f"model '{model.get('name')}'", found)
    return found


def _walk(element: Element, kind: str, where: str, found: list[Finding]) -> None:
    for child in element:
        tag = str(child.tag)
        named = f"{where}, {tag} '{child.get('name')}'" if child.get("name") else f"{where}, {tag}"
        if tag == "collision" and element.find("visual") is not None:
            found.append(
                note("collision", f"{named} is not imported: the visual meshes are used for collision.", where)
            )
        elif tag not in _READ[kind]:
            _tell(child, tag, where, found)
        elif tag in _READ:
            short = f"{tag} '{child.get('name')}'" if tag in ("link", "joint") else named
            _walk(child, tag, short, found)


def _tell(child: Element, tag: str, where: str, found: list[Finding]) -> None:
    if tag in ("dynamics", "stiffness", "dissipation"):
        values = [f"{e.tag} {(e.text or '').strip()}" for e in (child.iter() if len(child) else [child]) if _says(e)]
        if values:
            found.append(warning("friction", f"{where}: {', '.join(values)} is not imported.", where))
    elif tag in _HARMLESS:
        found.append(note("unread", f"{where}: <{tag}> is not imported.", where))
    else:
        found.append(warning("unread", f"{where}: <{tag}> is not read.", where))


def _says(element: Element) -> bool:
    return not len(element) and (element.text or "").strip() not in _EMPTY
