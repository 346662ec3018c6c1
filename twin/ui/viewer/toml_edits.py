"""Add entries to hand-written TOML; comments, layout and all other entries are preserved."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Table, Whitespace

from twin.core.assets import atomic_folder
from twin.core.errors import DescriptionError, OutputError, TwinError
from twin.core.json_types import JsonObject

Entry = tuple[str, str | None, JsonObject]
"""(Table, key, values) of an entry to add. The values become the table `table.key` or, if the key is None, the last
element of the list `table`."""


def rewrite(path: Path, entries: list[Entry], check: Callable[[Path], None]) -> None:
    """Write entries into a TOML file, if the new text passes a check.

    `check` is called with the path of a file of the same name that contains the new text. It raises `TwinError` if the
    text is invalid.

    Raises:
        TwinError: `check` raised it.
        DescriptionError: the entries cannot be added in the layout of the file.
        OutputError: the file cannot be written.
    """
    target = path.resolve()
    text = target.read_bytes().decode("utf-8")
    expected = tomllib.loads(text)
    try:
        document: Any = tomlkit.parse(text)
        for table, key, values in entries:
            if key is None:
                expected[table].append(values)
                _append(document, table, None, values)
            else:
                expected.setdefault(table, {})[key] = values
                _append(document, table, key, values)
        new = tomlkit.dumps(document)
        if "\r\n" in text:
            new = new.replace("\r\n", "\n").replace("\n", "\r\n")
        same = tomllib.loads(new) == expected
    except (TOMLKitError, ValueError, TypeError, AttributeError) as error:
        raise _layout(path, entries) from error
    if not same:
        raise _layout(path, entries)
    try:
        with atomic_folder(target.parent) as work:
            fresh = work / target.name
            fresh.write_bytes(new.encode())
            shutil.copymode(target, fresh)
            try:
                check(fresh)
            except TwinError as error:
                reason = str(error).replace(str(fresh), str(path))
                raise type(error)(f"{reason} (in the new text; the file is unchanged)") from error
    except OutputError as error:
        why = getattr(error.__cause__, "strerror", None) or error
        text = (
            f"{path}: cannot be written: {why}. Copy the robot's folders to a writable place, and load the robot from "
            "there."
        )
        raise OutputError(text) from error


def _append(document: Any, table: str, key: str | None, values: JsonObject) -> None:
    """Append values to the list `table` or, with a key, set the values in `table.key`; existing values are replaced."""
    parent: Any = document.get(table)
    if key is not None and parent is not None and key in parent:
        parent[key].update(values)
        return
    if parent is None:
        document[table] = parent = tomlkit.table(is_super_table=True)
    fresh: Any = tomlkit.table()
    fresh.update(values)
    before = list(parent if key is None else parent.values())
    if before and isinstance(before[-1], Table) and not isinstance(parent, OutOfOrderTableProxy):
        # Comments after a blank line below the last table belong to the next table; insert the new table before them.
        body = before[-1].value.body
        end = max((n + 1 for n, (k, _) in enumerate(body) if k is not None), default=0)
        end = next((n for n in range(end, len(body)) if isinstance(body[n][1], Whitespace)), len(body))
        below = [item for _, item in body[end:]]
        del body[end:]
        before[-1].add(tomlkit.nl())
        for item in below:
            fresh.append(None, item)
    if key is None:
        document[table].append(fresh)
    else:
        parent[key] = fresh


def _layout(path: Path, entries: list[Entry]) -> DescriptionError:
    names = ", ".join(f"[{table}.{key}]" if key else f"[[{table}]]" for table, key, _ in entries)
    return DescriptionError(
        f"{path}: cannot add {names} in this layout: write the existing tables of this kind with such headers, too"
    )
