"""Read a STEP file for `twin new`."""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import SourceError
from twin.exchange.read.source import Imported, Options


def read(path: Path, options: Options) -> Imported:
    """Raise an error: a STEP file has no joints."""
    raise SourceError(f"{path}: a STEP file has no joints: use `twin new`, which makes a skeleton from it")
