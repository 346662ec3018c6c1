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
from typing import NamedTuple, NoReturn

from twin.core.errors import NoMechanismError, SourceError, UnsupportedError
from twin.core.units import DEG, LENGTH, MM
from twin.exchange.formats.dh.cell_numbers import (
    COORDINATE,
    UNITS,
    CellNumber,
    cell_number,
    has_coordinate,
    is_quarter_turn_in_rad,
    plain_text,
)
from twin.exchange.formats.dh.cells import Cells, TableRow, read_cells
from twin.exchange.read.imported_robot import DhOptions

CONVENTIONS = ("standard", "modified", "khalil", "hayati")

_CONVENTION_WORDS = {
    "standard": "standard",
    "classic": "standard",
    "classical": "standard",
    "distal": "standard",
    "dh": "standard",
    "sdh": "standard",
    "modified": "modified",
    "craig": "modified",
    "proximal": "modified",
    "mdh": "modified",
    "khalil": "khalil",
    "khalil-kleinfinger": "khalil",
    "hayati": "hayati",
}
"""{name of a convention: convention}; "dh" and "mdh" are those of MATLAB."""

_NEGATIONS = frozenset({"not", "no", "non", "never", "neither", "nor", "without", "unlike", "isn"})
"""Words that turn a statement of the convention into its contrary: "not modified" says nothing definite."""

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

_LENGTHS = ("a", "d", "r", "b")
_ANGLES = ("alpha", "theta", "beta", "gamma")

_LIKE_COORDINATE = ("offset", "lower", "upper")
"""Columns in the unit of the joint's coordinate."""

_UNIT_SIZES = {"mm": MM, "cm": LENGTH["cm"], "m": 1.0, "deg": DEG, "rad": 1.0}

_TURN = 2 * math.pi
"""Largest plain number in a column with multiples of pi: a larger one is in degrees."""


_POSSIBLE_UNITS = {"length": ("mm", "cm", "m"), "angle": ("deg", "rad")}
"""{quantity: its units}; the last one is that of a table of zeros."""


class _UnitStatement(NamedTuple):
    """A unit, what states it, and the line of the file where it does."""

    place: str
    unit: str
    line: int


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
    def __init__(self, path: Path, cells: Cells, options: DhOptions) -> None:
        self.path = path
        self.cells = cells
        self.options = options
        self.columns: dict[str, str] = {}
        """{column: its heading}."""
        self.heading_units: dict[str, str] = {}
        self.previous_index: set[str] = set()
        """Columns whose heading has the index of the joint before."""
        self.assumptions: list[str] = []

        self.recognised = False
        """Whether the headings are those of a table of Denavit-Hartenberg parameters."""

    def fail(self, line: int, message: str) -> NoReturn:
        """Raise an error with file and line: a `NoMechanismError` for a table of something else."""
        kind = SourceError if self.recognised else NoMechanismError
        raise kind(f"{self.path}:{line}: {message}")

    def refuse(self, line: int, message: str) -> NoReturn:
        """Raise an error for a table without a fault that does not say all that is needed."""
        kind = UnsupportedError if self.recognised else NoMechanismError
        raise kind(f"{self.path}:{line}: {message}")

    def read(self) -> DhTable:
        self._read_headings()
        if self.cells.fault:
            kind_of_error = SourceError if self.recognised else NoMechanismError
            raise kind_of_error(self.cells.fault)
        convention = self._find_convention()
        self._require_columns(convention)
        self.moving = ("theta", "r") if convention == "khalil" else ("theta", "d")
        kinds = self._find_kinds()
        self._find_units(kinds)
        rows: list[DhRow] = []
        for i, (row, kind) in enumerate(zip(self.cells.rows, kinds, strict=True)):
            self._check_number(i, row)
            rows.append(self._row(row, kind, convention))
        self._check_order(kinds)
        return DhTable(convention, rows, self.assumptions)

    def _read_headings(self) -> None:
        known_headings: list[str] = []
        for names in _HEADINGS.values():
            known_headings += names
        unknown_headings: list[str] = []
        repeated: list[str] = []
        for heading in self.cells.headings:
            name, unit, before = _split_heading(heading)
            column = None
            for candidate, names in _HEADINGS.items():
                if name in names:
                    column = candidate
            if column is None:
                unknown_headings.append(heading)
                continue
            if column in self.columns:
                text = f"the headings '{self.columns[column]}' and '{heading}' mean the same"
                if heading == self.columns[column]:
                    text = f"the heading '{heading}' stands twice"
                repeated.append(f"{text}: remove one of the columns")
                continue
            self.columns[column] = heading
            if unit:
                self.heading_units[column] = unit
            if before:
                self.previous_index.add(column)
        stated = set(self.columns)
        self.recognised = {"alpha", "theta", "d"} <= stated and not stated.isdisjoint({"a", "r"})
        if repeated:
            self.fail(self.cells.line, repeated[0])
        if unknown_headings:
            text = f"the heading '{unknown_headings[0]}' is not known: rename or remove the column. Known are "
            words = [word for word in known_headings if word not in ("", "#")]
            self.refuse(self.cells.line, text + ", ".join(words))

    def _find_convention(self) -> str:
        """Return the convention that the user, a key or the headings state; none is assumptions."""
        statements: dict[str, str] = {}
        if self.options.convention:
            statements["--dh"] = self.options.convention
        if stated := self.cells.stated.get("convention"):
            words = re.sub(r"[^a-z-]+", " ", stated.lower()).split()
            names: set[str] = set()
            for word in words:
                if word in _CONVENTION_WORDS:
                    names.add(_CONVENTION_WORDS[word])
            if not _NEGATIONS.isdisjoint(words):
                names = set()
            # "modified DH": the word beside "DH" says which
            if len(names) > 1 and "standard" not in words:
                names.discard("standard")
            if len(names) != 1:
                choice = ", ".join(CONVENTIONS)
                self.fail(self.cells.line, f"there is no convention '{stated}'; use one of {choice}")
            statements["the key `convention`"] = names.pop()
        if {"a", "alpha"} <= self.previous_index:
            statements["the index i-1 of a and alpha"] = "modified"
        if {"gamma", "b", "r"} <= set(self.columns):
            statements["the columns gamma, b and r"] = "khalil"
        if "beta" in self.columns:
            statements["the column beta"] = "hayati"
        headings = " ".join(filter(None, self.cells.headings))
        if re.fullmatch("θⱼ dⱼ aⱼ [⍺α]ⱼ.*", headings):
            statements["the headings of the Robotics Toolbox"] = "standard"
        if "kind" in self.columns:
            for row in self.cells.rows:
                name = row.cells[self.columns["kind"]].lower()
                if name.endswith("mdh"):
                    statements[f"the kind '{name}'"] = "modified"
                elif name.endswith("dh"):
                    statements[f"the kind '{name}'"] = "standard"
        if len(set(statements.values())) > 1:
            contradiction = " and ".join(f"{place} says {convention}" for place, convention in statements.items())
            self.fail(self.cells.line, f"the convention is contradictory: {contradiction}")
        if not statements:
            headings = " | ".join(self.cells.headings)
            text = (
                f"the headings ({headings}) do not say which convention the table has, and the robots would differ: "
                "state it by --dh standard (distal, Denavit-Hartenberg), --dh modified (proximal, Craig), --dh khalil "
                "or --dh hayati"
            )
            self.refuse(self.cells.line, text)
        return next(iter(statements.values()))

    def _require_columns(self, convention: str) -> None:
        """Require the columns of a convention, and no others."""
        needed = {"a", "alpha", "theta", "d"}
        optional = {"joint", "offset", "kind", "lower", "upper"}
        if convention == "khalil":
            needed = {"alpha", "theta", "d", "r"}
            optional |= {"gamma", "b", "antecedent", "mu"}
        elif convention == "hayati":
            optional.add("beta")
        if convention != "khalil" and "a" not in self.columns and "r" in self.columns:
            self.columns["a"] = self.columns.pop("r")  # some texts call the length r
            if "r" in self.heading_units:
                self.heading_units["a"] = self.heading_units.pop("r")
        missing = sorted(needed - set(self.columns))
        if missing:
            headings = " | ".join(self.cells.headings)
            text = (
                f"the {convention} convention needs the columns {', '.join(missing)}, but the headings are {headings}"
            )
            self.fail(self.cells.line, text)
        for column in self.columns:
            if column not in needed | optional:
                text = f"the {convention} convention has no column '{self.columns[column]}': remove it"
                self.fail(self.cells.line, text)

    def _find_units(self, kinds: list[str]) -> None:
        """Find the two units of the table; a second unit for lengths or for angles is an error."""
        self.unit = {
            "length": self._find_unit("length", _LENGTHS, self.options.length, kinds),
            "angle": self._find_unit("angle", _ANGLES, self.options.angle, kinds),
        }

    def _units_beside_cells(self, quantity: str, columns: tuple[str, ...], option: str | None) -> list[_UnitStatement]:
        """Return the units of a quantity that the option, the key `units` and the headings state, in this order."""
        possible = _POSSIBLE_UNITS[quantity]
        statements: list[_UnitStatement] = []
        if option:
            statements.append(_UnitStatement("--units", option, self.cells.line))
        for word in re.split(r"[,;\s]+", self.cells.stated.get("units", "")):
            unit = UNITS.get(word.lower())
            if word and unit is None:
                names = ", ".join(dict.fromkeys(UNITS.values()))
                self.fail(self.cells.line, f"units: there is no unit '{word}'; use two of {names}")
            if unit is not None and unit in possible:
                statements.append(_UnitStatement("the key `units`", unit, self.cells.line))
        for column in columns:
            unit = self.heading_units.get(column)
            if column in self.columns and unit:
                heading = f"the heading '{self.columns[column]}'"
                if unit not in possible:
                    self.fail(self.cells.line, f"{heading} has the unit {unit}, but {column} is a {quantity}")
                statements.append(_UnitStatement(heading, unit, self.cells.line))
        for column in _LIKE_COORDINATE:
            unit = self.heading_units.get(column, "")
            if unit in possible:
                statements.append(_UnitStatement(f"the heading '{self.columns[column]}'", unit, self.cells.line))
        return statements

    def _find_unit(self, quantity: str, columns: tuple[str, ...], option: str | None, kinds: list[str]) -> str:
        """Return the unit of a quantity, "length" or "angle"; all places that state one must state the same."""
        possible = _POSSIBLE_UNITS[quantity]
        statements = self._units_beside_cells(quantity, columns, option)
        unitless: list[tuple[str, float, int]] = []
        multiples: list[_UnitStatement] = []
        kind_of_unit = "prismatic" if quantity == "length" else "revolute"
        for row, kind in zip(self.cells.rows, kinds, strict=True):
            # offset and limits have the unit of the coordinate of their row
            columns_with_unit = (*columns, *_LIKE_COORDINATE) if kind == kind_of_unit else columns
            for column in columns_with_unit:
                if column not in self.columns:
                    continue
                text = row.cells[self.columns[column]]
                number = self._number(column, text)
                if number is None:
                    continue
                if number.unit:
                    if number.unit not in possible:
                        self.fail(row.line, f"{column} = '{text}' is in {number.unit}, but {column} is a {quantity}")
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
            self.refuse(line, f"{text} Give it by --units, as in --units {example}")
        first = statements[0]
        for place, unit, line in statements:
            if unit != first.unit:
                text = f"mixed units: {first.place} is in {first.unit}, but {place} in {unit}"
                self.fail(line, f"{text}. Use one unit for every {quantity}")
        if multiples and is_angle and first.place == multiples[0].place:  # only multiples of pi state the unit
            for place, value, line in unitless:
                if abs(value) > _TURN:
                    text = f"mixed units: {first.place} is in rad, but {place} is more than a turn in rad"
                    self.fail(line, f"{text}. Use one unit for every angle")
        return first.unit

    def _check_number(self, index: int, row: TableRow) -> None:
        """Require that rows with numbers count from the first: 1, 2, 4 lacks a row."""
        if "joint" not in self.columns:
            return
        heading = self.columns["joint"]
        number = re.fullmatch(r"(?:[A-Za-z]+[ _]?)?(\d+)", plain_text(row.cells[heading]))
        first = re.fullmatch(r"(?:[A-Za-z]+[ _]?)?(\d+)", plain_text(self.cells.rows[0].cells[heading]))
        if number and first and int(number[1]) != int(first[1]) + index:
            text = f"the row of joint {int(first[1]) + index} is missing: row {index + 1} is joint {number[1]}"
            self.fail(row.line, f"{text}. Write a row for each joint, in their order")

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
                self.fail(row.line, f"{why}. Put the rows in the order of the joints, or number the coordinates anew")
            # Fixed joints may be counted too: each of them may take one number.
            if last is not None and index > last + fixed + 1:
                self.fail(
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
                self.fail(row.line, text)
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
                    self.fail(row.line, text)
                if kind_of_coordinate and kind != kind_of_coordinate:
                    column = "theta" if turns else slide
                    self.fail(row.line, f"the kind '{word}' contradicts the variable in {column}")
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
            self.fail(self.cells.line, "all joints are fixed, so there is no mechanism")
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
                    self.fail(row.line, f"a row of Hayati with beta has no d, but d = '{text_of_d}': write 0 or -")
                if kind == "prismatic":
                    self.fail(row.line, "a row of Hayati with beta is a hinge: leave beta empty ('-') for a slide")
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
            self.fail(row.line, f"{why}, or a table for each branch")

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
            self.fail(row.line, f"the lower limit is not below the upper limit: {bounds}")
        return low, high

    def _value(self, row: TableRow, column: str, like: str = "") -> CellQuantity:
        """Return the constant part of a cell; `like` is the parameter whose unit it has."""
        if column not in self.columns:
            return ZERO
        quantity = "length" if (like or column) in _LENGTHS else "angle"
        unit = self.unit[quantity]
        text = row.cells[self.columns[column]]
        if column == "d" and plain_text(text) == "-" and "beta" in self.columns:
            return ZERO
        number = self._number(column, text)
        # A factor would be a gear or a reversed axis: the joint has its own coordinate, and limits and units belong
        # to that.
        if number is not None and number.factor not in (0.0, 1.0):
            why = f"{column} = '{text}': the coordinate has the factor {number.factor:g}, but must have 1"
            self.fail(row.line, f"{why}. Turn the axis, or write a table of the joints without their gears")
        stated_unit = self.heading_units.get(column, unit)
        if stated_unit != unit:
            heading = self.columns[column]
            self.fail(row.line, f"mixed units: the heading '{heading}' is in {stated_unit}, but '{text}' is in {unit}")
        if number is None or not math.isfinite(number.value):
            name = self.columns[column] or column
            hint = "write a number, a multiple of pi, or for the coordinate its name, as in q1 + 90"
            self.fail(row.line, f"{name} = '{text}' is not a number: {hint}")
        if number.unit and number.unit != unit:
            self.fail(row.line, f"mixed units: {column} = '{text}', but the table is in {unit}")
        if number.of_pi and unit == "deg":
            self.fail(row.line, f"mixed units: {column} = '{text}' is a multiple of pi, but the table is in degrees")
        if quantity == "angle" and unit == "deg" and not number.unit and is_quarter_turn_in_rad(number.value):
            why = f"{column} = '{text}' is a quarter or half turn in rad, but the table is in degrees"
            self.fail(row.line, f"mixed units: {why}. Write it in degrees, or give its unit: {text} deg")
        return CellQuantity(number.value * _UNIT_SIZES[unit], number.value, unit)

    def _number(self, column: str, text: str) -> CellNumber | None:
        """Return the number of a cell; only where the coordinate can be, its name stands for 0."""
        return cell_number(text, column in self.moving)


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
