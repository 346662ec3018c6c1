"""Read the shapes of the links of a URDF, with their places and colours."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from twin.core import spatial
from twin.core.errors import unknown
from twin.core.identifiers import identifier
from twin.core.spatial import Array
from twin.exchange.read.imported_robot import Findings, rpy
from twin.exchange.read.shapes import (
    GREY,
    SIZE_ATTRIBUTES,
    Color,
    link_meshes,
    mesh_file,
    placed_mesh,
    sized_primitive,
    stated_color,
)
from twin.exchange.read.xml_file import Xml
from twin.model.body import Mesh


def origin(xml: Xml, element: Element, where: str) -> Array:
    """Return the pose (4, 4) of an element's <origin>; the identity without <origin>."""
    place = element.find("origin")
    if place is None:
        return np.eye(4)
    p = xml.numbers(where, "origin xyz", place.get("xyz"), 3, (0, 0, 0))
    angles = xml.numbers(where, "origin rpy", place.get("rpy"), 3, (0, 0, 0))
    return spatial.pose(rpy(angles), p)


class Visuals:
    """Reader of the links' meshes in one URDF. Links may refer to colours that the URDF defines once, by name."""

    def __init__(self, xml: Xml, findings: Findings) -> None:
        self.xml = xml
        self.findings = findings
        self.shape_counts: dict[str, int] = {}
        self.colors: dict[str, Color] = {}
        for material in xml.root.findall("material"):
            where = f"material '{material.get('name')}'"
            self._texture(material, where)
            if material.find("color") is not None:
                self.colors[material.get("name", "")] = self._color(material, where)

    def _texture(self, material: Element, where: str) -> None:
        texture = material.find("texture")
        if texture is not None:
            self.findings.warn("texture", f"{where}: texture {texture.get('filename')} is not imported.", where)

    def _color(self, material: Element | None, where: str) -> Color:
        if material is None:
            return GREY
        color = material.find("color")
        if color is None:
            return self.colors.get(material.get("name", ""), GREY)
        return stated_color(color.get("rgba"), where, self.findings)

    def _scale(self, mesh: Element, where: str) -> Array:
        """Return the scale (3,) of a mesh; of more numbers, the first three, with a warning."""
        text = mesh.get("scale")
        words = (text or "").split()
        if len(words) > 3:
            self.findings.warn(
                "shape", f"{where}: of the mesh scale '{text}', the first three numbers are used.", where
            )
            text = " ".join(words[:3])
        return self.xml.numbers(where, "mesh scale", text, 3, (1, 1, 1))

    def meshes(self, name: str, link: Element) -> list[Mesh]:
        """Return the visual shapes of a link; if there are none, or none can be read, its collision shapes."""
        ignored = f"link '{name}': its <collision> shapes are not imported; the visual meshes are used for collision."
        return link_meshes(name, link, self._shapes, self.findings, ignored)

    def _shapes(self, name: str, elements: list[Element]) -> list[Mesh]:
        """Return the shapes that can be read of the <visual> or <collision> elements of a link."""
        where = f"link '{name}'"
        stem = identifier(f"{name}_shape")
        meshes = []
        for element in elements:
            geometry = element.find("geometry")
            if geometry is None or not len(geometry):
                self.xml.fail(where, f"a <{element.tag}> has no shape in a <geometry>")
            shape = geometry[0]
            if shape.tag == "mesh":
                scale = self._scale(shape, where)
                triangle_mesh = mesh_file(shape.get("filename", ""), self.xml.path.parent, scale, name, self.findings)
            elif shape.tag in SIZE_ATTRIBUTES:
                triangle_mesh = sized_primitive(self.xml, where, shape.tag, shape.get, self.findings)
            else:
                self.xml.fail(where, unknown("shape", str(shape.tag), (*SIZE_ATTRIBUTES, "mesh")))
            if triangle_mesh is None:
                continue
            vertices, triangles = triangle_mesh
            # Counted over all links, because different names of links may become the same identifier.
            number = self.shape_counts.get(stem, 0) + 1
            self.shape_counts[stem] = number
            label = stem if number == 1 else f"{stem}_{number}"
            material = element.find("material")
            if material is not None:
                self._texture(material, where)
            color = self._color(material, where)
            meshes.append(placed_mesh(label, vertices, triangles, origin(self.xml, element, where), color))
        return meshes
