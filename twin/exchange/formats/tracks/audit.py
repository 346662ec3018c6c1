"""Read a track for an audit."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.admit import admit
from twin.exchange.audit.context import Context
from twin.exchange.audit.motion import Content
from twin.exchange.audit.report import Ledger
from twin.exchange.audit.tracks import read_csv, read_json


def read(path: Path, ledger: Ledger, context: Context) -> Content | None:
    """Return the content of a track, JSON or CSV, and report its faults."""
    ledger.tool, ledger.version = "twin.exchange.audit tracks", "1"
    admit(path)
    if path.suffix.lower() == ".csv":
        return read_csv(path, ledger)
    return read_json(path, ledger)
