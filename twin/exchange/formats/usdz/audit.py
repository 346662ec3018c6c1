"""Read a USDZ file for an audit: the archive, then its stage."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

from pxr import Usd, UsdGeom

from twin.core.foreign.budget import check_size, check_zip
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.reader_context import Context
from twin.exchange.formats.usd.audit import read_layer
from twin.exchange.formats.usd.audit.checks import version

ALIGNMENT = 64
"""Each file in the archive must start at a multiple of this number of bytes, because readers map it into memory."""

LAYERS = (".usd", ".usda", ".usdc")
_LOCAL = struct.Struct("<4s5H3I2H")


def read(path: Path, ledger: Ledger, context: Context) -> Content | None:
    """Return the content of a USDZ file, and report its faults; None if its archive cannot be opened.

    Raises:
        ReadError: OpenUSD cannot read the stage.
    """
    ledger.tool = "twin.exchange.audit on usd-core"
    ledger.version = version()
    check_size(path, "USD")
    check_zip(path, "USDZ")
    if not _opens(path, ledger):
        return None
    content = read_layer(path, ledger, context)
    _check_purposes(path, ledger)
    return content


def _check_purposes(path: Path, ledger: Ledger) -> None:
    """Report meshes with a purpose for which viewers do not show them."""
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        purpose = UsdGeom.Imageable(prim).ComputePurpose() if prim.IsA(UsdGeom.Mesh) else UsdGeom.Tokens.default_
        # UsdGeomImageable: a guide helps who edits, a proxy stands for heavier geometry; neither is the picture itself.
        if purpose in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
            place = str(prim.GetPath())
            text = f"mesh {place} has the purpose {purpose}: AR viewers do not show it."
            ledger.add("usdz.purpose", "warning", text, place, suggestion="remove the purpose")


def _opens(path: Path, ledger: Ledger) -> bool:
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
    # USDZ specification: the first file is the default layer, which readers open without a look at the others.
    first = entries[0].filename if entries else "nothing"
    if not _is_layer(first):
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
        # The local header, not the directory, states the padding before the data.
        *_, name_size, extra_size = _LOCAL.unpack_from(data, entry.header_offset)
        start = entry.header_offset + _LOCAL.size + name_size + extra_size
        if start % ALIGNMENT:
            text = (
                f"'{entry.filename}' starts at byte {start}, not a multiple of {ALIGNMENT}: readers that map the "
                "file into memory fail."
            )
            ledger.wrong("usdz.alignment", text, entry.filename, size=Measured(start % ALIGNMENT, 0.0))
    layers = [entry.filename for entry in entries if _is_layer(entry.filename)]
    if len(layers) > 1:
        text = (
            f"the archive contains {len(layers)} layers: three.js shows nothing for such a file, and reports no error."
        )
        ledger.add("usdz.layers", "warning", text, layers[1], suggestion="flatten the layers into one")
    ledger.row("archive: stored, aligned, one layer", float(len(ledger.found)), "found", 0.0)
    return True


def _is_layer(name: str) -> bool:
    return Path(name).suffix.lower() in LAYERS
