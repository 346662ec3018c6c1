"""Compare proof.json with the files on disk: changed, missing and additional files."""

from __future__ import annotations

import hashlib
import json
from functools import partial
from pathlib import Path
from typing import TypeGuard

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Ledger

SCHEMA = "twin-proof"


def check_proof(path: Path, ledger: Ledger) -> JsonObject:
    """Report differences between a proof.json and the files in its folder; return its JSON data, {} if malformed."""
    doubled_keys: list[str] = []
    try:
        data = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=partial(_object, doubled_keys))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        ledger.add("proof.unreadable", "error", f"the file's JSON cannot be read: {str(error)[:120]}.")
        return {}
    if not isinstance(data, dict) or data.get("schema") != SCHEMA or data.get("version") != 1:
        ledger.add("proof.schema", "error", f'the file does not contain "schema": "{SCHEMA}" and "version": 1.')
        return {}
    for key in doubled_keys:
        ledger.wrong("proof.doubled", f"proof.json has an object with the entry '{key}' twice.", key)
    rows = data.get("files")
    if not _are_files(rows):
        ledger.add("proof.schema", "error", "'files' is not a list of files.")
        return {}
    folder = path.parent
    listed = {path.name}
    wrong_count = 0
    for row in rows:
        if row["file"] in listed:
            ledger.wrong("proof.doubled", f"proof.json lists '{row['file']}' twice, or itself.", row["file"])
        listed.add(row["file"])
        wrong_count += not _is_as_listed(folder, row, ledger)
    for name in sorted(_visible_files(folder) - listed):
        text = f"'{name}' is in the folder, but not listed in proof.json."
        ledger.add("proof.unlisted", "warning", text, name, suggestion="export again, or remove the file")
    ledger.row(f"hashes of {len(rows)} files", float(wrong_count), "differ", 0.0, against="proof.json")
    if data.get("verdict") != "agree":
        text = f"the verdict in proof.json is '{data.get('verdict')}': the audit at the export found a fault."
        ledger.wrong("proof.verdict", text, "verdict")
    return data


def _visible_files(folder: Path) -> set[str]:
    """Return the paths of the files in a folder, relative to it; hidden ones, such as .DS_Store, are left out."""
    names = set()
    for path in folder.rglob("*"):
        relative = path.relative_to(folder)
        if path.is_file() and not any(part.startswith(".") for part in relative.parts):
            names.add(relative.as_posix())
    return names


def _object(doubled_keys: list[str], pairs: list[tuple[str, object]]) -> JsonObject:
    """Return a JSON object; keys that it has twice are added to a list: readers differ in which entry they take."""
    entries: JsonObject = {}
    for key, value in pairs:
        if key in entries:
            doubled_keys.append(key)
        entries[key] = value
    return entries


def _are_files(rows: object) -> TypeGuard[list[JsonObject]]:
    """Return whether the entry "files" is a list of objects that each name a file."""
    if not isinstance(rows, list):
        return False
    return all(isinstance(row, dict) and isinstance(row.get("file"), str) for row in rows)


def _is_as_listed(folder: Path, row: JsonObject, ledger: Ledger) -> bool:
    """Report a listed file that is missing, outside the folder or changed; return whether it is none of these."""
    name = row["file"]
    try:
        file = (folder / name).resolve()
        exists = file.is_file()
    except (OSError, ValueError):  # too long, or with a character that paths cannot have
        ledger.wrong("proof.file", f"{name[:80]!a}, listed in proof.json, is the name of no file.", "files")
        return False
    if not file.is_relative_to(folder.resolve()):
        ledger.wrong("proof.file", f"'{name}', listed in proof.json, is outside the folder.", name)
        return False
    if not exists:
        ledger.wrong("proof.missing", f"'{name}' is listed in proof.json, but does not exist.", name)
        return False
    stated = str(row.get("sha256", "")).removeprefix("sha256:")
    content = file.read_bytes()
    real = hashlib.sha256(content).hexdigest()
    if stated == real:
        size = row.get("bytes")
        if type(size) is int and size == len(content):  # a bool is an int too, but no number of bytes
            return True
        text = f"'{name}' has {len(content)} bytes; proof.json states {size}."
        ledger.wrong("proof.bytes", text, name)
        return False
    text = (
        f"'{name}' has changed since proof.json was written: the sha256 is {real[:12]}…, "
        f"in proof.json it is {stated[:12] or 'nothing'}…."
    )
    ledger.wrong("proof.hash", text, name)
    return False
