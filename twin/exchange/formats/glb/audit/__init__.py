"""Read a glTF scene (nodes, clips, meshes and materials), and report faults. glTF uses metres, with y up."""

from __future__ import annotations

import re
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
from twin.exchange.audit.mechanism_data import FileFrame, FileJoint, FileMass, FilePhysics
from twin.exchange.audit.meshes import check_mesh, joined
from twin.exchange.audit.motion import Content, LinkShape, check_poses
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured
from twin.exchange.audit.stated import ROBOT
from twin.exchange.formats.glb.audit.clips import Clips
from twin.exchange.formats.glb.audit.container import Gltf, open_gltf
from twin.exchange.formats.glb.audit.features import check_features
from twin.exchange.formats.glb.audit.nodes import Node, link_above, numbers, parents_first, read_nodes

SCALE_TOL = 1e-4
"""Maximum difference between a scale and 1 that counts as a rounding error."""

_UNDERSTOOD = {"KHR_mesh_quantization", "KHR_materials_unlit", "KHR_texture_transform"}
"""Extensions that change nothing that the audit reads, or that the audit supports."""


SCHEMA = "twin-glb"
"""Schema of the extras of the asset in a GLB of twin."""

_CONVENTIONS = {
    "schema": SCHEMA,
    "version": 1,
    "units": "m, kg, s",
    "frame": "links below the root node: z-up right-handed",
}
"""Entries of these extras that are the same in every file."""

ALPHA_MODES = ("OPAQUE", "MASK", "BLEND")
"""Values of alphaMode in glTF 2.0, 3.9.4."""


def read_gltf(path: Path, ledger: Ledger) -> Content:
    """Return the content of a .glb or .gltf file, and report its faults.

    Raises:
        ReadError: the container, the tree of nodes or an accessor cannot be read.
    """
    file = open_gltf(path, ledger)
    nodes = read_nodes(file)
    order = parents_first(nodes)
    asset = file.json["asset"]
    model_hash = ""
    if isinstance(asset.get("extras"), dict):
        model_hash = str(asset["extras"].get("model_hash", ""))
    content = Content(ledger, "glb" if path.suffix == ".glb" else "gltf", model_hash=model_hash)
    content.facts = {
        "units": "m (glTF)",
        "up_axis": "Y (glTF)",
        "handedness": "right (glTF)",
        "generator": str(asset.get("generator", "")),
    }
    required = [str(e) for e in file.json.get("extensionsRequired", []) if e not in _UNDERSTOOD]
    if required:
        text = f"the file requires the extension {', '.join(required)}, which the audit does not support."
        ledger.add("gltf.extension", "error", text, suggestion="export the file without this extension")
    _check_asset(asset, content, ledger)
    _state_clips(file, content)
    if ROBOT in content.stated:
        _check_kinds(nodes, ledger)
    # Also accessors that nothing uses are read, because reading reports their faults.
    for i in range(len(file.items("accessors"))):
        file.accessor(i)
    links = tuple(node.name for node in nodes if node.is_link and node.name)
    content.declared = links or None
    if links:  # files without links, such as those of organs, have other features
        check_features(file.json, ledger)
    clips = Clips(file, nodes, order)
    _check_names(file, nodes, clips.animated)
    _check_scene(file, nodes, order, ledger)
    _check_matrices(nodes, clips.animated, ledger)
    rest = clips.world({})
    _check_scales(nodes, rest, clips.animated, ledger)
    shown = [node for node in nodes if node.name and (node.is_link or not links)]
    for node in shown:
        content.rest[node.name] = clips.z_up(rest[node.index])[0]
    for clip in clips.read(shown):
        check_poses(ledger, clip, "gltf")
        content.clips.append(clip)
    _check_clip_names(content)
    _check_materials(file)
    _check_smooth(file)
    content.shapes, content.colors, content.finishes = _shapes(file, nodes, rest)
    if links:
        content.physics = _physics(nodes, rest, ledger)
    _state_checks(ledger)
    return content


_CHECKS = {
    "quaternions: length, sign, step": ("gltf.quaternion", "gltf.quaternion_sign", "gltf.step"),
    "winding and normals": ("gltf.winding", "gltf.winding_mixed", "gltf.normal", "gltf.normals_against"),
    "alpha": ("gltf.alpha",),
    "names": ("gltf.duplicate_name", "gltf.duplicate_clip"),
    "scale, mirrors, matrices": ("gltf.scale", "gltf.mirrored", "gltf.matrix"),
    "accessors: bounds, counts, min, max, finite": (
        "gltf.bounds",
        "gltf.count",
        "gltf.minmax",
        "gltf.finite",
        "gltf.alignment",
    ),
    "key times": ("gltf.times", "gltf.start", "gltf.samples"),
}
"""Codes of the findings of each check of one file."""


def _state_checks(ledger: Ledger) -> None:
    """Add a row for each check of one file, with the number of its findings."""
    counts = Counter(finding.code for finding in ledger.found)
    for check, codes in _CHECKS.items():
        count = sum(counts[code] for code in codes)
        ledger.row(check, float(count), "found", 0.0)


def _check_clip_names(content: Content) -> None:
    counts = Counter(clip.name for clip in content.clips)
    for name, count in counts.items():
        if count > 1:
            content.ledger.wrong("gltf.duplicate_clip", f"two clips are named '{name}'.", name)
            return  # one finding is enough


def _check_asset(asset: JsonObject, content: Content, ledger: Ledger) -> None:
    """Report the version, and entries in the extras of a file of twin that are missing or not those of its numbers."""
    version = asset.get("version")
    if re.fullmatch(r"2\.\d+", str(version)) is None:
        ledger.wrong("gltf.version", f"the version of the file is {version!r}, not 2.0.", "version")
    extras = asset.get("extras")
    if not isinstance(extras, dict) or not extras:
        return
    written_by_twin = str(asset.get("generator", "")).startswith("twin ")
    if extras.get("schema") != SCHEMA and not written_by_twin:
        return  # a file of others
    for key, expected in _CONVENTIONS.items():
        if extras.get(key) != expected:
            text = (
                f"asset.extras: '{key}' is {extras.get(key)!r}; for links and poses as in this file it is {expected!r}."
            )
            ledger.wrong("gltf.units" if key == "units" else "gltf.asset", text, key)
    for key in ("robot", "model_hash"):
        if not extras.get(key):
            ledger.wrong("gltf.asset", f"asset.extras: '{key}' is missing or empty.", key)
    if extras.get("robot"):
        content.stated[ROBOT] = extras["robot"]


def _check_kinds(nodes: list[Node], ledger: Ledger) -> None:
    """Report nodes of a file of twin that are neither links nor frames, or are not named and described as these."""
    for node in nodes:
        frame = node.extras.get("frame")
        if node.parent >= 0 and not node.extras.get("link") and not frame:
            text = f"node '{node.label}' is neither a link nor a frame: its extras state neither."
            ledger.wrong("gltf.node", text, node.label, suggestion="export the file again")
        # A link or another frame may have the name, which then ends in "_".
        if frame and node.name.rstrip("_") != f"frame_{frame}".rstrip("_"):
            text = f"the node of frame '{frame}' is named '{node.name}', not 'frame_{frame}'."
            ledger.wrong("gltf.node", text, node.label, suggestion="give the node the name of its frame")
        if node.is_link and not isinstance(node.extras.get("joints"), list):
            text = f"the extras of link '{node.label}' have no list 'joints' of the joints that move it."
            ledger.wrong("gltf.node", text, node.label, suggestion="export the file again")


def _state_clips(file: Gltf, content: Content) -> None:
    """Store what the extras of the clips state about them."""
    for spec in file.items("animations"):
        extras = spec.get("extras")
        if isinstance(extras, dict):
            stated = ("title", "rate", "between_position", "between_rotation", "joint_gap")
            missing = [key for key in stated if key not in extras]
            if missing and ROBOT in content.stated:
                text = f"clip '{spec.get('name')}' does not state its {missing[0]}."
                file.ledger.wrong("gltf.clip", text, missing[0], suggestion="export the file again")
            for key in stated:
                if key in extras:
                    content.stated[f"{key} of clip '{spec.get('name')}'"] = extras[key]


def _check_scene(file: Gltf, nodes: list[Node], order: list[int], ledger: Ledger) -> None:
    """Report links, frames and shapes outside of the scene that viewers show; `order` has parents before children."""
    scenes = file.items("scenes")
    number = file.json.get("scene", 0)
    roots: Any = []
    if isinstance(number, int) and 0 <= number < len(scenes):
        roots = scenes[number].get("nodes", [])
    inside = {i for i in roots if isinstance(i, int)} if isinstance(roots, list) else set()
    if isinstance(roots, list) and len(inside) < len(roots):
        text = f"the scene lists one of its {len(roots)} root nodes twice: glTF requires that each is there once."
        ledger.wrong("gltf.scene", text, "scene")
    for i in order:
        if nodes[i].parent in inside:
            inside.add(i)
    absent: list[str] = []
    for node in nodes:
        marked = node.is_link or node.extras.get("frame")
        if node.index not in inside and (marked or "mesh" in node.spec):
            absent.append(node.label)
    if absent:
        text = f"{len(absent)} links, frames or shapes, such as '{absent[0]}', are not in the scene that viewers show."
        ledger.wrong("gltf.scene", text, absent[0], suggestion="make each the child of a node of the scene")


def _check_names(file: Gltf, nodes: list[Node], animated: set[int]) -> None:
    ledger = file.ledger
    first: dict[str, Node] = {}
    for node in nodes:
        if not node.name:
            continue
        other = first.setdefault(node.name, node)
        if other is node:
            continue
        matters = {node.index, other.index} & animated or node.is_link or other.is_link
        text = (
            f"nodes {other.index} and {node.index} are both named '{node.name}': players that find nodes by name may "
            "move the wrong node."
        )
        ledger.add("gltf.duplicate_name", "disagreement" if matters else "warning", text, node.name)
    for i in sorted(animated):
        if not nodes[i].name:
            ledger.add("gltf.unnamed", "warning", f"animated node {i} has no name.", f"node {i}")
    for node in nodes:
        if not node.is_link:
            continue
        link = node.extras["link"]
        if isinstance(link, str) and link != node.name:
            text = f"node '{node.label}' has the link name '{link}' in its extras: the two names must be equal."
            ledger.wrong("gltf.link_name", text, node.label, suggestion="give the node the name of its link")


def _check_matrices(nodes: list[Node], animated: set[int], ledger: Ledger) -> None:
    for node in nodes:
        if node.matrix is not None and node.index in animated:
            text = (
                f"node '{node.label}' is animated and has a matrix: some players use the matrix, others the animation."
            )
            ledger.wrong("gltf.matrix", text, node.label)


def _check_scales(nodes: list[Node], world: list[Array], animated: set[int], ledger: Ledger) -> None:
    """Report mirrored links and meshes, and scaled links; without links, scaled nodes that are animated."""
    declared = any(node.is_link for node in nodes)
    for node in nodes:
        M = world[node.index][0]
        _, scale = poses.split(M)
        deviation = np.abs(scale - 1)
        if np.linalg.det(M[:3, :3]) < 0 and (node.is_link or "mesh" in node.spec):
            text = f"node '{node.label}' is mirrored, which is not a rigid motion."
            severity = "disagreement" if node.is_link else "warning"
            advice = "mirror the points of the mesh and reverse its faces"
            ledger.add("gltf.mirrored", severity, text, node.label, size=Measured(-1.0, 0.0), suggestion=advice)
            continue
        moves = node.is_link if declared else node.index in animated
        if moves and np.max(deviation) > SCALE_TOL:
            x, y, z = scale
            text = f"node '{node.label}' is scaled by {x:.5g}, {y:.5g}, {z:.5g} in the world."
            severity = "disagreement" if node.is_link else "info"
            size = Measured(float(scale[np.argmax(deviation)]), 1.0)
            ledger.add("gltf.scale", severity, text, node.label, size=size)


def _check_materials(file: Gltf) -> None:
    """Report unknown values, and transparent materials that are shown opaque: the default alphaMode is OPAQUE."""
    for i, spec in enumerate(file.items("materials")):
        name = str(spec.get("name") or f"material {i}")
        pbr = spec.get("pbrMetallicRoughness", {})
        alpha = 1.0
        if isinstance(pbr, dict):
            alpha = float(_base_color(pbr, f"{name}: baseColorFactor")[3])
        if alpha < 1 and spec.get("alphaMode", "OPAQUE") == "OPAQUE":
            text = f"material '{name}' has alpha {alpha:.3g} but no alphaMode: it is shown opaque."
            file.ledger.wrong("gltf.alpha", text, name, size=Measured(alpha, 1.0), suggestion='write alphaMode "BLEND"')
        for key in ("metallicFactor", "roughnessFactor"):
            factor = _factor(pbr, key) if isinstance(pbr, dict) else 1.0
            if not 0 <= factor <= 1:
                text = f"material '{name}' has the {key} {factor:.3g}, which is not from 0 to 1."
                file.ledger.wrong("gltf.material", text, name)
        if spec.get("alphaMode", "OPAQUE") not in ALPHA_MODES:
            text = f"material '{name}' has the alphaMode {spec['alphaMode']!r}; glTF has: {', '.join(ALPHA_MODES)}."
            file.ledger.wrong("gltf.alpha", text, name)
        cutoff = float(numbers([spec.get("alphaCutoff", 0.5)], 1, f"{name}: alphaCutoff")[0])
        if spec.get("alphaMode") == "MASK" and alpha < cutoff:
            text = f"material '{name}' has alpha {alpha:.3g}, below its alphaCutoff {cutoff:.3g}: it is not shown."
            file.ledger.wrong("gltf.alpha", text, name, size=Measured(alpha, cutoff))


def _factor(pbr: JsonObject, key: str) -> float:
    """Return how metallic or rough a material is; the default of glTF is 1."""
    return float(numbers([pbr.get(key, 1.0)], 1, key)[0])


def _base_color(pbr: JsonObject, name: str) -> Array:
    """Return the linear colour rgba (4,) of a material; the default of glTF is white."""
    return numbers(pbr.get("baseColorFactor", (1, 1, 1, 1)), 4, name)


def _physics(nodes: list[Node], world: list[Array], ledger: Ledger) -> FilePhysics:
    """Return the mechanism data of the nodes and their `extras`: masses, names of joints, poses of frames, meshes."""
    physics = FilePhysics(tuple(node.name for node in nodes if node.is_link))
    shown = dict.fromkeys(physics.links, False)
    for node in nodes:
        extras = node.extras
        owner = link_above(nodes, node)
        if owner is not None and "mesh" in node.spec:
            shown[owner.name] = True
        if node.is_link:
            if extras.get("whole") is False:
                physics.partly |= {node.name}
            if isinstance(extras.get("mass"), int | float):
                physics.masses[node.name] = FileMass(float(extras["mass"]))
            joints = extras.get("joints")
            if isinstance(joints, list):
                repeated = sorted({str(name) for name in joints if joints.count(name) > 1})
                if repeated:
                    text = f"link '{node.name}' lists joint '{repeated[0]}' more than once."
                    ledger.wrong("gltf.duplicate_joint", text, node.name)
                for name in joints:
                    physics.joints.append(FileJoint((str(name),), "", node.name))
        elif isinstance(extras.get("frame"), str) and owner is not None:
            T_world_link, _ = poses.split(world[owner.index][0])
            T_world_frame, _ = poses.split(world[node.index][0])
            physics.frames[extras["frame"]] = FileFrame(owner.name, poses.inverse(T_world_link) @ T_world_frame)
    physics.shown = shown
    return physics


def _shapes(
    file: Gltf, nodes: list[Node], world: list[Array]
) -> tuple[dict[str, LinkShape], dict[str, dict[Rgba, float]], dict[str, dict[Rgba, float]]]:
    """Check every mesh once; return the shapes of the links in their frames, and the shares of colours and finishes."""
    palette = Palette()
    finishes = Palette()
    known: dict[int, tuple[Array, Array]] = {}
    parts: dict[str, list[LinkShape]] = {}
    for node in nodes:
        if "mesh" not in node.spec:
            continue
        index = node.spec["mesh"]
        mesh = file.item("meshes", index)
        name = str(mesh.get("name") or node.label)
        if index not in known:
            _check_shown(mesh, name, file.ledger)
            known[index] = _corners(file, mesh, name)
        vertices, triangles = known[index]
        owner = link_above(nodes, node)
        if owner is None or not owner.name or not len(triangles):
            continue
        T_world_link, _ = poses.split(world[owner.index][0])
        M = poses.inverse(T_world_link) @ world[node.index][0]
        points = vertices @ M[:3, :3].T + M[:3, 3]
        # `_corners` has reported the faults of the mesh.
        shape = check_mesh(Ledger(""), name, points, triangles, None, "gltf")
        if shape is not None:
            parts.setdefault(owner.name, []).append(shape)
            _add_colors(file, mesh, owner.name, palette, finishes)
    shapes = {}
    for link, meshes in parts.items():
        shape = joined(meshes)
        if shape is not None:
            shapes[link] = shape
    return shapes, palette.shares(), finishes.shares()


def _check_smooth(file: Gltf) -> None:
    """Report meshes without normals in a file in which other meshes have them."""
    faceted = []
    smooth = 0
    for number, mesh in enumerate(file.items("meshes")):
        primitives = mesh.get("primitives") or []
        if any("NORMAL" in primitive.get("attributes", {}) for primitive in primitives):
            smooth += 1
        elif primitives:
            faceted.append(str(mesh.get("name") or f"mesh {number}"))
    if smooth and faceted:
        text = f"mesh '{faceted[0]}' has no NORMAL: viewers show it faceted; {smooth} other meshes have normals."
        file.ledger.add("gltf.normal", "warning", text, faceted[0], suggestion="write the normals of the mesh")


def _check_shown(mesh: JsonObject, name: str, ledger: Ledger) -> None:
    """Report a mesh that shows nothing, or not all of its primitives."""
    primitives = mesh.get("primitives")
    if not primitives:
        ledger.wrong("gltf.mesh", f"mesh '{name}' has no primitives: it shows nothing.", name)
        return
    drawn = []
    for number, primitive in enumerate(primitives):
        if primitive in drawn:
            text = f"mesh '{name}': primitive {number} is the same as another: its surface is there twice."
            ledger.wrong("gltf.mesh", text, name, suggestion="leave one of the two out")
        drawn.append(primitive)
        if "POSITION" not in primitive.get("attributes", {}):
            text = f"mesh '{name}': primitive {number} has no POSITION: viewers do not show it."
            ledger.wrong("gltf.mesh", text, name, suggestion="give each primitive the points of its triangles")


def _primitives(file: Gltf, mesh: JsonObject) -> Iterator[tuple[JsonObject, Array, Array]]:
    """Yield (JSON object, points (n, 3), triangles (m, 3)) for each primitive that has positions."""
    for primitive in mesh.get("primitives", []):
        attributes = primitive.get("attributes", {})
        if "POSITION" not in attributes or "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
            continue
        vertices = file.accessor(attributes["POSITION"])
        index = primitive.get("indices")
        if index is None:  # the points are the corners, in their order
            indices = np.arange(len(vertices))
        else:
            indices = file.accessor(index)[:, 0].astype(int)
        yield primitive, vertices, _triangles(indices, primitive.get("mode", _TRIANGLES))


def _add_colors(file: Gltf, mesh: JsonObject, link: str, palette: Palette, finishes: Palette) -> None:
    """Add the coloured areas of a mesh to the palette of its link, and the areas of each finish."""
    for primitive, vertices, triangles in _primitives(file, mesh):
        if not len(triangles) or triangles.max() >= len(vertices):
            continue
        if "material" in primitive:
            pbr = file.item("materials", primitive["material"]).get("pbrMetallicRoughness", {})
        elif file.items("materials"):
            pbr = {}  # viewers show the default material of glTF, white metal
        else:
            continue  # the file states no colours
        area = surface_area(vertices, triangles)
        palette.add(link, _base_color(pbr, "baseColorFactor"), area)
        if isinstance(pbr, dict) and "metallicRoughnessTexture" not in pbr:
            finishes.add_finish(link, _factor(pbr, "metallicFactor"), _factor(pbr, "roughnessFactor"), area)


def _check_counts(file: Gltf, primitive: JsonObject, count: int, name: str) -> None:
    """Report attributes that do not have one value for each of the `count` points of a primitive."""
    for attribute, accessor in primitive["attributes"].items():
        values = file.item("accessors", accessor).get("count")
        if values != count:
            text = f"mesh '{name}': {attribute} has {values} values for {count} points."
            file.ledger.wrong("gltf.count", text, name, suggestion="give each point one value of each attribute")


def _corners(file: Gltf, mesh: JsonObject, name: str) -> tuple[Array, Array]:
    """Check a mesh, and return the points (n, 3) and triangles (m, 3) of all its primitives."""
    points = [np.zeros((0, 3))]
    faces = [np.zeros((0, 3), int)]
    normals: list[Array] = []
    has_all_normals = True
    count = 0
    for primitive, vertices, triangles in _primitives(file, mesh):
        attributes = primitive["attributes"]
        spec = file.item("accessors", attributes["POSITION"])
        if not ("min" in spec and "max" in spec):
            text = f"mesh '{name}': the accessor of the positions lacks min and max."
            file.ledger.wrong("gltf.minmax", text, name)
        _check_counts(file, primitive, len(vertices), name)
        if not len(triangles) or vertices.shape[1] != 3:
            continue
        normal = np.zeros(0)
        if "NORMAL" in attributes:
            normal = file.accessor(attributes["NORMAL"])
        last = triangles.max()
        if normal.shape == vertices.shape and last < len(normal):
            normals.append(normal[triangles.ravel()])
        else:
            has_all_normals = False
        if last >= len(vertices):
            # The corners of the mesh cannot be used; `check_mesh` reports the index.
            check_mesh(file.ledger, name, vertices, triangles, None, "gltf")
            return points[0], faces[0]
        points.append(vertices)
        faces.append(triangles + count)
        count += len(vertices)
    vertices = np.vstack(points)
    triangles = np.vstack(faces)
    corner_normals = None
    if normals and not has_all_normals:
        text = f"mesh '{name}': only some of its primitives have a NORMAL for each point: the others look faceted."
        file.ledger.add("gltf.normal", "warning", text, name)
    if normals and has_all_normals:
        corner_normals = np.vstack(normals)
    check_mesh(file.ledger, name, vertices, triangles, corner_normals, "gltf")
    return vertices, triangles


# Modes of primitives; points and lines have no triangles.
_TRIANGLES = 4
_STRIP = 5
_FAN = 6


def _triangles(indices: Array, mode: Any) -> Array:
    """Return the triangles (m, 3) of a primitive with corners (n,)."""
    if mode == _TRIANGLES:
        whole = len(indices) // 3 * 3
        return indices[:whole].reshape(-1, 3)
    if mode == _STRIP and len(indices) > 2:
        strip = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
        # Every second triangle of a strip has the opposite order of corners.
        strip[1::2] = strip[1::2, [1, 0, 2]]
        return strip
    if mode == _FAN and len(indices) > 2:
        center = np.full(len(indices) - 2, indices[0])
        return np.stack([center, indices[1:-1], indices[2:]], axis=1)
    return np.zeros((0, 3), int)


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a .glb or .gltf file, and report its faults; see `read_gltf`."""
    ledger.tool = "twin.exchange.audit gltf"
    ledger.version = "2.0"
    admit(path)
    return read_gltf(path, ledger)
