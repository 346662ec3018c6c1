"""Write one text file, whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from twin.core.errors import OutputError


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8 to a file; the file has the old or the new content, also after an interrupt.

    Raises:
        OutputError: it cannot be written.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
