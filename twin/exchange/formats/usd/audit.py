"""Read a stage for an audit."""

from __future__ import annotations

from pathlib import Path

from pxr import Tf

from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size
from twin.exchange.audit.context import Context
from twin.exchange.audit.motion import Content
from twin.exchange.audit.report import Ledger, ReadError
from twin.exchange.audit.usd import read_usd
from twin.exchange.audit.usd_checks import check_usd, version
from twin.exchange.audit.usd_file import trouble


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage, and report its faults; the size and the header are checked first.

    Raises:
        ReadError: the header is wrong, or OpenUSD cannot read the stage.
    """
    ledger.tool, ledger.version = "twin.exchange.audit on usd-core", version()
    check_size(path, "USD")
    return read_layer(path, ledger, context)


def read_layer(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage or archive whose size has been checked; see `read`."""
    if broken := trouble(path.read_bytes()):
        raise ReadError(broken, "usd.header")
    if path not in context.admitted:
        admit(path)
    try:
        content = read_usd(path, ledger)
        check_usd(path, bool(content.extra["physics"]), ledger)
    except Tf.ErrorException as error:  # OpenUSD detects some faults only when it reads the data
        reason = str(error).strip().splitlines()[-1].strip()[:200]
        raise ReadError(f"OpenUSD cannot read the stage: {reason}") from error
    return content
