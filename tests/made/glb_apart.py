"""Read, edit and write GLB files, for tests that seed defects."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np


class Glb:
    """A GLB file: its JSON `document` and its `binary` chunk, both editable."""

    def __init__(self, data: bytes) -> None:
        size = struct.unpack_from("<I", data, 12)[0]
        self.document: dict[str, Any] = json.loads(data[20 : 20 + size])
        self.binary = bytearray(data[28 + size :])

    def numbers(self, accessor: int) -> np.ndarray:
        """Return an accessor as an array (n, width); changes of the array change the file."""
        a = self.document["accessors"][accessor]
        view = self.document["bufferViews"][a["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[a["type"]]
        dtype = np.dtype({5126: "<f4", 5125: "<u4", 5123: "<u2"}[a["componentType"]])
        assert view.get("byteStride", dtype.itemsize * width) == dtype.itemsize * width
        start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
        return np.frombuffer(self.binary, dtype, a["count"] * width, start).reshape(-1, width)

    def node(self, name: str) -> dict[str, Any]:
        return next(n for n in self.document["nodes"] if n.get("name") == name)

    def links(self) -> list[dict[str, Any]]:
        return [n for n in self.document["nodes"] if n.get("extras", {}).get("link")]

    def channels(self, path: str) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
        """Yield (channel, sampler) for all animation channels with the target path `path`, such as "rotation"."""
        for animation in self.document["animations"]:
            for c in animation["channels"]:
                if c["target"]["path"] == path:
                    yield c, animation["samplers"][c["sampler"]]

    def bytes(self) -> bytes:
        text = json.dumps(self.document).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text
        body += struct.pack("<II", len(self.binary), 0x004E4942) + bytes(self.binary)
        return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body
