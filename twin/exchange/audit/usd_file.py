"""Check the container of a USD file before OpenUSD reads it: header of a binary layer, or zip archive of a USDZ.

OpenUSD does not check the counts in a header before it allocates memory for them: a file with a corrupt count takes
minutes to fail. Files in a USDZ must be uncompressed and aligned, because readers map them into memory.
"""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

from twin.exchange.audit.report import Ledger, Measured

_COUNTED = (b"TOKENS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS")
_MOST_PER_BYTE = 256
"""Maximum number of elements per byte of a compressed section."""

ALIGNMENT = 64
_LOCAL = struct.Struct("<4s5H3I2H")
LAYERS = (".usd", ".usda", ".usdc")


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


def check_usdz(path: Path, ledger: Ledger) -> bool:
    """Report faults of a .usdz archive; return whether the stage in the archive can be opened.

    Several layers are allowed, but three.js displays nothing for an archive with sublayers, and reports no error.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            broken = archive.testzip()
    except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        ledger.add("usdz.archive", "error", f"the file is not a readable zip archive: {error}.")
        return False
    if broken:
        ledger.add("usdz.archive", "error", f"the checksum of '{broken}' in the archive is wrong.", broken)
        return False
    if not entries or Path(entries[0].filename).suffix.lower() not in LAYERS:
        first = entries[0].filename if entries else "nothing"
        ledger.add("usdz.first", "error", f"the first file in the archive is {first}, but must be a USD layer.", first)
        return False
    data = path.read_bytes()
    for entry in entries:
        if entry.is_dir():
            continue
        if entry.compress_type != zipfile.ZIP_STORED:
            text = f"'{entry.filename}' is compressed: readers reject such an archive."
            ledger.wrong("usdz.compressed", text, entry.filename, suggestion="do not compress")
            continue
        fields = _LOCAL.unpack_from(data, entry.header_offset)
        start = entry.header_offset + _LOCAL.size + fields[-2] + fields[-1]
        if start % ALIGNMENT:
            text = (
                f"'{entry.filename}' starts at byte {start}, not a multiple of {ALIGNMENT}: readers that map the "
                "file into memory fail."
            )
            ledger.wrong("usdz.alignment", text, entry.filename, size=Measured(start % ALIGNMENT, 0.0))
    layers = [e.filename for e in entries if Path(e.filename).suffix.lower() in LAYERS]
    if len(layers) > 1:
        text = (
            f"the archive contains {len(layers)} layers: three.js shows nothing for such a file, and reports no error."
        )
        ledger.add("usdz.layers", "warning", text, layers[1], suggestion="flatten the layers into one")
    ledger.row("archive: stored, aligned, one layer", float(len(ledger.found)), "found", 0.0)
    return True
