"""Read the elements <link> of a URDF: shapes and colours of the visual meshes, and mass properties."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.exchange.audit.colors import Palette, Rgba, linear
from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileMass
from twin.exchange.audit.mesh_files import named_mesh, placed_shape
from twin.exchange.audit.meshes import joined
from twin.exchange.audit.poses import Array
from twin.exchange.formats.urdf.audit.attributes import number, numbers, origin_pose


def read_shapes(
    root: ET.Element, path: Path, ledger: Ledger
) -> tuple[dict[str, LinkShape], dict[str, dict[Rgba, float]]]:
    """Return ({link: its shape}, {link: {colour: share of its surface}}) of the visual meshes; report missing ones."""
    shapes: dict[str, LinkShape] = {}
    materials = _material_colors(root)
    palette = Palette()
    meshes: dict[str, tuple[Array, Array] | None] = {}  # links may share mesh files, which are read once
    for link in root.findall("link"):
        name = link.get("name", "")
        parts: list[LinkShape] = []
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            scale = numbers(mesh.get("scale"), 3, (1, 1, 1))
            triangles = named_mesh(path, mesh.get("filename", ""), scale, meshes, ledger, "urdf")
            if triangles is None:
                continue
            part = placed_shape(triangles, origin_pose(visual.find("origin")), "urdf")
            color = _color(name, visual.find("material"), materials, ledger)
            if color is not None and part is not None:
                rgba = numbers(color.get("rgba"), 4, (1, 1, 1, 1))
                red, green, blue = linear(rgba[:3]).tolist()
                palette.add(name, (red, green, blue, float(rgba[3])), part.area)
            if part is not None:
                parts.append(part)
        shape = joined(parts)
        if shape is not None:
            shapes[name] = shape
    return shapes, palette.shares()


def _color(
    link: str, material: ET.Element | None, materials: Mapping[str | None, ET.Element | None], ledger: Ledger
) -> ET.Element | None:
    """Return the <color> of a visual shape of a link: its own, or that of its material's name in `materials`."""
    if material is None:
        return None
    color = material.find("color")
    if color is not None:
        return color
    name = material.get("name")
    if name in materials:
        return materials[name]
    text = f"link '{link}' has the material '{name}', which the file does not define."
    advice = "define the material: readers such as urdfdom refuse the file"
    ledger.wrong("urdf.material", text, link, suggestion=advice)
    return None


def _material_colors(root: ET.Element) -> dict[str | None, ET.Element | None]:
    """Return {name: its <color>} of all materials that a file defines; None for one that has only a texture."""
    materials: dict[str | None, ET.Element | None] = {}
    for material in root.iter("material"):
        if material.find("color") is not None or material.find("texture") is not None:
            materials.setdefault(material.get("name"), material.find("color"))
    return materials


def partly_read_links(root: ET.Element) -> frozenset[str]:
    """Return the names of links that have no collision shape, or a visual shape that is not a mesh and is not read."""
    names = set()
    for link in root.findall("link"):
        is_partly_read = link.find("collision") is None
        for visual in link.findall("visual"):
            if visual.find("geometry/mesh") is None:
                is_partly_read = True
        if is_partly_read:
            names.add(link.get("name", ""))
    return frozenset(names)


def read_masses(root: ET.Element) -> dict[str, FileMass]:
    """Return {link: mass properties} of the links with <inertial>."""
    masses: dict[str, FileMass] = {}
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            masses.pop(link.get("name", ""), None)  # of two links with one name, the last counts
        else:
            masses[link.get("name", "")] = _mass(inertial)
    return masses


def _mass(inertial: ET.Element) -> FileMass:
    """Return mass, centre of mass and inertia tensor about it, both in the frame of the link."""
    T_link_com = origin_pose(inertial.find("origin"))
    tensor = inertial.find("inertia")
    xx = number(tensor, "ixx", 0.0)
    xy = number(tensor, "ixy", 0.0)
    xz = number(tensor, "ixz", 0.0)
    yy = number(tensor, "iyy", 0.0)
    yz = number(tensor, "iyz", 0.0)
    zz = number(tensor, "izz", 0.0)
    stated_tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # URDF states the tensor along the axes of <origin>; files of other formats have it along those of the link.
    R = T_link_com[:3, :3]
    mass = number(inertial.find("mass"), "value", 0.0)
    return FileMass(mass, T_link_com[:3, 3], R @ stated_tensor @ R.T)
