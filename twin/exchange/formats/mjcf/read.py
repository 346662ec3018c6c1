"""Read an MJCF file for `twin new`."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.admit import admit
from twin.exchange.read.mjcf import read_mjcf, refuse_nan
from twin.exchange.read.source import Imported, Options


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of an MJCF file; see `read_mjcf`."""
    refuse_nan(path)
    if options.guarded:
        admit(path)
    return read_mjcf(path, options.root)
