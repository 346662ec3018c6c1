"""Compare the files of a Unity package with those of the package that this version of twin has."""

from __future__ import annotations

import json
import re
from pathlib import Path

from twin.core.json_types import JsonMapping
from twin.exchange.audit.report import Ledger

PACKAGE = Path(__file__).resolve().parents[4] / "ui/headset/unity"
"""Folder of the package, both in a source checkout and in an installed wheel."""

_GUID = re.compile(rb"^guid:\s*([0-9a-f]{32})\s*$", re.MULTILINE)


def check_shipped(folder: Path, data: JsonMapping, ledger: Ledger) -> None:
    """Report files of a package that differ from twin's, or are missing; packages with other names have no counterpart.

    `data` is the content of the package.json. Line ends do not count; of a .meta file, which Unity writes again, only
    the GUID counts. Files that twin does not have may be the user's own.
    """
    try:
        own = json.loads((PACKAGE / "package.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    if data.get("name") != own["name"]:
        return
    if data.get("version") != own["version"]:
        text = (
            f"the package has version {data.get('version')}, this twin has version {own['version']}: the scripts are "
            "not compared with those of twin."
        )
        ledger.add("unity.version", "warning", text, "package.json", suggestion="export again")
        return
    wrong = 0
    files = sorted(p for p in PACKAGE.rglob("*") if p.is_file())
    names = [p.relative_to(PACKAGE).as_posix() for p in files]
    names = [n for n in names if not any(part.startswith(".") for part in n.split("/"))]
    for name in names:
        trouble = _differs(folder / name, PACKAGE / name)
        if trouble:
            wrong += 1
            ledger.wrong("unity.shipped", f"{name} {trouble}.", name, suggestion="export the package again")
    check = f"{len(names)} files of the package against those of twin"
    ledger.row(check, float(wrong), "differ", 0.0, against="the package of twin")


def _differs(file: Path, shipped: Path) -> str:
    """Return how a file differs from the shipped one; "" if it does not."""
    if not file.is_file():
        return "is missing; twin has this file"
    here, there = (p.read_bytes().replace(b"\r\n", b"\n") for p in (file, shipped))
    if shipped.suffix == ".meta":
        guids = [_GUID.findall(data) for data in (here, there)]
        return "" if guids[0] == guids[1] else "has another GUID than in twin: references to the asset are lost"
    if here == there:
        return ""
    lines, meant = here.split(b"\n"), there.split(b"\n")
    for number, (line, other) in enumerate(zip(lines, meant, strict=False), start=1):
        if line != other:
            return f"differs from the file of twin, first in line {number}"
    return f"has {len(lines)} lines, the file of twin has {len(meant)}"
