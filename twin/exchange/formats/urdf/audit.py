"""Read a URDF for an audit."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.admit import admit
from twin.exchange.audit.context import Context, played
from twin.exchange.audit.motion import Content
from twin.exchange.audit.report import Ledger
from twin.exchange.audit.urdf import Urdf


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a URDF with its poses along the tracks, and report its faults."""
    admit(path)
    ledger.tool, ledger.version = "twin.exchange.audit urdf", "1"
    return played(Urdf(path, ledger), path, ledger, context)
