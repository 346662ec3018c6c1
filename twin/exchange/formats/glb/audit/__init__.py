"""Read a glTF scene (nodes, clips, meshes and materials), and report faults. glTF uses metres, with y up."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from twin.core.foreign.admit import admit
from twin.exchange.audit import poses
from twin.exchange.audit.clip_checks import check_poses
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileFrame, FileMass, FileMechanism
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reader_context import Context
from twin.exchange.formats.glb.audit.asset import check_asset, check_node_extras, record_clip_extras
from twin.exchange.formats.glb.audit.clips import Clips
from twin.exchange.formats.glb.audit.container import open_gltf
from twin.exchange.formats.glb.audit.link_shapes import check_normals, read_link_shapes
from twin.exchange.formats.glb.audit.materials import check_materials
from twin.exchange.formats.glb.audit.node_checks import check_matrices, check_names, check_scales, check_scene
from twin.exchange.formats.glb.audit.nodes import Node, link_above, parents_first, read_nodes
from twin.exchange.formats.glb.audit.unread_entries import check_unread_entries

_UNDERSTOOD = {"KHR_mesh_quantization", "KHR_materials_unlit", "KHR_texture_transform"}
"""Extensions that change nothing that the audit reads, or that the audit supports."""


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
    unsupported: list[str] = []
    for extension in file.json.get("extensionsRequired", []):
        if extension not in _UNDERSTOOD:
            unsupported.append(str(extension))
    if unsupported:
        text = f"the file requires the extension {', '.join(unsupported)}, which the audit does not support."
        ledger.add("gltf.extension", "error", text, suggestion="export the file without this extension")
    check_asset(asset, content, ledger)
    record_clip_extras(file, content)
    if ROBOT in content.stated:
        check_node_extras(nodes, ledger)
    # Also accessors that nothing uses are read, because reading reports their faults.
    for number in range(len(file.items("accessors"))):
        file.accessor(number)
    links = tuple(node.name for node in nodes if node.is_link and node.name)
    content.declared = links or None
    if links:  # files without links, such as those of organs, have other features
        check_unread_entries(file.json, ledger)
    clips = Clips(file, nodes, order)
    check_names(file, nodes, clips.animated)
    check_scene(file, nodes, order, ledger)
    check_matrices(nodes, clips.animated, ledger)
    rest_poses = clips.world({})
    check_scales(nodes, rest_poses, clips.animated, ledger)
    posed_nodes = [node for node in nodes if node.name and (node.is_link or not links)]
    for node in posed_nodes:
        content.rest[node.name] = clips.z_up(rest_poses[node.index])[0]
    for clip in clips.read(posed_nodes):
        check_poses(ledger, clip, "gltf")
        content.clips.append(clip)
    _check_clip_names(content)
    check_materials(file)
    check_normals(file)
    content.shapes, content.colors, content.finishes = read_link_shapes(file, nodes, rest_poses)
    if links:
        content.mechanism = _mechanism(nodes, rest_poses, ledger)
    _add_count_rows(ledger)
    return content


_CODES_OF_CHECKS = {
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


def _add_count_rows(ledger: Ledger) -> None:
    """Add a row for each check of one file, with the number of its findings."""
    counts = Counter(finding.code for finding in ledger.found)
    for check, codes in _CODES_OF_CHECKS.items():
        count = sum(counts[code] for code in codes)
        ledger.row(check, float(count), "found", 0.0)


def _check_clip_names(content: Content) -> None:
    """Report the first name that two clips share."""
    counts = Counter(clip.name for clip in content.clips)
    for name, count in counts.items():
        if count > 1:
            content.ledger.wrong("gltf.duplicate_clip", f"two clips are named '{name}'.", name)
            return  # one finding is enough


def _mechanism(nodes: list[Node], world_poses: list[Array], ledger: Ledger) -> FileMechanism:
    """Return the mechanism data of the nodes and their `extras`: masses, names of joints, poses of frames, meshes."""
    mechanism = FileMechanism(tuple(node.name for node in nodes if node.is_link))
    has_mesh = dict.fromkeys(mechanism.links, False)
    for node in nodes:
        extras = node.extras
        owner = link_above(nodes, node)
        if owner is not None and "mesh" in node.spec:
            has_mesh[owner.name] = True
        if node.is_link:
            if extras.get("whole") is False:
                mechanism.partly_shown |= {node.name}
            if isinstance(extras.get("mass"), int | float):
                mechanism.masses[node.name] = FileMass(float(extras["mass"]))
            joints = extras.get("joints")
            if isinstance(joints, list):
                repeated: set[str] = set()
                for name in joints:
                    mechanism.joints.append(FileJoint((str(name),), "", node.name))
                    if joints.count(name) > 1:
                        repeated.add(str(name))
                if repeated:
                    text = f"link '{node.name}' lists joint '{min(repeated)}' more than once."
                    ledger.wrong("gltf.duplicate_joint", text, node.name)
        elif isinstance(extras.get("frame"), str) and owner is not None:
            T_world_link, _ = poses.split(world_poses[owner.index][0])
            T_world_frame, _ = poses.split(world_poses[node.index][0])
            mechanism.frames[extras["frame"]] = FileFrame(owner.name, poses.inverse(T_world_link) @ T_world_frame)
    mechanism.shown = has_mesh
    return mechanism


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a .glb or .gltf file, and report its faults; see `read_gltf`."""
    ledger.tool = "twin.exchange.audit gltf"
    ledger.version = "2.0"
    admit(path)
    return read_gltf(path, ledger)
