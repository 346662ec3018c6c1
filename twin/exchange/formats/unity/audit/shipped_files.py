"""Compare the files of a Unity package with those of the package that this version of twin has."""

from __future__ import annotations

import json
import re
from pathlib import Path

from twin.core.json_types import JsonMapping
from twin.exchange.audit.ledger import Ledger

PACKAGE = Path(__file__).resolve().parents[4] / "ui/headset/unity"
"""Folder of the package, both in a source checkout and in an installed wheel."""

_ENTRY = re.compile(r"^ *([\w]+):[ \t]*(.*?)[ \t]*$", re.MULTILINE)

_GUID = "guid"

_REWRITTEN = ("serializedVersion",)
"""Entries of .meta files that Unity changes when it writes them again."""


def is_shipped(folder: Path) -> bool:
    """Return whether the package in a folder has the name of twin's."""
    names = []
    for package in (folder, PACKAGE):
        try:
            manifest = json.loads((package / "package.json").read_text(encoding="utf-8-sig"))
            names.append(manifest["name"])
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return False
    return names[0] == names[1]


def check_shipped(folder: Path, data: JsonMapping, ledger: Ledger) -> None:
    """Report files of a package that differ from twin's, or are missing; packages with other names have no counterpart.

    `data` is the content of the package.json. Line ends do not count; of a .meta file, which Unity writes again, the
    entries of twin count, and Unity may add others. Files that twin does not have may be the user's own.
    """
    try:
        own_manifest = json.loads((PACKAGE / "package.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    if data.get("name") != own_manifest["name"]:
        return
    if data.get("version") != own_manifest["version"]:
        text = (
            f"the package has version {data.get('version')}, this twin has version {own_manifest['version']}: the "
            "scripts are not compared with those of twin."
        )
        ledger.add("unity.version", "warning", text, "package.json", suggestion="export again")
        return
    count = 0
    different = 0
    for shipped in sorted(PACKAGE.rglob("*")):
        path = shipped.relative_to(PACKAGE)
        is_hidden = any(part.startswith(".") for part in path.parts)
        if not shipped.is_file() or is_hidden:
            continue
        count += 1
        name = path.as_posix()
        difference = _difference(folder / name, shipped)
        if difference:
            different += 1
            ledger.wrong("unity.shipped", f"{name} {difference}.", name, suggestion="export the package again")
    check = f"{count} files of the package against those of twin"
    ledger.row(check, float(different), "differ", 0.0, against="the package of twin")


def _difference(file: Path, shipped: Path) -> str:
    """Return how a file differs from the shipped one; "" if it does not."""
    if not file.is_file():
        return "is missing; twin has this file"
    # Git on Windows changes line ends on checkout, which changes nothing that Unity reads.
    content = file.read_bytes().replace(b"\r\n", b"\n")
    expected = shipped.read_bytes().replace(b"\r\n", b"\n")
    if shipped.suffix == ".meta":
        return meta_difference(content, expected)
    if content == expected:
        return ""
    if shipped.suffix in (".json", ".asmdef"):
        data = _parsed(content)
        expected_data = _parsed(expected)
        # An entry says more than a line, and the layout of JSON says nothing.
        if data is not None and expected_data is not None:
            return _entry_difference(data, expected_data)
    lines = content.split(b"\n")
    expected_lines = expected.split(b"\n")
    for number, (line, expected_line) in enumerate(zip(lines, expected_lines, strict=False), start=1):
        if line != expected_line:
            return f"differs from the file of twin, first in line {number}"
    return f"has {len(lines)} lines, the file of twin has {len(expected_lines)}"


def _parsed(content: bytes) -> JsonMapping | None:
    """Return the object in a JSON file; None if there is none."""
    try:
        data = json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) else None


def _entry_difference(data: JsonMapping, expected_data: JsonMapping) -> str:
    """Return how the entries of a JSON object differ from those expected; "" if they are equal."""
    differing = [key for key in {**expected_data, **data} if data.get(key) != expected_data.get(key)]
    if not differing:
        return ""
    key = differing[0]
    value = data.get(key)
    expected_value = expected_data.get(key)
    if isinstance(value, dict) and isinstance(expected_value, dict):
        inner = [name for name in {**expected_value, **value} if value.get(name) != expected_value.get(name)]
        return f"differs from the file of twin in the entry '{key}', in {', '.join(map(repr, inner[:3]))}"
    return f"differs from the file of twin in the entry '{key}'"


def meta_difference(content: bytes, expected: bytes, *, own_guid: bool = False) -> str:
    """Return how the entries of a .meta file differ from those expected; "" if it has all of them.

    With `own_guid`, the GUID is that of another file, and is not compared.
    """
    stated = dict(_ENTRY.findall(content.decode("utf-8", "replace")))
    for key, value in _ENTRY.findall(expected.decode("utf-8")):
        if key in _REWRITTEN or (own_guid and key == _GUID):
            continue
        if key == _GUID and stated.get(key) != value:
            return "has another GUID than in twin: references to the asset are lost"
        if stated.get(key) != value:
            return f"has the entry '{key}: {stated.get(key, 'missing')}', not '{value}' as in twin"
    return ""
