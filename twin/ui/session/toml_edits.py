"""Add tables to a TOML file of a user: comments and layout are preserved, and invalid text never replaces the file.

tomlkit parses the text with its comments and inserts the tables. Two checks precede the replacement: `tomllib` reads
exactly the old content and the new tables in the new text, and the caller reads the new text as its kind of file.
"""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import tomlkit
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Item, Table, Whitespace

from twin.core.assets import atomic_folder
from twin.core.errors import DescriptionError, OutputError, TwinError
from twin.core.json_types import JsonObject


class TomlEntry(NamedTuple):
    """A table to add.

    Attributes:
        table: name of a table of tables or of a list of tables in the file.
        key: the entry becomes the table `table.key`; None: it becomes the last element of the list `table`.
        values: keys and values of the entry; those of an existing `table.key` are replaced, its other ones stay.
    """

    table: str
    key: str | None
    values: JsonObject


def rewrite(path: Path, entries: Sequence[TomlEntry], check: Callable[[Path], None]) -> None:
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
    new_text = _with_entries(path, text, entries)
    try:
        with atomic_folder(target.parent) as work:
            new_file = work / target.name
            new_file.write_bytes(new_text.encode())
            shutil.copymode(target, new_file)
            try:
                check(new_file)
            except TwinError as error:
                reason = str(error).replace(str(new_file), str(path))
                raise type(error)(f"{reason} (in the new text; the file is unchanged)") from error
    except OutputError as error:
        why = getattr(error.__cause__, "strerror", None) or error
        message = (
            f"{path}: cannot be written: {why}. Copy the robot's folders to a writable place, and load the robot from "
            "there."
        )
        raise OutputError(message) from error


def _with_entries(path: Path, text: str, entries: Sequence[TomlEntry]) -> str:
    """Return the text of a TOML file with further entries, and with the line ends of the old text.

    Raises:
        DescriptionError: the entries cannot be added in this layout.
    """
    expected = tomllib.loads(text)
    try:
        document = tomlkit.parse(text)
        for entry in entries:
            if entry.key is None:
                expected[entry.table].append(entry.values)
            else:
                expected.setdefault(entry.table, {})[entry.key] = entry.values
            _add(document, entry)
        new_text = tomlkit.dumps(document)
        if "\r\n" in text:
            new_text = new_text.replace("\r\n", "\n").replace("\n", "\r\n")
        is_as_expected = tomllib.loads(new_text) == expected
    except (TOMLKitError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise _layout_error(path, entries) from error
    if not is_as_expected:
        raise _layout_error(path, entries)
    return new_text


def _add(document: tomlkit.TOMLDocument, entry: TomlEntry) -> None:
    """Add an entry to a document, behind the entries of its kind.

    What tomlkit finds under a name depends on the layout of the file; the caller converts the errors of a layout
    without a place for the entry.
    """
    parent: Any = document.get(entry.table)
    if entry.key is not None and parent is not None and entry.key in parent:
        parent[entry.key].update(entry.values)
        return
    if parent is None:
        parent = tomlkit.table(is_super_table=True)
        document[entry.table] = parent
    new_table = tomlkit.table()
    new_table.update(entry.values)
    siblings = list(parent if entry.key is None else parent.values())
    is_contiguous = not isinstance(parent, OutOfOrderTableProxy)
    if siblings and isinstance(siblings[-1], Table) and is_contiguous:
        for item in _cut_following_comments(siblings[-1]):
            new_table.append(None, item)
    if entry.key is None:
        parent.append(new_table)
    else:
        parent[entry.key] = new_table


def _cut_following_comments(table: Table) -> list[Item]:
    """Remove from a table, and return, the comments after a blank line below its last key; end it by a blank line.

    tomlkit counts such comments to this table, but they describe the next one, so they belong below a new table that is
    inserted between the two.
    """
    body = table.value.body
    end_of_keys = 0
    for number, (key, _) in enumerate(body):
        if key is not None:
            end_of_keys = number + 1
    first_blank = len(body)
    for number in range(end_of_keys, len(body)):
        if isinstance(body[number][1], Whitespace):
            first_blank = number
            break
    following = [item for _, item in body[first_blank:]]
    del body[first_blank:]
    table.add(tomlkit.nl())
    return following


def _layout_error(path: Path, entries: Sequence[TomlEntry]) -> DescriptionError:
    names = []
    for entry in entries:
        names.append(f"[{entry.table}.{entry.key}]" if entry.key else f"[[{entry.table}]]")
    return DescriptionError(
        f"{path}: cannot add {', '.join(names)} in this layout: write the existing tables of this kind with such "
        "headers, too"
    )
