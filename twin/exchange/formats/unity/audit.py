"""Check a Unity package in an audit."""

from __future__ import annotations

from pathlib import Path

from twin.exchange.audit.context import Context
from twin.exchange.audit.report import Ledger
from twin.exchange.audit.unity import check_package


def read(path: Path, ledger: Ledger, context: Context) -> None:
    """Report faults of the package in a folder; a package contains no robot."""
    ledger.tool, ledger.version = "twin.exchange.audit unity", "1"
    check_package(path, ledger)
