"""The header of a binary USD layer: sections that lie in the file, and counts that a file of its size can hold.

OpenUSD believes these numbers and asks for the memory; a broken count costs minutes before it gives up.
"""

from __future__ import annotations

import struct

_COUNTED = (b"TOKENS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS")
_MOST_PER_BYTE = 256
"""Elements that one byte of a compressed section can stand for, at most."""


def trouble(data: bytes) -> str:
    """Return what is wrong with the header of a crate file, "" if nothing is, or if it is no crate file."""
    if not data.startswith(b"PXR-USDC"):
        return ""
    if len(data) < 88:
        return f"it ends after {len(data)} bytes"
    (table,) = struct.unpack_from("<q", data, 16)
    if not 24 <= table <= len(data) - 8:
        return f"its table of contents is said to begin at byte {table} of {len(data)}: cut off"
    (count,) = struct.unpack_from("<Q", data, table)
    if table + 8 + 32 * count > len(data):
        return f"its table of contents names {count} sections, more than the file can hold"
    for i in range(count):
        name, start, size = struct.unpack_from("<16sqq", data, table + 8 + 32 * i)
        name = name.split(b"\0", 1)[0]
        label = name.decode("latin-1")
        if start < 0 or size < 0 or start + size > len(data):
            return f"section {label} leaves the file"
        if name in _COUNTED and size >= 8:
            (number,) = struct.unpack_from("<Q", data, start)
            if number > _MOST_PER_BYTE * size:
                return f"section {label} of {size} bytes is said to hold {number} elements: not believed"
    return ""
