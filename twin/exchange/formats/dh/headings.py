"""Read the headings of a table of Denavit-Hartenberg parameters: the column, the unit and the index of each."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from twin.exchange.formats.dh.cell_numbers import UNITS, plain_text
from twin.exchange.formats.dh.cells import Cells
from twin.exchange.formats.dh.table_errors import TableErrors

_HEADINGS = {
    "joint": ("", "i", "j", "joint", "joints", "link", "links", "#", "no", "axis", "frame", "name", "jointi", "linki"),
    "a": ("a", "linklength"),
    "alpha": ("alpha", "linktwist", "twist"),
    "d": ("d", "linkoffset"),
    "theta": ("theta", "jointangle"),
    "r": ("r",),
    "b": ("b",),
    "beta": ("beta",),
    "gamma": ("gamma",),
    "offset": ("offset", "jointoffset", "theta0", "thetaoffset", "thetaoff"),
    "kind": ("type", "jointtype", "kind", "sigma"),
    "lower": ("lower", "min", "qmin", "q-", "lowerlimit"),
    "upper": ("upper", "max", "qmax", "q+", "upperlimit"),
    "antecedent": ("antecedent", "a(j)", "parent"),
    "mu": ("mu",),
}
"""{column: its headings, without signs, indices and units}."""


@dataclass
class TableColumns:
    """The columns of a table.

    Attributes:
        headings: {column: its heading}.
        units: {column: the unit in its heading}; columns without one are left out.
        previous_index: columns whose heading has the index of the joint before, as a_{i-1}.
    """

    headings: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    previous_index: set[str] = field(default_factory=set)


def read_columns(cells: Cells, errors: TableErrors) -> TableColumns:
    """Return the columns of a table; set whether `errors` are those of a table of Denavit-Hartenberg parameters.

    Raises:
        SourceError: a heading is not known, or two mean the same.
    """
    columns = TableColumns()
    known_headings: list[str] = []
    for names in _HEADINGS.values():
        known_headings += names
    unknown_headings: list[str] = []
    repeated: list[str] = []
    for heading in cells.headings:
        name, unit, before = _split_heading(heading)
        column = None
        for candidate, names in _HEADINGS.items():
            if name in names:
                column = candidate
        if column is None:
            unknown_headings.append(heading)
            continue
        if column in columns.headings:
            text = f"the headings '{columns.headings[column]}' and '{heading}' mean the same"
            if heading == columns.headings[column]:
                text = f"the heading '{heading}' stands twice"
            repeated.append(f"{text}: remove one of the columns")
            continue
        columns.headings[column] = heading
        if unit:
            columns.units[column] = unit
        if before:
            columns.previous_index.add(column)
    stated = set(columns.headings)
    errors.recognised = {"alpha", "theta", "d"} <= stated and not stated.isdisjoint({"a", "r"})
    if repeated:
        errors.fail(cells.line, repeated[0])
    if unknown_headings:
        text = f"the heading '{unknown_headings[0]}' is not known: rename or remove the column. Known are "
        words = [word for word in known_headings if word not in ("", "#")]
        errors.refuse(cells.line, text + ", ".join(words))
    return columns


def _split_heading(heading: str) -> tuple[str, str, bool]:
    """Return (name without index and unit, unit or "", whether the index is that of the joint before)."""
    text = plain_text(heading)
    unit = ""
    match = re.search(r"[\[(/,]\s*([A-Za-z°]+)\s*[\])]?\s*$", text) or re.search(r"[_\s](mm|cm|m|deg|rad)$", text)
    if match and match[1].lower() in UNITS and match.start():
        unit = UNITS[match[1].lower()]
        text = text[: match.start()]
    text = re.sub(r"[\s_]+", "", text).lower()
    previous_index = re.search(r"(?<=.)\(?[ijkn]-1\)?$", text)
    if previous_index:
        return text[: previous_index.start()], unit, True
    # Before an index is cut off: the last letter of "min" or "link" looks like one.
    if text in _known_headings():
        return text, unit, False
    return re.sub(r"(?<=.)\(?[ijkn]\)?$", "", text), unit, False


def _known_headings() -> set[str]:
    headings: set[str] = set()
    for names in _HEADINGS.values():
        headings.update(names)
    return headings
