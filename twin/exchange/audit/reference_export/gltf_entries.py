"""Read glTF as entries, with the numbers of accessors where an index refers to them.

Programs that save again number accessors, meshes and materials anew, and leave out or write out what glTF defines as
default: neither changes the entries.
"""

from __future__ import annotations

import copy
import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.reference_export.entries import Entry, numbered
from twin.exchange.audit.reference_export.json_entries import entry_of
from twin.exchange.formats.glb.audit.container import Gltf, open_gltf

_TRIANGLES = 4
"""Default of the entry `mode` of a primitive."""

_PLACE = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
_SURFACE = {"alphaMode": "OPAQUE", "doubleSided": False, "emissiveFactor": [0, 0, 0]}
_METAL = {"baseColorFactor": [1, 1, 1, 1], "metallicFactor": 1, "roughnessFactor": 1}
"""What glTF 2.0 defines for entries that are not there: of nodes, of materials, of their pbrMetallicRoughness."""

_READ_BY_NUMBER = {"accessors", "bufferViews", "buffers", "meshes", "nodes", "animations", "materials"}
_READ_BY_NUMBER |= {"textures", "images", "samplers", "scenes", "scene"}
"""Top-level entries that others refer to by number, and that are read there."""


def read_gltf_entries(path: Path) -> Entry:
    """Return the content of a .glb or .gltf file.

    Raises:
        ReadError: the file is not glTF.
        KeyError, IndexError: an entry refers to one that does not exist.
    """
    file = open_gltf(path, Ledger(""))
    others = {}
    for key, value in file.json.items():
        if key not in _READ_BY_NUMBER:
            others[key] = copy.deepcopy(value)
    others["asset"].pop("generator", None)
    for key in ("extensionsUsed", "extensionsRequired"):
        others[key] = sorted(others.get(key, []))
    root = entry_of("file", "", others)
    parents = _parents(file)
    for scene in file.items("scenes"):
        names = sorted(_node_name(file, index) for index in scene.get("nodes", []))
        root.entries.append(Entry("scene", str(scene.get("name", "")), {"roots": tuple(names)}))
    for index, node in enumerate(file.items("nodes")):
        root.entries.append(_node_entry(file, node, _node_name(file, index), parents.get(index, "")))
    for animation in file.items("animations"):
        root.entries.append(_animation_entry(file, animation))
    root.entries = numbered(root.entries)
    return root


def _node_name(file: Gltf, index: int) -> str:
    return str(file.item("nodes", index).get("name", f"node {index}"))


def _parents(file: Gltf) -> dict[int, str]:
    """Return {number of a node: name of its parent}."""
    parents = {}
    for index, node in enumerate(file.items("nodes")):
        for child in node.get("children", []):
            parents[child] = _node_name(file, index)
    return parents


def _node_entry(file: Gltf, node: JsonObject, name: str, parent: str) -> Entry:
    content = _PLACE | {key: value for key, value in node.items() if key not in ("name", "children", "mesh")}
    entry = entry_of("node", name, content)
    entry.values["parent"] = parent
    if "mesh" in node:
        mesh = file.item("meshes", node["mesh"])
        for primitive in mesh["primitives"]:
            entry.entries.append(_primitive_entry(file, primitive))
    entry.entries = numbered(entry.entries)
    return entry


def _primitive_entry(file: Gltf, primitive: JsonObject) -> Entry:
    """Return the corners of the triangles with all their attributes, and the material."""
    entry = Entry("primitive", values={"mode": np.array(float(primitive.get("mode", _TRIANGLES)))})
    order: Any = slice(None)
    if "indices" in primitive:
        order = file.accessor(primitive["indices"]).ravel().astype(int)
    for attribute, index in primitive["attributes"].items():
        entry.values[attribute] = file.accessor(index)[order]
    if "material" in primitive:
        entry.entries.append(_material_entry(file, file.item("materials", primitive["material"])))
    return entry


def _material_entry(file: Gltf, material: JsonObject) -> Entry:
    content = _SURFACE | copy.deepcopy(material)
    content.pop("name", None)  # programs join materials that look the same
    content["pbrMetallicRoughness"] = _METAL | content.get("pbrMetallicRoughness", {})
    if content["alphaMode"] != "MASK":
        content.pop("alphaCutoff", None)
    entry = entry_of("material", "", content)
    for texture in file.items("textures"):
        image = file.item("images", texture["source"]) if "source" in texture else {}
        entry.values[f"image {image.get('name', '')}"] = _hash(file, image)
    return entry


def _hash(file: Gltf, image: JsonObject) -> str:
    """Return the hash of an image in a buffer; the address of another."""
    if "bufferView" not in image:
        return str(image.get("uri", ""))[:80]
    view = file.item("bufferViews", image["bufferView"])
    start = view.get("byteOffset", 0)
    data = file.buffers[view["buffer"]][start : start + view["byteLength"]]
    return hashlib.sha256(data).hexdigest()


def _animation_entry(file: Gltf, animation: JsonObject) -> Entry:
    rest = {key: value for key, value in animation.items() if key not in ("channels", "samplers", "name")}
    entry = entry_of("animation", str(animation.get("name", "")), rest)
    for channel in animation["channels"]:
        target = channel["target"]
        sampler = animation["samplers"][channel["sampler"]]
        name = f"{_node_name(file, target['node'])} {target['path']}"
        channel_entry = Entry("channel", name)
        channel_entry.values["interpolation"] = sampler.get("interpolation", "LINEAR")
        channel_entry.values["times"] = file.accessor(sampler["input"]).ravel()
        channel_entry.values["samples"] = file.accessor(sampler["output"])
        entry.entries.append(channel_entry)
    entry.entries = numbered(entry.entries)
    return entry
