"""Limits of glTF files, checked before reading: number and depth of nodes (with instances), and number of values."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from twin.core.errors import BudgetError
from twin.core.foreign.budget import BUDGETS, check_size, over
from twin.core.foreign.text import parse_json
from twin.core.json_types import JsonObject

_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def check_gltf(path: Path) -> None:
    """Raise an error if a .glb or .gltf file exceeds the limits of its format; a malformed file passes.

    Raises:
        BudgetError: a limit is exceeded; the message gives the limit and the value.
        OSError: the file cannot be read.
    """
    check_size(path, "GLTF")
    try:
        data = parse_json(path, _json_of(path))
    except (ValueError, RecursionError):
        return
    if not isinstance(data, dict):
        return
    limits = BUDGETS["GLTF"]
    for buffer in _objects(data, "buffers"):
        uri = buffer.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:") and "\0" not in uri:
            beside = path.parent / unquote(uri)
            if beside.exists() and not beside.is_file():
                raise BudgetError(f"{path}: buffer '{uri[:80]}' is not a regular file")
            if beside.is_file():
                check_size(beside, "GLTF")
    views = [_whole(v.get("byteLength")) for v in _objects(data, "bufferViews")]
    sizes = [_numbers(a, views) for a in _objects(data, "accessors")]
    if sum(sizes) > limits.numbers:
        over(path, "GLTF", "numbers in the accessors", sum(sizes), limits.numbers)
    weights = [sum(_used(p, sizes) for p in _objects(m, "primitives")) for m in _objects(data, "meshes")]
    nodes = _objects(data, "nodes")
    below = [[c for c in _list(n, "children") if isinstance(c, int) and 0 <= c < len(nodes)] for n in nodes]
    level = sorted(set(range(len(nodes))) - {c for children in below for c in children})
    depth = placed = numbers = 0
    while level:  # a node with several parents is counted several times
        depth, placed = depth + 1, placed + len(level)
        if depth > limits.depth:
            over(path, "GLTF", "depth of the nodes so far", depth, limits.depth)
        if placed > limits.count:
            over(path, "GLTF", "nodes so far", placed, limits.count)
        meshes = [nodes[i].get("mesh") for i in level]
        numbers += sum(weights[m] for m in meshes if isinstance(m, int) and 0 <= m < len(weights))
        if numbers > limits.numbers:
            over(path, "GLTF", "numbers in the meshes so far", numbers, limits.numbers)
        level = [c for i in level for c in below[i]]


def _json_of(path: Path) -> bytes:
    with path.open("rb") as file:
        head = file.read(20)
        if head[:4] != b"glTF":
            return head + file.read()
        return file.read(struct.unpack_from("<I", head, 12)[0]) if len(head) == 20 else b""


def _numbers(accessor: JsonObject, views: list[int]) -> int:
    """Return the count of numbers in an accessor, but at most one per byte of its buffer view (readers reject more)."""
    size = _whole(accessor.get("count")) * _WIDTH.get(str(accessor.get("type")), 1)
    view = accessor.get("bufferView")
    return min(size, views[view]) if isinstance(view, int) and 0 <= view < len(views) else size


def _used(primitive: JsonObject, sizes: list[int]) -> int:
    named = primitive.get("attributes")
    used = [*(named.values() if isinstance(named, dict) else ()), primitive.get("indices")]
    return sum(sizes[i] for i in used if isinstance(i, int) and 0 <= i < len(sizes))


def _objects(data: JsonObject, key: str) -> list[JsonObject]:
    return [v if isinstance(v, dict) else {} for v in _list(data, key)]


def _list(data: JsonObject, key: str) -> list[Any]:
    value = data.get(key)
    return value if isinstance(value, list) else []


def _whole(value: Any) -> int:
    return int(value) if isinstance(value, int | float) and 0 < value < 1e18 else 0
