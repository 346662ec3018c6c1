"""Limits of zip archives, checked before unpacking."""

from __future__ import annotations

import zipfile
from pathlib import Path

from twin.core.foreign.budget import BUDGETS, check_size, over


def check_zip(path: Path, kind: str) -> None:
    """Raise an error if the files of an archive together exceed the limits; a file that is not an archive passes.

    The check uses the sizes stated in the archive. This is safe, because unpacking reads no more bytes than stated.

    Raises:
        BudgetError: the archive has too many files, or they are too large.
        OSError: the file cannot be read.
    """
    check_size(path, kind)
    limits = BUDGETS[kind]
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError):
        return
    if kind == "USDZ" and len(entries) > limits.count:
        over(path, kind, "files in the archive", len(entries), limits.count)
    size = sum(e.file_size for e in entries)
    if size > limits.unpacked:
        over(path, kind, "unpacked bytes", size, limits.unpacked)
