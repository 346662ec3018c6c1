"""Check the header of a binary USD layer before OpenUSD reads the layer.

OpenUSD does not check the counts in a header before it allocates memory for them: a file with a corrupt count takes
minutes to fail.
"""

from __future__ import annotations

import struct

_COUNTED = (b"TOKENS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS")
_MOST_PER_BYTE = 256
"""Maximum number of elements per byte of a compressed section."""


def trouble(data: bytes) -> str:
    """Return the fault in a binary USD file's header as text; "" for valid headers, and for files of another kind."""
    if not data.startswith(b"PXR-USDC"):
        return ""
    if len(data) < 88:
        return f"the file has {len(data)} bytes, fewer than the header: it is truncated"
    (table,) = struct.unpack_from("<q", data, 16)
    if not 24 <= table <= len(data) - 8:
        return f"the table of contents is stated at byte {table}, but the file has {len(data)} bytes: it is truncated"
    (count,) = struct.unpack_from("<Q", data, table)
    if table + 8 + 32 * count > len(data):
        return f"the table of contents states {count} sections, more than fit into the file"
    for i in range(count):
        name, start, size = struct.unpack_from("<16sqq", data, table + 8 + 32 * i)
        name = name.split(b"\0", 1)[0]
        label = name.decode("latin-1")
        if start < 0 or size < 0 or start + size > len(data):
            return f"section {label} extends beyond the end of the file"
        if name in _COUNTED and size >= 8:
            (number,) = struct.unpack_from("<Q", data, start)
            if number > _MOST_PER_BYTE * size:
                return f"section {label} of {size} bytes states {number} elements, more than fit into the section"
    return ""
