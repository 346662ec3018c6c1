"""Denavit-Hartenberg parameters from the texts of a table: headings, conventions, units, numbers.

The four conventions, for row i with the coordinate q in theta or d:

    standard    T = Rz(theta) Tz(d) Tx(a) Rx(alpha)                    Denavit and Hartenberg 1955, distal
    modified    T = Rx(alpha) Tx(a) Rz(theta) Tz(d)                    Craig 1986, alpha_{i-1} and a_{i-1} in row i
    khalil      T = Rz(gamma) Tz(b) Rx(alpha) Tx(d) Rz(theta) Tz(r)    Khalil and Kleinfinger 1986
    hayati      T = Rz(theta) Tx(a) Rx(alpha) Ry(beta)                 Hayati and Mirmirani 1985, rows with beta
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from twin.core.units import DEG, LENGTH, MM
from twin.exchange.formats.dh.cell_numbers import (
    COORDINATE,
    CellNumber,
    cell_number,
    has_coordinate,
    is_quarter_turn_in_rad,
    plain_text,
)
from twin.exchange.formats.dh.cells import Cells, TableRow, read_cells
from twin.exchange.formats.dh.convention import find_convention, require_columns
from twin.exchange.formats.dh.headings import read_columns
from twin.exchange.formats.dh.table_errors import TableErrors
from twin.exchange.formats.dh.table_units import LENGTH_COLUMNS, UnitFinder
from twin.exchange.read.imported_robot import DhOptions

_KIND_WORDS = {
    "revolute": "revolute",
    "continuous": "revolute",
    "r": "revolute",
    "rz": "revolute",
    "rubz": "revolute",
    "0": "revolute",
    "rotational": "revolute",
    "prismatic": "prismatic",
    "p": "prismatic",
    "pz": "prismatic",
    "1": "prismatic",
    "linear": "prismatic",
    "fixed": "fixed",
    "f": "fixed",
    "2": "fixed",
}
"""{kind of a joint: its type}: of ROS and MATLAB, of the Robotics Toolbox, of Pinocchio, and sigma of Khalil."""

_UNIT_SIZES = {"mm": MM, "cm": LENGTH["cm"], "m": 1.0, "deg": DEG, "rad": 1.0}


@dataclass(frozen=True)
class CellQuantity:
    """A number of a cell.

    Attributes:
        value: its value in m or rad.
        stated_value: the number in the unit of the table.
        unit: the unit: "mm", "cm", "m", "deg" or "rad".
    """

    value: float
    stated_value: float
    unit: str


ZERO = CellQuantity(0.0, 0.0, "m")


@dataclass(frozen=True)
class DhRow:
    """A row in SI units.

    Attributes:
        line: line of the file.
        name: name of the joint; "" if the table has only numbers.
        kind: "revolute", "prismatic" or "fixed".
        values: {parameter: its constant part}, of a, alpha, d, theta, r, b, beta, gamma, as the convention needs.
        limits: (lower, upper) in m or rad, or None.
    """

    line: int
    name: str
    kind: str
    values: dict[str, CellQuantity]
    limits: tuple[float, float] | None


@dataclass(frozen=True)
class DhTable:
    """A table whose convention and units are known. `assumptions` are sentences on what was taken as usual."""

    convention: str
    rows: list[DhRow]
    assumptions: list[str]


def unit_size(unit: str) -> float:
    """Return the size of the unit of a `CellQuantity` in m or rad."""
    return _UNIT_SIZES[unit]


def read_table(path: Path, options: DhOptions) -> DhTable:
    """Return the table of a file.

    Raises:
        SourceError: the table cannot be read, or does not say what is needed; the message names file, line and value.
    """
    return _Reader(path, read_cells(path), options).read()


class _Reader:
    """Reader of the rows of one table, whose convention and units it finds first.

    Attributes:
        cells: the table.
        options: what the user states of convention and units.
        errors: the errors of the file.
        assumptions: sentences on what was taken as usual.
        columns: {column: its heading}.
        heading_units: {column: the unit in its heading}.
        moving: the columns that may contain the coordinate of a hinge, and of a slide.
        unit: {"length", "angle": its unit}.
    """

    def __init__(self, path: Path, cells: Cells, options: DhOptions) -> None:
        self.cells = cells
        self.options = options
        self.errors = TableErrors(path)
        self.assumptions: list[str] = []

    def read(self) -> DhTable:
        """Return the table. Each step needs what the steps before have found.

        Raises:
            SourceError: the table has a fault, or does not say what is needed.
        """
        columns = read_columns(self.cells, self.errors)
        if self.cells.fault:
            self.errors.fail_with(self.cells.fault)
        convention = find_convention(self.cells, columns, self.options.convention, self.errors)
        require_columns(self.cells, columns, convention, self.errors)
        self.columns = columns.headings
        self.heading_units = columns.units
        self.moving = ("theta", "r") if convention == "khalil" else ("theta", "d")
        kinds = self._find_kinds()
        units = UnitFinder(self.cells, columns, self.moving, self.errors)
        self.unit = {
            "length": units.find("length", self.options.length, kinds),
            "angle": units.find("angle", self.options.angle, kinds),
        }
        self._report_single_limit()
        rows: list[DhRow] = []
        for i, (row, kind) in enumerate(zip(self.cells.rows, kinds, strict=True)):
            self._check_number(i, row)
            rows.append(self._row(row, kind, convention))
        self._check_order(kinds)
        return DhTable(convention, rows, self.assumptions)

    def _report_single_limit(self) -> None:
        """Add an assumption if only one of the two columns of limits is there: limits need both."""
        stated = [column for column in ("lower", "upper") if column in self.columns]
        if len(stated) == 1:
            (column,) = stated
            other = "upper" if column == "lower" else "lower"
            self.assumptions.append(
                f"the column '{self.columns[column]}' is not read, because there is no column of {other} limits: the "
                "joints are unlimited."
            )

    def _check_number(self, index: int, row: TableRow) -> None:
        """Require that rows with numbers count from the first: 1, 2, 4 lacks a row."""
        if "joint" not in self.columns:
            return
        heading = self.columns["joint"]
        number = re.fullmatch(r"(?:[A-Za-z]+[ _]?)?(\d+)", plain_text(row.cells[heading]))
        first = re.fullmatch(r"(?:[A-Za-z]+[ _]?)?(\d+)", plain_text(self.cells.rows[0].cells[heading]))
        if number and first and int(number[1]) != int(first[1]) + index:
            text = f"the row of joint {int(first[1]) + index} is missing: row {index + 1} is joint {number[1]}"
            self.errors.fail(row.line, f"{text}. Write a row for each joint, in their order")

    def _check_order(self, kinds: list[str]) -> None:
        """Require that the numbers of the coordinates, as in q1 and theta_2, follow the order of the rows."""
        before = ""
        last: int | None = None
        fixed = 0
        for row, kind in zip(self.cells.rows, kinds, strict=True):
            if kind == "fixed":
                fixed += 1
                continue
            text = plain_text(row.cells[self.columns[self.moving[kind == "prismatic"]]])
            coordinate = COORDINATE.search(text)
            if coordinate is None:
                continue
            number = re.search(r"\d+", coordinate[0])
            if number is None:  # a coordinate such as q has no place in an order
                continue
            index = int(number[0])
            name = coordinate[0].strip(" *")
            if last is not None and index <= last:
                why = f"the coordinate {name} stands after {before}, but the rows are read from the base to the tool"
                self.errors.fail(
                    row.line, f"{why}. Put the rows in the order of the joints, or number the coordinates anew"
                )
            # Fixed joints may be counted too: each of them may take one number.
            if last is not None and index > last + fixed + 1:
                self.errors.fail(
                    row.line, f"the row of a joint is missing: {name} follows {before}. Write a row for each joint"
                )
            before = name
            last = index
            fixed = 0

    def _find_kinds(self) -> list[str]:
        """Return the type of each joint."""
        slide = self.moving[1]
        kinds: list[str] = []
        for row in self.cells.rows:
            turns = has_coordinate(row.cells[self.columns["theta"]])
            slides = has_coordinate(row.cells[self.columns[slide]])
            if turns and slides:
                text = f"theta and {slide} are both variables ({row.cells[self.columns['theta']]}, "
                text += f"{row.cells[self.columns[slide]]}): a joint has one. Write the number of the other"
                self.errors.fail(row.line, text)
            kind_of_coordinate = ""
            if turns:
                kind_of_coordinate = "revolute"
            elif slides:
                kind_of_coordinate = "prismatic"
            if "kind" in self.columns:
                word = row.cells[self.columns["kind"]]
                name = plain_text(word).lower().replace(" ", "")
                kind = _KIND_WORDS.get(re.sub("^jointmodel|m?dh$", "", name))
                if kind is None:
                    text = f"there is no kind of joint '{word}'; use revolute, prismatic, fixed, R, P, 0, 1 or 2"
                    self.errors.fail(row.line, text)
                if kind_of_coordinate and kind != kind_of_coordinate:
                    column = "theta" if turns else slide
                    self.errors.fail(row.line, f"the kind '{word}' contradicts the variable in {column}")
                kinds.append(kind)
            else:
                kinds.append(kind_of_coordinate or "fixed")
        if "kind" not in self.columns and set(kinds) == {"fixed"}:
            self.assumptions.append(
                "no column and no variable (q1, theta_1) states the kinds of the joints: all are hinges, and theta is "
                "their offset."
            )
            return ["revolute"] * len(kinds)
        for row, kind in zip(self.cells.rows, kinds, strict=True):
            if kind == "fixed" and "kind" not in self.columns:
                text = f"the row in line {row.line} has no coordinate, unlike others: it is a fixed joint."
                self.assumptions.append(text)
        if set(kinds) == {"fixed"}:
            self.errors.fail(self.cells.line, "all joints are fixed, so there is no mechanism")
        return kinds

    def _row(self, row: TableRow, kind: str, convention: str) -> DhRow:
        parameters = ["alpha", "theta", "d", "a"]
        if convention == "khalil":
            parameters = ["alpha", "theta", "d", "r", "b", "gamma"]
        values: dict[str, CellQuantity] = {}
        for parameter in parameters:
            values[parameter] = self._value(row, parameter)
        parallel = False
        if convention == "hayati":
            text = ""
            if "beta" in self.columns:
                text = plain_text(row.cells[self.columns["beta"]])
            parallel = text not in ("", "-")  # rows without beta are standard rows, of joints that are not parallel
            if parallel:
                values["beta"] = self._value(row, "beta")
                if values["d"].value:
                    text_of_d = row.cells[self.columns["d"]]
                    self.errors.fail(
                        row.line, f"a row of Hayati with beta has no d, but d = '{text_of_d}': write 0 or -"
                    )
                if kind == "prismatic":
                    self.errors.fail(
                        row.line, "a row of Hayati with beta is a hinge: leave beta empty ('-') for a slide"
                    )
        self._check_tree(row, convention)
        if "offset" in self.columns:
            coordinate = self.moving[kind == "prismatic"]
            offset = self._value(row, "offset", coordinate)
            constant = values[coordinate]
            values[coordinate] = CellQuantity(
                constant.value + offset.value, constant.stated_value + offset.stated_value, constant.unit
            )
        return DhRow(row.line, self._name(row), kind, values, self._limits(row, kind))

    def _check_tree(self, row: TableRow, convention: str) -> None:
        if convention != "khalil" or "antecedent" not in self.columns:
            return
        text = plain_text(row.cells[self.columns["antecedent"]])
        before = self.cells.rows.index(row)
        if text != str(before):
            why = f"the antecedent of joint {before + 1} is '{text}', but only chains are read: write {before}"
            self.errors.fail(row.line, f"{why}, or a table for each branch")

    def _name(self, row: TableRow) -> str:
        if "joint" not in self.columns:
            return ""
        text = plain_text(row.cells[self.columns["joint"]])
        return text if re.search("[A-Za-z]", text) else ""

    def _limits(self, row: TableRow, kind: str) -> tuple[float, float] | None:
        if kind == "fixed" or not {"lower", "upper"} <= set(self.columns):
            return None
        coordinate = "theta" if kind == "revolute" else "d"
        low = self._value(row, "lower", coordinate).value
        high = self._value(row, "upper", coordinate).value
        if not low < high:
            bounds = f"{row.cells[self.columns['lower']]} and {row.cells[self.columns['upper']]}"
            self.errors.fail(row.line, f"the lower limit is not below the upper limit: {bounds}")
        return low, high

    def _value(self, row: TableRow, column: str, like: str = "") -> CellQuantity:
        """Return the constant part of a cell; `like` is the parameter whose unit it has."""
        if column not in self.columns:
            return ZERO
        quantity = "length" if (like or column) in LENGTH_COLUMNS else "angle"
        unit = self.unit[quantity]
        text = row.cells[self.columns[column]]
        if column == "d" and plain_text(text) == "-" and "beta" in self.columns:
            return ZERO
        number = self._number(column, text)
        # A factor would be a gear or a reversed axis: the joint has its own coordinate, and limits and units belong
        # to that.
        if number is not None and number.factor not in (0.0, 1.0):
            why = f"{column} = '{text}': the coordinate has the factor {number.factor:g}, but must have 1"
            self.errors.fail(row.line, f"{why}. Turn the axis, or write a table of the joints without their gears")
        stated_unit = self.heading_units.get(column, unit)
        if stated_unit != unit:
            heading = self.columns[column]
            self.errors.fail(
                row.line, f"mixed units: the heading '{heading}' is in {stated_unit}, but '{text}' is in {unit}"
            )
        if number is None or not math.isfinite(number.value):
            name = self.columns[column] or column
            hint = "write a number, a multiple of pi, or for the coordinate its name, as in q1 + 90"
            self.errors.fail(row.line, f"{name} = '{text}' is not a number: {hint}")
        if number.unit and number.unit != unit:
            self.errors.fail(row.line, f"mixed units: {column} = '{text}', but the table is in {unit}")
        if number.of_pi and unit == "deg":
            self.errors.fail(
                row.line, f"mixed units: {column} = '{text}' is a multiple of pi, but the table is in degrees"
            )
        if quantity == "angle" and unit == "deg" and not number.unit and is_quarter_turn_in_rad(number.value):
            why = f"{column} = '{text}' is a quarter or half turn in rad, but the table is in degrees"
            self.errors.fail(row.line, f"mixed units: {why}. Write it in degrees, or give its unit: {text} deg")
        return CellQuantity(number.value * _UNIT_SIZES[unit], number.value, unit)

    def _number(self, column: str, text: str) -> CellNumber | None:
        """Return the number of a cell; only where the coordinate can be, its name stands for 0."""
        return cell_number(text, column in self.moving)
