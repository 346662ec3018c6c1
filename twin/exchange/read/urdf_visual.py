"""Read the visual data of a URDF: shapes, meshes, colours."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from twin.core import spatial
from twin.core.errors import unknown
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.exchange.read.shapes import GREY, SIZES, Color, mesh_file, placed, primitive, size
from twin.exchange.read.source import note, rpy, warning
from twin.exchange.read.xml import Xml
from twin.model.body import Mesh
from twin.usd.read.names import identifier


def origin(xml: Xml, element: Element, where: str) -> Array:
    """Return the pose (4, 4) of an element's <origin>; the identity if it has none."""
    found = element.find("origin")
    xyz, angles = (found.get("xyz"), found.get("rpy")) if found is not None else (None, None)
    p = xml.numbers(where, "origin xyz", xyz, 3, (0, 0, 0))
    return spatial.pose(rpy(xml.numbers(where, "origin rpy", angles, 3, (0, 0, 0))), p)


class Visuals:
    """Reader of the links' meshes in one file; colours may be defined by name for the whole robot."""

    def __init__(self, xml: Xml, findings: list[Finding]) -> None:
        self.xml, self.findings = xml, findings
        self.path = xml.path
        self.taken: dict[str, int] = {}
        self.colors: dict[str, Color] = {}
        for m in xml.root.findall("material"):
            where = f"material '{m.get('name')}'"
            self._texture(m, where)
            if m.find("color") is not None:
                self.colors[m.get("name", "")] = self._color(m, where)

    def _texture(self, material: Element, where: str) -> None:
        texture = material.find("texture")
        if texture is not None:
            self.findings.append(
                warning("texture", f"{where}: texture {texture.get('filename')} is not imported.", where)
            )

    def _color(self, material: Element | None, where: str) -> Color:
        color = material.find("color") if material is not None else None
        if color is None:
            return self.colors.get(material.get("name", ""), GREY) if material is not None else GREY
        r, g, b, a = self.xml.numbers(where, "color rgba", color.get("rgba"), 4, GREY)
        return (float(r), float(g), float(b), float(a))

    def meshes(self, name: str, link: Element) -> list[Mesh]:
        """Return the visual shapes of a link, or its collision shapes if it has no visual shapes."""
        where, out = f"link '{name}'", []
        if link.find("visual") is not None and link.find("collision") is not None:
            text = f"{where}: its <collision> shapes are not imported; the visual meshes are used for collision."
            self.findings.append(note("collision", text, name))
        for element in link.findall("visual") or link.findall("collision"):
            geometry = element.find("geometry")
            shape = geometry[0] if geometry is not None and len(geometry) else None
            if shape is None:
                self.xml.fail(where, "a <visual> without geometry")
            if shape.tag == "mesh":
                scale = self.xml.numbers(where, "mesh scale", shape.get("scale"), 3, (1, 1, 1))
                solid = mesh_file(shape.get("filename", ""), self.path.parent, scale, name, self.findings)
            elif shape.tag in SIZES:
                solid = primitive(shape.tag, size(self.xml, where, shape.tag, shape.get))
            else:
                self.xml.fail(where, unknown("shape", str(shape.tag), (*SIZES, "mesh")))
            if solid is not None:
                stem = identifier(f"{name}_shape")
                self.taken[stem] = self.taken.get(stem, 0) + 1
                label = stem if self.taken[stem] == 1 else f"{stem}_{self.taken[stem]}"
                material = element.find("material")
                if material is not None:
                    self._texture(material, where)
                color = self._color(material, where)
                out.append(placed(label, *solid, origin(self.xml, element, where), color))
        return out
