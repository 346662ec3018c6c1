"""Find what a glTF file has beside what the audit reads: it can change what viewers show, and nothing compares it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Ledger

_READ_ENTRIES: Mapping[str, tuple[str, ...]] = {
    "": (
        "asset",
        "scene",
        "scenes",
        "nodes",
        "meshes",
        "materials",
        "accessors",
        "bufferViews",
        "buffers",
        "animations",
    ),
    "asset": ("version", "generator", "extras"),
    "scenes": ("name", "nodes"),
    "nodes": ("name", "translation", "rotation", "scale", "matrix", "children", "mesh", "extras"),
    "meshes": ("name", "primitives"),
    "meshes.primitives": ("attributes", "indices", "material", "mode"),
    "meshes.primitives.attributes": ("POSITION", "NORMAL"),
    "materials": ("name", "pbrMetallicRoughness", "doubleSided", "alphaMode", "alphaCutoff"),
    "materials.pbrMetallicRoughness": ("baseColorFactor", "metallicFactor", "roughnessFactor"),
    "accessors": ("bufferView", "byteOffset", "componentType", "count", "type", "min", "max", "normalized", "sparse"),
    "bufferViews": ("buffer", "byteOffset", "byteLength", "byteStride", "target"),
    "buffers": ("byteLength", "uri"),
    "animations": ("name", "channels", "samplers", "extras"),
    "animations.channels": ("sampler", "target"),
    "animations.channels.target": ("node", "path"),
    "animations.samplers": ("input", "output", "interpolation"),
}
"""Entries that the audit reads, of each kind of object."""


def check_unread_entries(document: JsonObject, ledger: Ledger) -> None:
    """Report entries that the audit does not read. In a file as twin writes it they are faults, in others a note."""
    unread_entries: dict[str, str] = {}
    for kind, key, where in _unread("", document, ""):
        unread_entries.setdefault(f"{kind}.{key}".lstrip("."), where)
    if not unread_entries:
        return
    names = ", ".join(unread_entries)
    asset = document.get("asset", {})
    if str(asset.get("generator", "")).startswith("twin "):
        text = f"the file has {names}, which twin does not write: it can change what viewers show, and is not compared."
        ledger.wrong("gltf.feature", text, next(iter(unread_entries.values())), suggestion="export the file again")
    else:
        ledger.add("gltf.feature", "info", f"not read and not compared: {names}.")


def _unread(kind: str, value: object, where: str) -> Iterator[tuple[str, str, str]]:
    """Yield (kind of the object, entry, name of the object) of all entries that the audit does not read."""
    if isinstance(value, list):
        for entry in value:
            yield from _unread(kind, entry, where)
    elif isinstance(value, dict):
        read_keys = _READ_ENTRIES[kind]
        where = str(value.get("name") or where)
        for key, entry in value.items():
            inner = f"{kind}.{key}".lstrip(".")
            if key not in read_keys:
                yield kind, key, where
            elif inner in _READ_ENTRIES:
                yield from _unread(inner, entry, where)
