"""Check the collision meshes of a URDF: their files exist, and they are the visual ones where the file says so.

An export shows and collides each link by the same meshes: `arm_visual` and `arm_collision` are both meshes/arm.obj.
Files of others often collide by simpler meshes, or do not collide at all. So only visual meshes with such a name and
file are compared, and what differs is only a fault if most of them are equal; otherwise its number is a note.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from twin.core import format
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.poses import Array

_VISUAL_ENDING = "_visual"

_COLLISION_ENDING = "_collision"

_EXPORTED_FILE = "meshes/{}.obj"
"""File of an exported mesh, by its name."""

_UNNAMED_KEY = "\0"
"""Beginning of the keys of meshes without a name of this kind, which no name of XML has."""

_EQUAL_ROUNDING = 1e-9
"""Difference of scales, and of poses in m and components of unit vectors, that is only rounding."""


@dataclass(frozen=True)
class _PlacedMesh:
    """A mesh of a link: its file as written, its scale (3,), its pose (4, 4) in the link."""

    file: str
    scale: Array
    T: Array

    def differences(self, other: _PlacedMesh) -> list[str]:
        """Return in what another mesh differs, as texts for an enumeration."""
        texts = []
        if self.file != other.file:
            texts.append(f"file '{other.file}' instead of '{self.file}'")
        if np.abs(self.scale - other.scale).max() > _EQUAL_ROUNDING * np.abs(self.scale).max():
            texts.append(f"scale {_text(other.scale)} instead of {_text(self.scale)}")
        if np.abs(self.T - other.T).max() > _EQUAL_ROUNDING:
            shift = float(np.linalg.norm(self.T[:3, 3] - other.T[:3, 3]))
            turn = float(np.abs(self.T[:3, :3] - other.T[:3, :3]).max())
            place = "another place"
            if shift > _EQUAL_ROUNDING:
                place += f" ({1e3 * shift:.4g} mm)"
            if turn > _EQUAL_ROUNDING:
                place += ", turned"
            texts.append(place)
        return texts


def check_collisions(
    root: ET.Element,
    ledger: Ledger,
    resolve: Callable[[str], Path | None],
    placed: Callable[[ET.Element], tuple[Array, Array]],
) -> None:
    """Report collision meshes that do not exist, or are others than the visual meshes of the same names.

    If at most half of the compared meshes are equal, the differences are only counted.

    Args:
        root: the element <robot>.
        ledger: receives the findings.
        resolve: returns the file of a mesh by its name in the URDF; None if there is none.
        placed: returns scale (3,) and pose (4, 4) in the link of an element <visual> or <collision> with a mesh.
    """
    missing: set[str] = set()
    equal = 0
    faults: list[tuple[str, str]] = []
    for link in root.findall("link"):
        owner = link.get("name", "")
        collisions = _meshes(link, "collision", _COLLISION_ENDING, placed)
        visuals = _meshes(link, "visual", _VISUAL_ENDING, placed)
        for mesh in collisions.values():
            if mesh.file not in missing and resolve(mesh.file) is None:
                missing.add(mesh.file)
                ledger.wrong("urdf.mesh", f"collision mesh file '{mesh.file}' does not exist.", mesh.file)
        equal_of_link, texts = _differences(visuals, collisions)
        equal += equal_of_link
        for shape in _plain_collisions(link):
            texts.append(f"collides by a {shape}; exports collide by meshes only")
        for text in texts:
            separator = ":" if text.startswith("'") else ""
            faults.append((owner, f"link '{owner}'{separator} {text}."))
    # Only if most pairs are equal, the file is an export in which a differing pair is a mistake.
    if equal <= len(faults):
        if faults:
            _not_judged(equal, faults, ledger)
        return
    for owner, text in faults:
        ledger.wrong("urdf.collision", text, owner, suggestion="export the file again")


def _differences(visuals: Mapping[str, _PlacedMesh], collisions: Mapping[str, _PlacedMesh]) -> tuple[int, list[str]]:
    """Return (number of equal pairs, differences) of the meshes of a link, as parts of sentences about the link."""
    equal = 0
    texts: list[str] = []
    for name, visual in visuals.items():
        if visual.file != _EXPORTED_FILE.format(name):
            continue
        visual_name = f"'{name}{_VISUAL_ENDING}'"
        collision_name = f"'{name}{_COLLISION_ENDING}'"
        collision = collisions.get(name)
        if collision is None:
            texts.append(f"has the visual mesh {visual_name}, but no {collision_name}")
            continue
        differences = visual.differences(collision)
        if not differences:
            equal += 1
            continue
        texts.append(f"{collision_name} differs from {visual_name}: {', '.join(differences)}")
    for name, collision in collisions.items():
        if name.startswith(_UNNAMED_KEY):
            texts.append(f"collides by {collision.file}, which is none of its '…{_COLLISION_ENDING}'")
        elif name not in visuals and collision.file == _EXPORTED_FILE.format(name):
            collision_name = f"'{name}{_COLLISION_ENDING}'"
            texts.append(f"has the collision mesh {collision_name}, but no '{name}{_VISUAL_ENDING}'")
    return equal, texts


def _plain_collisions(link: ET.Element) -> list[str]:
    """Return the kinds of the collision shapes of a link that are no meshes, such as "sphere"."""
    shapes = []
    for geometry in link.findall("collision/geometry"):
        for shape in geometry:
            if shape.tag != "mesh":
                shapes.append(str(shape.tag))
    return shapes


def _not_judged(equal: int, faults: Sequence[tuple[str, str]], ledger: Ledger) -> None:
    """Report how many differences, given as (link, text), may be the choice of an author."""
    differences = format.count(len(faults), "difference")
    pairs = format.count(equal, "equal pair")
    text = (
        f"{differences} between collision and visual meshes not judged: with only {pairs}, the collision meshes may be "
        f"others by choice. The first: {faults[0][1]}"
    )
    advice = "if the file is an export whose collisions were changed, export it again"
    ledger.add("urdf.collision_unjudged", "info", text, faults[0][0], suggestion=advice)


def _meshes(
    link: ET.Element, tag: str, ending: str, placed: Callable[[ET.Element], tuple[Array, Array]]
) -> dict[str, _PlacedMesh]:
    """Return {name without its ending: mesh} of the elements `tag` of a link; other keys for those with other names."""
    meshes: dict[str, _PlacedMesh] = {}
    for index, element in enumerate(link.findall(tag)):
        mesh = element.find("geometry/mesh")
        if mesh is None:
            continue
        name = element.get("name", "")
        key = name.removesuffix(ending)
        if key == name or not key or key in meshes:
            key = f"{_UNNAMED_KEY}{index}"
        scale, T_link_mesh = placed(element)
        meshes[key] = _PlacedMesh(mesh.get("filename", ""), scale, T_link_mesh)
    return meshes


def _text(scale: Array) -> str:
    return " ".join(map("{:g}".format, scale))
