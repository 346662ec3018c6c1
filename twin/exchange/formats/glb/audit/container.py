"""Open .glb and .gltf files: find the buffers, and read accessors, with bounds checks."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeGuard
from urllib.parse import unquote

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Ledger, Measured, ReadError
from twin.exchange.audit.poses import Array

_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Types of NumPy, by the numbers of glTF for the types of components."""

_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
"""Numbers in an element of an accessor."""

# The first four bytes of a GLB, "glTF", and the kinds of its chunks, "JSON" and "BIN", as little-endian numbers.
_MAGIC = 0x46546C67
_JSON = 0x4E4F534A
_BIN = 0x004E4942

_HEADER_SIZE = 12
_CHUNK_HEADER_SIZE = 8
_SMALLEST = _HEADER_SIZE + _CHUNK_HEADER_SIZE
"""Sizes in bytes: of the header of a GLB, of that of a chunk, and of a GLB with an empty chunk."""

_BOUND_ROUNDING = 1e-6
"""Relative difference of a stated minimum or maximum that is only rounding: the data are in single precision."""

MOST_NUMBERS = 50_000_000
"""Maximum number of numbers in one accessor."""


@dataclass(frozen=True)
class _Layout:
    """Elements in a buffer view: `count` elements of `width` numbers of one type, named `name` in reports."""

    name: str
    count: int
    width: int
    dtype: np.dtype


@dataclass
class Gltf:
    """An opened glTF file: its JSON, its buffers, and the ledger that receives its faults.

    The numbers of accessors are kept, so that the faults of each are reported once.
    """

    path: Path
    ledger: Ledger
    json: JsonObject
    buffers: list[bytes]
    _numbers: dict[int, Array] = field(default_factory=dict)

    def items(self, name: str) -> list[JsonObject]:
        """Return the objects in a top-level array of the JSON; [] if the array is missing.

        Raises:
            ReadError: the entry is not an array of objects.
        """
        value = self.json.get(name, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise ReadError(f"'{name}' is not an array of objects", "gltf.json")
        return value

    def item(self, name: str, index: object) -> JsonObject:
        """Return the object at position `index` of the top-level array `name`.

        Raises:
            ReadError: the array has no object at this position.
        """
        values = self.items(name)
        if not is_index(index, len(values)):
            raise ReadError(f"{name}[{index}] does not exist; '{name}' has {len(values)} entries", "gltf.reference")
        return values[index]

    def accessor(self, index: object) -> Array:
        """Return the numbers of an accessor as float64 (count, width); normalised integers are converted to fractions.

        Raises:
            ReadError: the accessor exceeds its buffer, or has an unknown type.
        """
        spec = self.item("accessors", index)
        assert isinstance(index, int)  # `item` has refused others
        if index not in self._numbers:
            self._numbers[index] = self._read_accessor(index, spec)
        return self._numbers[index]

    def _read_accessor(self, index: int, spec: JsonObject) -> Array:
        name = f"accessor {index}"
        kind = _DTYPES.get(spec.get("componentType", 0))
        width = _WIDTHS.get(spec.get("type", ""))
        if kind is None or width is None:
            text = f"{name}: componentType {spec.get('componentType')} and type {spec.get('type')} are not supported"
            raise ReadError(text, "gltf.accessor")
        count = whole_number(spec, "count", name, 0)
        if count * width > MOST_NUMBERS:
            text = f"{name} has {count} elements of {width} numbers; the maximum is {MOST_NUMBERS} numbers"
            raise ReadError(text, "gltf.bounds")
        dtype = np.dtype(kind)
        layout = _Layout(name, count, width, dtype)
        if "bufferView" in spec:
            stored = self._view(spec, layout)
        else:
            stored = np.zeros((count, width), dtype)  # as glTF defines it; only `sparse` gives other values
        if "sparse" in spec:
            stored = self._sparse(spec["sparse"], stored.copy(), layout)
        values = stored.astype(float)
        if spec.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        self._check_bounds(name, spec, values)
        return values

    def _view(self, spec: JsonObject, layout: _Layout) -> Array:
        """Return the elements (count, width) that start at `byteOffset` of the buffer view of `spec`."""
        name = layout.name
        index = spec["bufferView"]
        offset = whole_number(spec, "byteOffset", name, 0)
        view = self.item("bufferViews", index)
        label = f"bufferView {index}"
        if "extensions" in view:
            extensions = ", ".join(view["extensions"])
            text = f"{label} is compressed by {extensions}, which the audit does not support"
            raise ReadError(text, "gltf.extension")
        start = whole_number(view, "byteOffset", label, 0)
        length = whole_number(view, "byteLength", label)
        buffer = whole_number(view, "buffer", label)
        self.item("buffers", buffer)
        data = self.buffers[buffer]
        if start + length > len(data):
            raise ReadError(f"{label} ends at byte {start + length} of a buffer of {len(data)} bytes", "gltf.bounds")
        number_size = layout.dtype.itemsize
        size = number_size * layout.width
        stride = whole_number(view, "byteStride", label, 0) or size  # without a stride, elements follow each other
        if stride < size:
            text = f"{label} has byteStride {stride}, but an element of {name} has {size} bytes"
            raise ReadError(text, "gltf.bounds")
        end = offset
        if layout.count:
            end += stride * (layout.count - 1) + size
        if end > length:
            raise ReadError(f"{name} ends at byte {end} of {label}, which has {length} bytes", "gltf.bounds")
        if offset % number_size or start % number_size:
            self.ledger.wrong("gltf.alignment", f"{name} is not aligned to the size of its components.", name)
        shape = (layout.count, layout.width)
        return np.ndarray(shape, layout.dtype, data, start + offset, (stride, number_size))

    def _sparse(self, sparse: JsonObject, stored: Array, layout: _Layout) -> Array:
        """Return the elements of an accessor with those that its entry `sparse` replaces."""
        name = layout.name
        count = whole_number(sparse, "count", name)
        if count > layout.count:
            text = f"{name}: {count} sparse elements, but the accessor has {layout.count}"
            raise ReadError(text, "gltf.bounds")
        indices = sparse["indices"]
        replacements = sparse["values"]
        kind = np.dtype(_DTYPES[indices["componentType"]])
        column = self._view(indices, _Layout(name, count, 1, kind))
        rows = column[:, 0].astype(int)
        values = self._view(replacements, replace(layout, count=count))
        last = int(rows.max(initial=-1))
        if last >= layout.count:
            text = f"{name}: sparse index {last}, but the accessor has {layout.count} elements"
            raise ReadError(text, "gltf.bounds")
        stored[rows] = values
        return stored

    def _check_bounds(self, name: str, spec: JsonObject, values: Array) -> None:
        """Compare an accessor's numbers with its min and max, which viewers use for framing, culling and timing."""
        if not np.all(np.isfinite(values)):
            self.ledger.wrong("gltf.finite", f"{name} contains numbers that are not finite.", name)
            return
        if not len(values) or spec.get("normalized"):
            return
        for key, actual in (("min", values.min(axis=0)), ("max", values.max(axis=0))):
            if key not in spec:
                continue
            stated = np.asarray(spec[key], float).ravel()
            if stated.shape != actual.shape:
                text = f"{name}: {key} has {len(stated)} numbers, not {len(actual)}."
                self.ledger.wrong("gltf.minmax", text, name)
                continue
            differences = np.abs(stated - actual)
            column = int(np.argmax(differences))
            if differences[column] > _BOUND_ROUNDING * max(1.0, abs(actual[column])):
                text = (
                    f"{name}: the stated {key} is {stated[column]:.7g}, but the actual {key} is {actual[column]:.7g}."
                )
                size = Measured(stated[column], actual[column])
                advice = "state the minimum and maximum of the stored numbers"
                self.ledger.wrong("gltf.minmax", text, name, size=size, suggestion=advice)


def is_index(value: object, count: int) -> TypeGuard[int]:
    """Return whether a value in JSON is an index of an array with `count` entries."""
    # In Python, True is an int.
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < count


def whole_number(spec: object, key: str, name: str, default: int | None = None) -> int:
    """Return the entry `key` of a JSON object as a whole number >= 0; the default if the entry is missing.

    Raises:
        ReadError: a required entry is missing, or the entry is not a whole number >= 0.
    """
    value = spec.get(key, default) if isinstance(spec, dict) else None
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ReadError(f"{name}: '{key}' is {value!r}, not a whole number >= 0", "gltf.json")
    return value


def open_gltf(path: Path, ledger: Ledger) -> Gltf:
    """Open a .glb or .gltf file.

    Raises:
        ReadError: the file is not glTF, or is inconsistent.
    """
    json_bytes = path.read_bytes()
    binary = None
    if json_bytes.startswith(b"glTF"):  # a GLB, whatever its suffix
        json_bytes, binary = _chunks(json_bytes, ledger)
    try:
        parsed = json.loads(json_bytes.decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ReadError(f"the file's JSON cannot be read: {str(error)[:120]}", "gltf.json") from error
    if not isinstance(parsed, dict) or not isinstance(parsed.get("asset"), dict):
        raise ReadError("the file is not glTF: its JSON has no object 'asset'", "gltf.json")
    version = parsed["asset"].get("version")
    if not str(version).startswith("2."):
        raise ReadError(f"the file is glTF {version!r}, expected 2.0", "gltf.version")
    file = Gltf(path, ledger, parsed, [])
    for number, spec in enumerate(file.items("buffers")):
        file.buffers.append(_buffer(path, number, spec, binary))
    return file


def _chunks(data: bytes, ledger: Ledger) -> tuple[bytes, bytes | None]:
    """Return (JSON, binary chunk or None) of a GLB."""
    if len(data) < _SMALLEST:
        raise ReadError(f"the file has {len(data)} bytes; a GLB has at least {_SMALLEST}", "gltf.header")
    magic, version, length = struct.unpack_from("<III", data)
    if magic != _MAGIC or version != 2:
        raise ReadError(f"the header states version {version}, expected 2", "gltf.version")
    text = f"the header states {length} bytes, but the file has {len(data)}"
    if length > len(data):
        raise ReadError(f"{text}: it is truncated", "gltf.header")
    if length != len(data):
        ledger.wrong("gltf.header", f"{text}.", size=Measured(float(len(data)), length))
    chunks: dict[int, bytes] = {}
    position = _HEADER_SIZE
    while position + _CHUNK_HEADER_SIZE <= length:
        size, kind = struct.unpack_from("<II", data, position)
        start = position + _CHUNK_HEADER_SIZE
        end = start + size
        if end > length:
            text = f"a chunk of {size} bytes at byte {position} extends beyond the end of the file"
            raise ReadError(text, "gltf.header")
        if size % 4:
            ledger.wrong("gltf.alignment", f"the chunk at byte {position} is not padded to 4 bytes.")
        chunks.setdefault(kind, data[start:end])  # readers take the first chunk of a kind
        position = end
    if _JSON not in chunks:
        raise ReadError("the file has no JSON chunk", "gltf.header")
    return chunks[_JSON], chunks.get(_BIN)


def _buffer(path: Path, index: int, spec: JsonObject, binary: bytes | None) -> bytes:
    name = f"buffer {index}"
    length = whole_number(spec, "byteLength", name)
    uri = spec.get("uri")
    if uri is None:
        # Only the first buffer can be the binary chunk of a GLB.
        if index or binary is None:
            raise ReadError(f"{name} has neither a uri nor a binary chunk", "gltf.buffer")
        data = binary
    elif not isinstance(uri, str):
        raise ReadError(f"{name}: the uri is not text", "gltf.json")
    elif uri.startswith("data:"):
        _, _, encoded = uri.partition(",")
        try:
            data = base64.b64decode(encoded, validate=True)
        except (binascii.Error, ValueError) as error:
            raise ReadError(f"{name}: the data uri is not base64", "gltf.buffer") from error
    else:
        data = _beside(path, name, unquote(uri))
    if length > len(data):
        raise ReadError(f"{name} states {length} bytes, but {len(data)} exist", "gltf.bounds")
    return data[:length]


def _beside(path: Path, name: str, uri: str) -> bytes:
    """Return the content of a file of a buffer, which must be in the folder of the glTF file."""
    folder = path.resolve().parent
    subject = f"{name}: '{uri[:80]}'"
    if "\0" in uri or "://" in uri:
        raise ReadError(f"{subject} is not read, because it is not a file in the same folder", "gltf.buffer")
    file = (folder / uri).resolve()
    if not file.is_relative_to(folder):
        raise ReadError(f"{subject} is not read, because it is outside the file's folder", "gltf.buffer")
    try:
        return file.read_bytes()
    except OSError as error:
        raise ReadError(f"{subject} cannot be read: {error.strerror}", "gltf.buffer") from error
