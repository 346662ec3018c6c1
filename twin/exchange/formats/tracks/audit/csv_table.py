"""Read the table of a CSV track: the lines of its header, and one line of numbers for each key."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Ledger, ReadError

SCHEMA = "twin-track"


def is_track(data: object) -> bool:
    """Return whether parsed JSON is a track."""
    return isinstance(data, dict) and data.get("schema") == SCHEMA


def csv_data(path: Path, ledger: Ledger) -> JsonObject:
    """Return a CSV track as the data of a JSON track, with arrays (k,) for its lists of numbers.

    The file has lines `# name: value`, a header with units, and one line for each key.

    Raises:
        ReadError: the header or all lines are missing, or a number is invalid.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise ReadError("the file is not text") from error
    data: JsonObject = {}
    line_count = len(lines)
    while lines and lines[0].startswith("#"):
        key, colon, value = lines.pop(0).lstrip("# ").partition(":")
        if colon:
            data[key.strip()] = _header_value(value.strip())
    lines_of_head = line_count - len(lines)
    rows = list(csv.reader(io.StringIO("\n".join(lines))))
    if not is_track(data) or len(rows) < 2:
        raise ReadError(
            f"the file lacks the line '# schema: {SCHEMA}', the line with the column names, or the lines of numbers"
        )
    header, *body = rows
    try:
        numbers = np.array(body, float)
    except ValueError as error:
        raise ReadError(_line_fault(path.name, header, body, lines_of_head + 1)) from error
    if numbers.shape[1] != len(header):
        raise ReadError(_line_fault(path.name, header, body, lines_of_head + 1))
    if header[0] != "time_s":
        raise ReadError(f"the first column is '{header[0]}', but must be time_s")
    links = names_in(data, "links")
    joints = names_in(data, "joints")
    kinds = names_in(data, "joint_types")
    _check_columns(header, _columns(links, joints, kinds), ledger)
    joints_end = 1 + len(joints)
    data["times"] = numbers[:, 0]
    data["positions"] = numbers[:, 1:joints_end].ravel()
    data["poses"] = numbers[:, joints_end:].ravel()
    return data


def _line_fault(file: str, header: list[str], body: list[list[str]], header_line: int) -> str:
    """Return the fault of the first line of numbers in `body` that is no line of numbers for the columns `header`.

    `header_line` is the number of the line with the column names in the file, counted from 1.
    """
    if any(";" in column for column in header):
        return (
            f"{file}, line {header_line}: semicolons separate the columns, as a spreadsheet of a language with decimal "
            "commas saves them. Save the table with commas between the columns and decimal points"
        )
    for number, row in enumerate(body, header_line + 1):
        if len(row) != len(header):
            text = f"{file}, line {number} has {len(row)} entries, expected {len(header)}"
            if len(row) > len(header):
                text += "; a number with a decimal comma counts as two: write decimal points"
            return text
        for column, entry in zip(header, row, strict=True):
            try:
                float(entry)
            except ValueError:
                return (
                    f"{file}, line {number}: '{entry[:40]}' in column '{column}' is not a number; write decimal points"
                )
    return f"{file}: the lines below line {header_line} are no numbers"


def _columns(links: list[str], joints: list[str], kinds: list[str]) -> list[str]:
    """Return the names of the columns of a CSV track with these links and joints."""
    columns = ["time_s"]
    # Not strict: where types are missing, the columns do not match, which is reported with their names.
    for joint, kind in zip(joints, kinds, strict=False):
        unit = "rad" if kind == "revolute" else "m"
        columns.append(f"{joint}_{unit}")
    for link in links:
        for component in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"):
            columns.append(f"{link}_{component}")
    return columns


def _check_columns(header: list[str], expected: list[str], ledger: Ledger) -> None:
    """Report a line of column names that does not match links and joints.

    Raises:
        ReadError: the count of columns is wrong.
    """
    if header == expected:
        return
    difference = ""
    for name, expected_name in zip(header, expected, strict=False):  # their counts are compared below
        if name != expected_name:
            difference = f"'{name}' instead of '{expected_name}'"
            break
    count_difference = f"{len(header)} columns instead of {len(expected)}"
    text = f"columns do not match links and joints: found {difference or count_difference}."
    ledger.wrong("tracks.columns", text, difference)
    if len(header) != len(expected):
        raise ReadError(text)


def _header_value(value: str) -> Any:
    """Return the value in a line `# name: value`: JSON, or a text, which stands there without quotes."""
    try:
        return json.loads(value)
    except ValueError:
        return value


def names_in(data: JsonObject, key: str) -> list[str]:
    """Return the entry `key` of a track, a list of names.

    Raises:
        ReadError: it is not a list of texts.
    """
    value = data.get(key)
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        raise ReadError(f"'{key}' is not a list of strings")
    return value
