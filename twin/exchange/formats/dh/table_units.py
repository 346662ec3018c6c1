"""Find the units of a table of Denavit-Hartenberg parameters: one for lengths, one for angles.

A unit may be stated by the user, by a line `units:`, in the headings, and in the cells; a multiple of pi is in rad. All
statements must agree, and there must be one, except in a table of zeros.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from twin.exchange.formats.dh.cell_numbers import UNITS, cell_number
from twin.exchange.formats.dh.cells import Cells
from twin.exchange.formats.dh.headings import TableColumns
from twin.exchange.formats.dh.table_errors import TableErrors

LENGTH_COLUMNS = ("a", "d", "r", "b")
ANGLE_COLUMNS = ("alpha", "theta", "beta", "gamma")

_LIKE_COORDINATE = ("offset", "lower", "upper")
"""Columns in the unit of the joint's coordinate."""

_FULL_TURN = 2 * math.pi
"""Largest plain number in a column with multiples of pi: a larger one is in degrees."""

_UNITS_OF_QUANTITY = {"length": ("mm", "cm", "m"), "angle": ("deg", "rad")}
"""{quantity: its units}; the last one is that of a table of zeros."""


class _UnitStatement(NamedTuple):
    """A unit, what states it, and the line of the file where it does."""

    place: str
    unit: str
    line: int


@dataclass(frozen=True)
class UnitFinder:
    """Finder of the units of one table.

    Attributes:
        cells: the table.
        columns: its columns.
        moving: the two columns that may contain the coordinate of a joint, of a hinge and of a slide.
        errors: the errors of the file.
    """

    cells: Cells
    columns: TableColumns
    moving: tuple[str, str]
    errors: TableErrors

    def find(self, quantity: str, option: str | None, kinds: Sequence[str]) -> str:
        """Return the unit of a quantity, "length" or "angle"; all places that state one must state the same.

        `option` is the unit that the user gives, `kinds` the types of the joints, one for each row.

        Raises:
            SourceError: no place states the unit, or two state different ones.
        """
        quantity_columns = LENGTH_COLUMNS if quantity == "length" else ANGLE_COLUMNS
        possible = _UNITS_OF_QUANTITY[quantity]
        statements = self._units_beside_cells(quantity, quantity_columns, option)
        unitless: list[tuple[str, float, int]] = []
        multiples: list[_UnitStatement] = []
        kind_of_unit = "prismatic" if quantity == "length" else "revolute"
        for row, kind in zip(self.cells.rows, kinds, strict=True):
            # offset and limits have the unit of the coordinate of their row
            columns_with_unit = (*quantity_columns, *_LIKE_COORDINATE) if kind == kind_of_unit else quantity_columns
            for column in columns_with_unit:
                if column not in self.columns.headings:
                    continue
                text = row.cells[self.columns.headings[column]]
                number = cell_number(text, column in self.moving)
                if number is None:
                    continue
                if number.unit:
                    if number.unit not in possible:
                        self.errors.fail(
                            row.line, f"{column} = '{text}' is in {number.unit}, but {column} is a {quantity}"
                        )
                    statements.append(_UnitStatement(f"{column} = '{text}'", number.unit, row.line))
                elif number.of_pi:
                    multiples.append(_UnitStatement(f"{column} = '{text}'", "rad", row.line))
                elif number.value:
                    unitless.append((f"{column} = '{text}'", number.value, row.line))
        is_angle = quantity == "angle"
        if multiples and is_angle:
            statements.append(multiples[0])
        if not statements:
            if not unitless:  # all zeros: any unit will do
                return possible[-1]
            place, _, line = unitless[0]
            example = "m,rad" if is_angle else "mm,deg"
            text = f"the unit of {quantity}s ({place}) is not stated: {' or '.join(possible)}?"
            self.errors.refuse(line, f"{text} Give it by --units, as in --units {example}")
        first = statements[0]
        for place, unit, line in statements:
            if unit != first.unit:
                text = f"mixed units: {first.place} is in {first.unit}, but {place} in {unit}"
                self.errors.fail(line, f"{text}. Use one unit for every {quantity}")
        if multiples and is_angle and first.place == multiples[0].place:  # only multiples of pi state the unit
            for place, value, line in unitless:
                if abs(value) > _FULL_TURN:
                    text = f"mixed units: {first.place} is in rad, but {place} is more than a turn in rad"
                    self.errors.fail(line, f"{text}. Use one unit for every angle")
        return first.unit

    def _units_beside_cells(
        self, quantity: str, quantity_columns: tuple[str, ...], option: str | None
    ) -> list[_UnitStatement]:
        """Return the units of a quantity that the option, the key `units` and the headings state, in this order."""
        possible = _UNITS_OF_QUANTITY[quantity]
        statements: list[_UnitStatement] = []
        if option:
            statements.append(_UnitStatement("--units", option, self.cells.line))
        for word in re.split(r"[,;\s]+", self.cells.stated.get("units", "")):
            unit = UNITS.get(word.lower())
            if word and unit is None:
                names = ", ".join(dict.fromkeys(UNITS.values()))
                self.errors.fail(self.cells.line, f"units: there is no unit '{word}'; use two of {names}")
            if unit is not None and unit in possible:
                statements.append(_UnitStatement("the key `units`", unit, self.cells.line))
        for column in quantity_columns:
            unit = self.columns.units.get(column)
            if column in self.columns.headings and unit:
                heading = f"the heading '{self.columns.headings[column]}'"
                if unit not in possible:
                    self.errors.fail(self.cells.line, f"{heading} has the unit {unit}, but {column} is a {quantity}")
                statements.append(_UnitStatement(heading, unit, self.cells.line))
        for column in _LIKE_COORDINATE:
            unit = self.columns.units.get(column, "")
            if unit in possible:
                statements.append(
                    _UnitStatement(f"the heading '{self.columns.headings[column]}'", unit, self.cells.line)
                )
        return statements
