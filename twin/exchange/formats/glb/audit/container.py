"""Open .glb and .gltf files: find the buffers, and read accessors, with bounds checks."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, ReadError

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942

MOST_NUMBERS = 50_000_000
"""Maximum number of numbers in one accessor."""


@dataclass
class Gltf:
    """An opened glTF file: its JSON, its buffers, and the ledger that receives its faults."""

    path: Path
    ledger: Ledger
    json: JsonObject
    buffers: list[bytes]
    _read: dict[int, Array] = field(default_factory=dict)

    def items(self, name: str) -> list[JsonObject]:
        """Return the objects in a top-level array of the JSON; [] if the array is missing.

        Raises:
            ReadError: the entry is not an array of objects.
        """
        value = self.json.get(name, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise ReadError(f"'{name}' is not an array of objects", "gltf.json")
        return value

    def item(self, name: str, index: Any) -> JsonObject:
        """Return the object at position `index` of the top-level array `name`.

        Raises:
            ReadError: the array has no object at this position.
        """
        values = self.items(name)
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(values):
            raise ReadError(f"{name}[{index}] does not exist; '{name}' has {len(values)} entries", "gltf.reference")
        return values[index]

    def accessor(self, index: Any) -> Array:
        """Return the numbers of an accessor as float64 (count, width); normalised integers are converted to fractions.

        Raises:
            ReadError: the accessor exceeds its buffer, or has an unknown type.
        """
        spec = self.item("accessors", index)
        if index not in self._read:
            self._read[index] = self._accessor(index, spec)
        return self._read[index]

    def _accessor(self, index: int, spec: JsonObject) -> Array:
        name = f"accessor {index}"
        kind, width = _TYPES.get(spec.get("componentType", 0)), _WIDTH.get(spec.get("type", ""))
        if kind is None or width is None:
            text = f"{name}: componentType {spec.get('componentType')} and type {spec.get('type')} are not supported"
            raise ReadError(text, "gltf.accessor")
        count = natural(spec, "count", name, 0)
        if count * width > MOST_NUMBERS:
            raise ReadError(
                f"{name} has {count} elements of {width} numbers; the maximum is {MOST_NUMBERS} numbers", "gltf.bounds"
            )
        dtype = np.dtype(kind)
        if "bufferView" in spec:
            out = self._view(spec["bufferView"], natural(spec, "byteOffset", name, 0), count, width, dtype, name)
        else:
            out = np.zeros((count, width), dtype)
        if "sparse" in spec:
            out = self._sparse(spec["sparse"], out.copy(), count, width, dtype, name)
        values = out.astype(float)
        if spec.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        self._check_bounds(index, spec, values)
        return values

    def _view(self, index: Any, offset: int, count: int, width: int, dtype: np.dtype, name: str) -> Array:
        view = self.item("bufferViews", index)
        label = f"bufferView {index}"
        if "extensions" in view:
            raise ReadError(
                f"{label} is compressed by {', '.join(view['extensions'])}, which the audit does not support",
                "gltf.extension",
            )
        start, length = natural(view, "byteOffset", label, 0), natural(view, "byteLength", label)
        which = natural(view, "buffer", label)
        self.item("buffers", which)
        data = self.buffers[which]
        if start + length > len(data):
            raise ReadError(f"{label} ends at byte {start + length} of a buffer of {len(data)} bytes", "gltf.bounds")
        size = dtype.itemsize * width
        stride = natural(view, "byteStride", label, 0) or size
        if stride < size:
            raise ReadError(
                f"{label} has byteStride {stride}, but an element of {name} has {size} bytes", "gltf.bounds"
            )
        end = offset + stride * (count - 1) + size if count else offset
        if end > length:
            raise ReadError(f"{name} ends at byte {end} of {label}, which has {length} bytes", "gltf.bounds")
        if offset % dtype.itemsize or start % dtype.itemsize:
            self.ledger.wrong("gltf.alignment", f"{name} is not aligned to the size of its components.", name)
        return np.ndarray((count, width), dtype, data, start + offset, (stride, dtype.itemsize))

    def _sparse(self, sparse: Any, out: Array, count: int, width: int, dtype: np.dtype, name: str) -> Array:
        n = natural(sparse, "count", name)
        if n > count:
            raise ReadError(f"{name}: {n} sparse elements, but the accessor has {count}", "gltf.bounds")
        where, what = sparse["indices"], sparse["values"]
        kind = np.dtype(_TYPES[where["componentType"]])
        rows = self._view(where["bufferView"], natural(where, "byteOffset", name, 0), n, 1, kind, name)[:, 0]
        values = self._view(what["bufferView"], natural(what, "byteOffset", name, 0), n, width, dtype, name)
        if n and int(rows.max()) >= count:
            raise ReadError(
                f"{name}: sparse index {int(rows.max())}, but the accessor has {count} elements", "gltf.bounds"
            )
        out[rows.astype(int)] = values
        return out

    def _check_bounds(self, index: int, spec: JsonObject, values: Array) -> None:
        """Compare an accessor's numbers with its min and max, which viewers use for framing, culling and timing."""
        name = f"accessor {index}"
        if not np.all(np.isfinite(values)):
            self.ledger.wrong("gltf.finite", f"{name} contains numbers that are not finite.", name)
            return
        if not len(values) or spec.get("normalized"):
            return
        for key, real in (("min", values.min(axis=0)), ("max", values.max(axis=0))):
            if key not in spec:
                continue
            told = np.asarray(spec[key], float).ravel()
            if told.shape != real.shape:
                text = f"{name}: {key} has {len(told)} numbers, not {len(real)}."
                self.ledger.wrong("gltf.minmax", text, name)
                continue
            # min and max are decimal numbers in JSON; the data are in single precision.
            off = np.abs(told - real)
            k = int(np.argmax(off))
            if off[k] > 1e-6 * max(1.0, abs(real[k])):
                text = f"{name}: the stated {key} is {told[k]:.7g}, but the actual {key} is {real[k]:.7g}."
                self.ledger.wrong(
                    "gltf.minmax",
                    text,
                    name,
                    size=Measured(told[k], real[k]),
                    suggestion="state the minimum and maximum of the stored numbers",
                )


def natural(spec: Any, key: str, name: str, default: int | None = None) -> int:
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
    data = path.read_bytes()
    if data[:4] == b"glTF":
        text, binary = _chunks(data, ledger)
    else:
        text, binary = data, None
    try:
        parsed = json.loads(text.decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ReadError(f"the file's JSON cannot be read: {str(error)[:120]}", "gltf.json") from error
    if not isinstance(parsed, dict) or not isinstance(parsed.get("asset"), dict):
        raise ReadError("the file is not glTF: its JSON has no object 'asset'", "gltf.json")
    if not str(parsed["asset"].get("version", "")).startswith("2."):
        raise ReadError(f"the file is glTF {parsed['asset'].get('version')!r}, expected 2.0", "gltf.version")
    out = Gltf(path, ledger, parsed, [])
    for i, spec in enumerate(out.items("buffers")):
        out.buffers.append(_buffer(path, i, spec, binary))
    return out


def _chunks(data: bytes, ledger: Ledger) -> tuple[bytes, bytes | None]:
    if len(data) < 20:
        raise ReadError(f"the file has {len(data)} bytes; a GLB has at least 20", "gltf.header")
    magic, version, length = struct.unpack_from("<III", data)
    if magic != _MAGIC or version != 2:
        raise ReadError(f"the header states version {version}, expected 2", "gltf.version")
    if length > len(data):
        raise ReadError(
            f"the header states {length} bytes, but the file has {len(data)}: it is truncated", "gltf.header"
        )
    if length != len(data):
        text = f"the header states {length} bytes, but the file has {len(data)}."
        ledger.wrong("gltf.header", text, size=Measured(float(len(data)), length))
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise ReadError(f"a chunk of {size} bytes at byte {at} extends beyond the end of the file", "gltf.header")
        if size % 4:
            ledger.wrong("gltf.alignment", f"the chunk at byte {at} is not padded to 4 bytes.")
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if _JSON not in found:
        raise ReadError("the file has no JSON chunk", "gltf.header")
    return found[_JSON], found.get(_BIN)


def _buffer(path: Path, index: int, spec: JsonObject, binary: bytes | None) -> bytes:
    name = f"buffer {index}"
    length = natural(spec, "byteLength", name)
    uri = spec.get("uri")
    if uri is None:
        if index or binary is None:
            raise ReadError(f"{name} has neither a uri nor a binary chunk", "gltf.buffer")
        data = binary
    elif not isinstance(uri, str):
        raise ReadError(f"{name}: the uri is not text", "gltf.json")
    elif uri.startswith("data:"):
        try:
            data = base64.b64decode(uri.partition(",")[2], validate=True)
        except (binascii.Error, ValueError) as error:
            raise ReadError(f"{name}: the data uri is not base64", "gltf.buffer") from error
    else:
        data = _beside(path, name, unquote(uri))
    if length > len(data):
        raise ReadError(f"{name} states {length} bytes, but {len(data)} exist", "gltf.bounds")
    return data[:length]


def _beside(path: Path, name: str, uri: str) -> bytes:
    folder = path.resolve().parent
    if "\0" in uri or "://" in uri:
        raise ReadError(f"{name}: '{uri[:80]}' is not read, because it is not a file in the same folder", "gltf.buffer")
    file = (folder / uri).resolve()
    if not file.is_relative_to(folder):
        raise ReadError(f"{name}: '{uri[:80]}' is not read, because it is outside the file's folder", "gltf.buffer")
    try:
        return file.read_bytes()
    except OSError as error:
        raise ReadError(f"{name}: '{uri[:80]}' cannot be read: {error.strerror}", "gltf.buffer") from error
