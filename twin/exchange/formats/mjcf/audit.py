"""Read an MJCF file for an audit."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.admit import admit
from twin.exchange.audit.context import Context, played
from twin.exchange.audit.motion import Content
from twin.exchange.audit.report import Ledger


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of an MJCF file with its poses along the tracks, and report its faults."""
    admit(path)
    import mujoco

    from twin.exchange.audit.mjcf import Mjcf

    ledger.tool, ledger.version = "mujoco", mujoco.__version__
    return played(Mjcf(path, ledger), path, ledger, context)
