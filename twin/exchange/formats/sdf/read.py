"""Read an SDF file for `twin new`."""

from __future__ import annotations

from pathlib import Path

from twin.exchange.read.sdf import read_sdf
from twin.exchange.read.source import Imported, Options


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an SDF file; see `read_sdf`."""
    return read_sdf(path, options.root)
