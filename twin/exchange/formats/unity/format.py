"""The Unity package in lists of formats."""

from __future__ import annotations

import json
from pathlib import Path

from twin.exchange.format import Format, Places


def is_package(file: Path) -> bool:
    """Return whether a package.json belongs to a Unity package: its entry `unity` states the editor version."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return "unity" in file.parent.name.lower()
    return isinstance(data, dict) and "unity" in data


FORMAT = Format(
    name="unity",
    title="Unity package",
    places=Places(export=40, use=40, audit=70),
    marker="package.json",
    recognise=is_package,
    code="unity",
    use="- Unity: add unity/ as a package from disk, then use its menu to import the GLB and the tracks.",
)
