"""Read a glTF file for an audit."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.admit import admit
from twin.exchange.audit.context import Context
from twin.exchange.audit.gltf import read_gltf
from twin.exchange.audit.motion import Content
from twin.exchange.audit.report import Ledger


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a .glb or .gltf file, and report its faults; see `read_gltf`."""
    ledger.tool, ledger.version = "twin.exchange.audit gltf", "2.0"
    admit(path)
    return read_gltf(path, ledger)
