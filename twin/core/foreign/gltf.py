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
"""{type of an accessor: count of numbers in an element}."""

_HEAD = 20
_LENGTH_AT = 12
"""Size in bytes of the headers of a .glb file and of its first chunk, and place of the length of this chunk."""

_MOST = 1e18
"""Count from which a number is no count: larger ones would not fit into 64 bits."""


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
    # an accessor may state any count: a file of a kilobyte can ask for terabytes
    _check_buffers(path, data)
    view_bytes = []
    for view in _objects(data, "bufferViews"):
        view_bytes.append(_count(view.get("byteLength")))
    numbers_of_accessor = []
    for accessor in _objects(data, "accessors"):
        numbers_of_accessor.append(_numbers_of_accessor(accessor, view_bytes))
    limit = BUDGETS["GLTF"].numbers
    if sum(numbers_of_accessor) > limit:
        over(path, "GLTF", "numbers in the accessors", sum(numbers_of_accessor), limit)
    numbers_of_mesh: list[int] = []
    for mesh in _objects(data, "meshes"):
        weight = 0
        for primitive in _objects(mesh, "primitives"):
            weight += _numbers_of_primitive(primitive, numbers_of_accessor)
        numbers_of_mesh.append(weight)
    _check_nodes(path, _objects(data, "nodes"), numbers_of_mesh)


def _check_buffers(path: Path, data: JsonObject) -> None:
    """Raise an error if a file of buffers beside the glTF file is too large or no regular file."""
    for buffer in _objects(data, "buffers"):
        uri = buffer.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:") and "\0" not in uri:
            beside = path.parent / unquote(uri)
            if beside.exists() and not beside.is_file():
                raise BudgetError(f"{path}: buffer '{uri[:80]}' is not a regular file")
            if beside.is_file():
                check_size(beside, "GLTF")


def _check_nodes(path: Path, nodes: list[JsonObject], numbers_of_mesh: list[int]) -> None:
    """Raise an error if the nodes are too many or too deep, or show too many numbers of meshes.

    `numbers_of_mesh` has the count of numbers of each mesh.
    """
    limits = BUDGETS["GLTF"]
    children: list[list[int]] = []
    roots = set(range(len(nodes)))
    for node in nodes:
        valid = _valid(_list(node, "children"), len(nodes))
        children.append(valid)
        roots.difference_update(valid)
    level = sorted(roots)
    depth = 0
    placed = 0
    numbers = 0
    while level:  # a node with several parents is counted several times
        depth += 1
        if depth > limits.depth:
            over(path, "GLTF", "depth of the nodes so far", depth, limits.depth)
        placed += len(level)
        if placed > limits.count:
            over(path, "GLTF", "nodes so far", placed, limits.count)
        below: list[int] = []
        for i in level:
            for mesh in _valid([nodes[i].get("mesh")], len(numbers_of_mesh)):
                numbers += numbers_of_mesh[mesh]
            below += children[i]
        if numbers > limits.numbers:
            over(path, "GLTF", "numbers in the meshes so far", numbers, limits.numbers)
        level = below


def _valid(indices: list[Any], count: int) -> list[int]:
    """Return those of the values that are indices of a list with `count` items."""
    return [index for index in indices if isinstance(index, int) and 0 <= index < count]


def _json_of(path: Path) -> bytes:
    """Return the JSON of a file: the whole .gltf, or the first chunk of a .glb."""
    with path.open("rb") as file:
        head = file.read(_HEAD)
        if head[:4] != b"glTF":
            return head + file.read()
        if len(head) < _HEAD:
            return b""
        (length,) = struct.unpack_from("<I", head, _LENGTH_AT)
        return file.read(length)


def _numbers_of_accessor(accessor: JsonObject, view_bytes: list[int]) -> int:
    """Return the count of numbers in an accessor, but at most one per byte of its buffer view (readers reject more)."""
    size = _count(accessor.get("count")) * _WIDTH.get(str(accessor.get("type")), 1)
    for view in _valid([accessor.get("bufferView")], len(view_bytes)):
        size = min(size, view_bytes[view])
    return size


def _numbers_of_primitive(primitive: JsonObject, numbers_of_accessor: list[int]) -> int:
    """Return the count of numbers in the accessors of a primitive."""
    accessors = [primitive.get("indices")]
    attributes = primitive.get("attributes")
    if isinstance(attributes, dict):
        accessors += attributes.values()
    used_sizes = [numbers_of_accessor[accessor] for accessor in _valid(accessors, len(numbers_of_accessor))]
    return sum(used_sizes)


def _objects(data: JsonObject, key: str) -> list[JsonObject]:
    """Return the objects in a list of JSON, {} for other values; [] if there is no list."""
    objects: list[JsonObject] = []
    for value in _list(data, key):
        objects.append(value if isinstance(value, dict) else {})
    return objects


def _list(data: JsonObject, key: str) -> list[Any]:
    """Return a list of JSON; [] if there is none."""
    value = data.get(key)
    if isinstance(value, list):
        return value
    return []


def _count(value: Any) -> int:
    """Return a count in JSON as an integer; 0 for anything else."""
    if isinstance(value, int | float) and 0 < value < _MOST:
        return int(value)
    return 0
