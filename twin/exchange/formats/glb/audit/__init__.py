"""Read a glTF scene (nodes, clips, meshes and materials), and report faults. glTF uses metres, with y up."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.foreign.admit import admit
from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.colors import Palette, Rgba, surface_area
from twin.exchange.audit.context import Context
from twin.exchange.audit.meshes import check_mesh, joined
from twin.exchange.audit.motion import Content, Shape, check_poses
from twin.exchange.audit.physics import Frame, Joint, Mass, Physics
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured
from twin.exchange.formats.glb.audit.clips import Clips
from twin.exchange.formats.glb.audit.container import Gltf, open_gltf
from twin.exchange.formats.glb.audit.nodes import Node, link_above, numbers, parents_first, read_nodes

SCALE_TOL = 1e-4
"""Maximum difference between a scale and 1 that counts as a rounding error."""


def read_gltf(path: Path, ledger: Ledger) -> Content:
    """Return the content of a .glb or .gltf file, and report its faults.

    Raises:
        ReadError: the container, the tree of nodes or an accessor cannot be read.
    """
    file = open_gltf(path, ledger)
    nodes = read_nodes(file)
    order = parents_first(nodes)
    asset = file.json["asset"]
    extras = asset.get("extras") if isinstance(asset.get("extras"), dict) else {}
    out = Content(ledger, "glb" if path.suffix == ".glb" else "gltf", model_hash=str(extras.get("model_hash", "")))
    out.facts = {
        "units": "m (glTF)",
        "up_axis": "Y (glTF)",
        "handedness": "right (glTF)",
        "generator": str(asset.get("generator", "")),
    }
    if required := [e for e in file.json.get("extensionsRequired", []) if e not in _UNDERSTOOD]:
        text = f"the file requires the extension {', '.join(map(str, required))}, which the audit does not support."
        ledger.add("gltf.extension", "warning", text)
    for i in range(len(file.items("accessors"))):
        file.accessor(i)
    links = tuple(n.name for n in nodes if n.is_link and n.name)
    out.declared = links or None
    clips = Clips(file, nodes, order)
    _check_names(file, nodes, clips.animated)
    _check_matrices(nodes, clips.animated, ledger)
    rest = clips.world({})
    _check_scales(nodes, rest, clips.animated, ledger)
    shown = [n for n in nodes if n.name and (n.is_link or not links)]
    out.rest = {n.name: clips.z_up(rest[n.index])[0] for n in shown}
    for clip in clips.read(shown):
        check_poses(ledger, clip, "gltf")
        out.clips.append(clip)
    twice = [name for name, n in Counter(c.name for c in out.clips).items() if n > 1]
    if twice:
        ledger.wrong("gltf.duplicate_clip", f"two clips are named '{twice[0]}'.", twice[0])
    _check_materials(file)
    out.shapes, out.colors = _shapes(file, nodes, rest)
    if links:
        out.physics = _physics(nodes, rest)
    _rows(ledger, out)
    return out


_UNDERSTOOD = {"KHR_mesh_quantization", "KHR_materials_unlit", "KHR_texture_transform"}


def _rows(ledger: Ledger, out: Content) -> None:
    wrong = Counter(f.code for f in ledger.found)
    for check, codes in {
        "quaternions: length, sign, step": ("gltf.quaternion", "gltf.quaternion_sign", "gltf.step"),
        "winding and normals": ("gltf.winding", "gltf.winding_mixed", "gltf.normal", "gltf.normals_against"),
        "alpha": ("gltf.alpha",),
        "names": ("gltf.duplicate_name", "gltf.duplicate_clip"),
        "scale, mirrors, matrices": ("gltf.scale", "gltf.mirrored", "gltf.matrix"),
        "accessors: bounds, min, max, finite": ("gltf.bounds", "gltf.minmax", "gltf.finite", "gltf.alignment"),
        "key times": ("gltf.times", "gltf.start", "gltf.samples"),
    }.items():
        count = sum(wrong[c] for c in codes)
        ledger.row(check, float(count), "found", 0.0)


def _check_names(file: Gltf, nodes: list[Node], animated: set[int]) -> None:
    first: dict[str, Node] = {}
    for n in nodes:
        other = first.setdefault(n.name, n) if n.name else n
        if other is not n:
            grave = any(m.is_link or m.index in animated for m in (n, other))
            text = (
                f"nodes {other.index} and {n.index} are both named '{n.name}': players that find nodes by name may "
                "move the wrong node."
            )
            file.ledger.add("gltf.duplicate_name", "disagreement" if grave else "warning", text, n.name)
    for i in sorted(animated):
        if not nodes[i].name:
            file.ledger.add("gltf.unnamed", "warning", f"animated node {i} has no name.", f"node {i}")
    for n in nodes:
        told = n.spec["extras"]["link"] if n.is_link else None
        if isinstance(told, str) and told != n.name:
            text = f"node '{n.label}' has the link name '{told}' in its extras: the two names must be equal."
            file.ledger.wrong("gltf.link_name", text, n.label, suggestion="give the node the name of its link")


def _check_matrices(nodes: list[Node], animated: set[int], ledger: Ledger) -> None:
    for n in nodes:
        if n.matrix is not None and n.index in animated:
            text = f"node '{n.label}' is animated and has a matrix: some players use the matrix, others the animation."
            ledger.wrong("gltf.matrix", text, n.label)


def _check_scales(nodes: list[Node], world: list[Array], animated: set[int], ledger: Ledger) -> None:
    declared = any(n.is_link for n in nodes)
    for n in nodes:
        _, size = poses.split(world[n.index][0])
        if np.linalg.det(world[n.index][0, :3, :3]) < 0 and (n.is_link or "mesh" in n.spec):
            text = f"node '{n.label}' is mirrored, which is not a rigid motion."
            ledger.add(
                "gltf.mirrored",
                "disagreement" if n.is_link else "warning",
                text,
                n.label,
                size=Measured(-1.0, 0.0),
                suggestion="mirror the points of the mesh and reverse its faces",
            )
        elif (n.is_link if declared else n.index in animated) and np.max(np.abs(size - 1)) > SCALE_TOL:
            text = f"node '{n.label}' is scaled by {size[0]:.5g}, {size[1]:.5g}, {size[2]:.5g} in the world."
            ledger.add(
                "gltf.scale",
                "disagreement" if n.is_link else "info",
                text,
                n.label,
                size=Measured(float(size[np.argmax(np.abs(size - 1))]), 1.0),
            )


def _check_materials(file: Gltf) -> None:
    for i, spec in enumerate(file.items("materials")):
        name = str(spec.get("name") or f"material {i}")
        pbr = spec.get("pbrMetallicRoughness", {})
        color = pbr.get("baseColorFactor", (1, 1, 1, 1)) if isinstance(pbr, dict) else (1, 1, 1, 1)
        alpha = float(numbers(color, 4, f"{name}: baseColorFactor")[3])
        if alpha < 1 and spec.get("alphaMode", "OPAQUE") == "OPAQUE":
            text = f"material '{name}' has alpha {alpha:.3g} but no alphaMode: it is shown opaque."
            file.ledger.wrong("gltf.alpha", text, name, size=Measured(alpha, 1.0), suggestion='write alphaMode "BLEND"')


def _physics(nodes: list[Node], world: list[Array]) -> Physics:
    """Return the mechanism data of the nodes and their `extras`: masses, names of joints, poses of frames, meshes."""
    out = Physics(tuple(n.name for n in nodes if n.is_link))
    shown = dict.fromkeys(out.links, False)
    for n in nodes:
        extras = n.spec.get("extras")
        extras = extras if isinstance(extras, dict) else {}
        owner = link_above(nodes, n)
        if owner is not None and "mesh" in n.spec:
            shown[owner.name] = True
        if n.is_link:
            if extras.get("whole") is False:
                out.partly |= {n.name}
            if isinstance(extras.get("mass"), int | float):
                out.masses[n.name] = Mass(float(extras["mass"]))
            joints = extras.get("joints")
            for name in joints if isinstance(joints, list) else ():
                out.joints.append(Joint((str(name),), "", n.name))
        elif isinstance(extras.get("frame"), str) and owner is not None:
            T, _ = poses.split(world[owner.index][0])
            at, _ = poses.split(world[n.index][0])
            out.frames[extras["frame"]] = Frame(owner.name, poses.inverse(T) @ at)
    out.shown = shown
    return out


def _shapes(file: Gltf, nodes: list[Node], world: list[Array]) -> tuple[dict[str, Shape], dict[str, dict[Rgba, float]]]:
    """Check every mesh once; return ({link: shape in the link's frame}, {link: {colour: fraction of area}})."""
    palette = Palette()
    known: dict[int, tuple[Array, Array]] = {}
    found: dict[str, list[Shape]] = {}
    for node in nodes:
        if "mesh" not in node.spec:
            continue
        which = node.spec["mesh"]
        mesh = file.item("meshes", which)
        name = str(mesh.get("name") or node.label)
        if which not in known:
            known[which] = _corners(file, mesh, name)
        vertices, triangles = known[which]
        owner = link_above(nodes, node)
        if owner is not None and owner.name and len(triangles):
            rigid, _ = poses.split(world[owner.index][0])
            M = poses.inverse(rigid) @ world[node.index][0]
            quiet = Ledger("")
            shape = check_mesh(quiet, name, vertices @ M[:3, :3].T + M[:3, 3], triangles, None, "gltf")
            if shape is not None:
                found.setdefault(owner.name, []).append(shape)
                _color(file, mesh, owner.name, palette)
    out = {name: joined(shapes) for name, shapes in found.items()}
    return {name: shape for name, shape in out.items() if shape is not None}, palette.shares()


def _primitives(file: Gltf, mesh: JsonObject) -> Iterator[tuple[JsonObject, Array, Array]]:
    """Yield (JSON object, points (n, 3), triangles (m, 3)) for each primitive that has positions."""
    for primitive in mesh.get("primitives", []):
        attributes = primitive.get("attributes", {})
        if "POSITION" not in attributes or "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
            continue
        vertices = file.accessor(attributes["POSITION"])
        index = primitive.get("indices")
        indices = np.arange(len(vertices)) if index is None else file.accessor(index)[:, 0].astype(int)
        yield primitive, vertices, _triangles(indices, primitive.get("mode", 4))


def _color(file: Gltf, mesh: JsonObject, link: str, palette: Palette) -> None:
    """Add the coloured areas of a mesh to the palette of its link."""
    for primitive, vertices, triangles in _primitives(file, mesh):
        if "material" not in primitive or not len(triangles) or triangles.max() >= len(vertices):
            continue
        pbr = file.item("materials", primitive["material"]).get("pbrMetallicRoughness", {})
        rgba = numbers(pbr.get("baseColorFactor", (1, 1, 1, 1)), 4, "baseColorFactor")
        palette.add(link, rgba, surface_area(vertices, triangles))


def _corners(file: Gltf, mesh: JsonObject, name: str) -> tuple[Array, Array]:
    """Check a mesh, and return the points (n, 3) and triangles (m, 3) of all its primitives."""
    points, faces, normals = [np.zeros((0, 3))], [np.zeros((0, 3), int)], []
    count, all_normals = 0, True
    for primitive, vertices, triangles in _primitives(file, mesh):
        attributes = primitive["attributes"]
        spec = file.item("accessors", attributes["POSITION"])
        if not ("min" in spec and "max" in spec):
            text = f"mesh '{name}': the accessor of the positions lacks min and max."
            file.ledger.wrong("gltf.minmax", text, name)
        if not len(triangles) or vertices.shape[1] != 3:
            continue
        normal = file.accessor(attributes["NORMAL"]) if "NORMAL" in attributes else np.zeros(0)
        if normal.shape == vertices.shape and triangles.max() < len(normal):
            normals.append(normal[triangles.ravel()])
        else:
            all_normals = False
        if triangles.max() >= len(vertices):
            check_mesh(file.ledger, name, vertices, triangles, None, "gltf")
            return points[0], faces[0]
        points.append(vertices)
        faces.append(triangles + count)
        count += len(vertices)
    vertices, triangles = np.vstack(points), np.vstack(faces)
    every = np.vstack(normals) if normals and all_normals else None
    check_mesh(file.ledger, name, vertices, triangles, every, "gltf")
    return vertices, triangles


def _triangles(indices: Array, mode: Any) -> Array:
    if mode == 4:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if mode == 5 and len(indices) > 2:
        strip = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
        strip[1::2] = strip[1::2, [1, 0, 2]]
        return strip
    if mode == 6 and len(indices) > 2:
        return np.stack([np.full(len(indices) - 2, indices[0]), indices[1:-1], indices[2:]], axis=1)
    return np.zeros((0, 3), int)


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a .glb or .gltf file, and report its faults; see `read_gltf`."""
    ledger.tool, ledger.version = "twin.exchange.audit gltf", "2.0"
    admit(path)
    return read_gltf(path, ledger)
