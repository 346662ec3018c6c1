"""Zip archives whose content is counted before it is unpacked."""

from __future__ import annotations

import zipfile
from pathlib import Path

from twin.core.foreign.budget import BUDGETS, check_size, over


def check_zip(path: Path, kind: str) -> None:
    """Do nothing if all files of an archive together may be unpacked; what is no archive is left to its reader.

    The size that the archive states is believed, because no more of a file is unpacked than that.

    Raises:
        BudgetError: they are too many, or too large.
        OSError: it cannot be read.
    """
    check_size(path, kind)
    limits = BUDGETS[kind]
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError):
        return
    if kind == "USDZ" and len(entries) > limits.count:
        over(path, kind, "files in it", len(entries), limits.count)
    size = sum(e.file_size for e in entries)
    if size > limits.unpacked:
        over(path, kind, "bytes, unpacked", size, limits.unpacked)
