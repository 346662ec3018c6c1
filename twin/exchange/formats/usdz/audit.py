"""Read a USDZ file for an audit: the archive, then its stage."""

from __future__ import annotations

from pathlib import Path

from twin.core.foreign.archive import check_zip
from twin.core.foreign.budget import check_size
from twin.exchange.audit.context import Context
from twin.exchange.audit.motion import Content
from twin.exchange.audit.report import Ledger
from twin.exchange.audit.usd_checks import version
from twin.exchange.audit.usd_file import check_usdz
from twin.exchange.formats.usd.audit import read_layer


def read(path: Path, ledger: Ledger, context: Context) -> Content | None:
    """Return the content of a USDZ file, and report its faults; None if its archive cannot be opened.

    Raises:
        ReadError: OpenUSD cannot read the stage.
    """
    ledger.tool, ledger.version = "twin.exchange.audit on usd-core", version()
    check_size(path, "USD")
    check_zip(path, "USDZ")
    if not check_usdz(path, ledger):
        return None
    return read_layer(path, ledger, context)
