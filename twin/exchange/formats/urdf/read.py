"""Read a URDF for `twin new`."""

from __future__ import annotations

from pathlib import Path

from twin.exchange.read.source import Imported, Options
from twin.exchange.read.urdf import read_urdf


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a URDF, with the loops in its closure YAML; see `read_urdf`."""
    beside = path.with_suffix(".yaml")
    return read_urdf(path, options.closures or (beside if beside.is_file() else None))
