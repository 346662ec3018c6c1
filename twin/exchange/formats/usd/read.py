"""Read a stage for `twin new`."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.admit import admit
from twin.exchange.read.source import Imported, Options
from twin.exchange.read.usd import read_usd


def read(path: Path, options: Options) -> Imported:
    """Return the mechanism of a stage; see `read_usd`."""
    if options.guarded:
        admit(path)
    return read_usd(path, options.root)
