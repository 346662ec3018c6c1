"""Denavit-Hartenberg parameters from the texts of a table: headings, conventions, units, numbers.

The four conventions, for row i with the coordinate q in theta or d:

    standard    T = Rz(theta) Tz(d) Tx(a) Rx(alpha)                    Denavit and Hartenberg 1955, distal
    modified    T = Rx(alpha) Tx(a) Rz(theta) Tz(d)                    Craig 1986, alpha_{i-1} and a_{i-1} in row i
    khalil      T = Rz(gamma) Tz(b) Rx(alpha) Tx(d) Rz(theta) Tz(r)    Khalil and Kleinfinger 1986
    hayati      T = Rz(theta) Tx(a) Rx(alpha) Ry(beta)                 Hayati and Mirmirani 1985, rows with beta
"""

from __future__ import annotations

import ast
import math
import operator
import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from twin.core.errors import NoMechanismError, SourceError, UnsupportedError
from twin.core.units import DEG, LENGTH, MM
from twin.exchange.formats.dh.cells import Cells, TableRow, read_cells
from twin.exchange.read.source import DhOptions

CONVENTIONS = ("standard", "modified", "khalil", "hayati")

_CALLED = {
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

_KINDS = {
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

_GREEK = {"α": "alpha", "⍺": "alpha", "β": "beta", "γ": "gamma", "θ": "theta", "ϑ": "theta", "σ": "sigma", "μ": "mu"}

_LENGTHS = ("a", "d", "r", "b")
_ANGLES = ("alpha", "theta", "beta", "gamma")

_LIKE_COORDINATE = ("offset", "lower", "upper")
"""Columns in the unit of the joint's coordinate."""

_UNITS = {
    **{"mm": "mm", "millimetre": "mm", "millimeter": "mm", "cm": "cm", "m": "m", "metre": "m", "meter": "m"},
    **{"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad"},
}
"""{name of a unit: unit}."""

_SIZE = {"mm": MM, "cm": LENGTH["cm"], "m": 1.0, "deg": DEG, "rad": 1.0}

_TURN = 2 * math.pi
"""Largest plain number in a column with multiples of pi: a larger one is in degrees."""


@dataclass(frozen=True)
class CellQuantity:
    """A number of a cell.

    Attributes:
        value: its value in m or rad.
        shown: the number in the unit of the table.
        unit: the unit: "mm", "cm", "m", "deg" or "rad".
    """

    value: float
    shown: float
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
        parallel: whether the row is one of Hayati, with beta.
        limits: (lower, upper) in m or rad, or None.
    """

    line: int
    name: str
    kind: str
    values: dict[str, CellQuantity]
    parallel: bool
    limits: tuple[float, float] | None


@dataclass(frozen=True)
class DhTable:
    """A table whose convention and units are known. `guessed` says what had to be taken as usual."""

    convention: str
    rows: list[DhRow]
    guessed: list[str]


def unit_size(unit: str) -> float:
    """Return the size of the unit of a `CellQuantity` in m or rad."""
    return _SIZE[unit]


def read_table(path: Path, given: DhOptions) -> DhTable:
    """Return the table of a file.

    Raises:
        SourceError: the table cannot be read, or does not say what is needed; the message names file, line and value.
    """
    return _Reader(path, read_cells(path), given).read()


class _Reader:
    def __init__(self, path: Path, cells: Cells, given: DhOptions) -> None:
        self.path, self.cells, self.given = path, cells, given
        self.columns: dict[str, str] = {}
        """{column: its heading}."""
        self.heading_units: dict[str, str] = {}
        self.before: set[str] = set()
        """Columns whose heading has the index of the joint before."""
        self.guessed: list[str] = []

        self.recognised = False
        """Whether the headings are those of a table of Denavit-Hartenberg parameters."""

    def fail(self, line: int, message: str) -> NoReturn:
        """Raise an error with file and line: a `NoMechanismError` for a table of something else."""
        kind = SourceError if self.recognised else NoMechanismError
        raise kind(f"{self.path}:{line}: {message}")

    def lacks(self, line: int, message: str) -> NoReturn:
        """Raise an error for a table without a fault that does not say all that is needed."""
        kind = UnsupportedError if self.recognised else NoMechanismError
        raise kind(f"{self.path}:{line}: {message}")

    def read(self) -> DhTable:
        self._headings()
        if self.cells.fault:
            raise (SourceError if self.recognised else NoMechanismError)(self.cells.fault)
        convention = self._convention()
        self._require_columns(convention)
        self.moving = ("theta", "r") if convention == "khalil" else ("theta", "d")
        kinds = self._kinds()
        self._units(kinds)
        rows: list[DhRow] = []
        for i, (row, kind) in enumerate(zip(self.cells.rows, kinds, strict=True)):
            self._check_number(i, row)
            rows.append(self._row(row, kind, convention))
        self._check_order(kinds)
        return DhTable(convention, rows, self.guessed)

    def _headings(self) -> None:
        known: list[str] = []
        for names in _HEADINGS.values():
            known += names
        strange: list[str] = []
        repeated: list[str] = []
        for heading in self.cells.headings:
            name, unit, before = _bare(heading)
            column = None
            for candidate, names in _HEADINGS.items():
                if name in names:
                    column = candidate
            if column is None:
                strange.append(heading)
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
                self.before.add(column)
        stated = set(self.columns)
        self.recognised = {"alpha", "theta", "d"} <= stated and not stated.isdisjoint({"a", "r"})
        if repeated:
            self.fail(self.cells.line, repeated[0])
        if strange:
            text = f"the heading '{strange[0]}' is not known: rename or remove the column. Known are "
            self.lacks(self.cells.line, text + ", ".join(n for n in known if n and n != "#"))

    def _convention(self) -> str:
        """Return the convention that the user, a key or the headings state; none is guessed."""
        said: dict[str, str] = {}
        if self.given.convention:
            said["--dh"] = self.given.convention
        if stated := self.cells.stated.get("convention"):
            word = re.sub(r"[^a-z-]+", " ", stated.lower()).split()
            names = {_CALLED[w] for w in word if w in _CALLED}
            if not _NEGATIONS.isdisjoint(word):
                names = set()
            # "modified DH": the word beside it says which
            names = names - {"standard"} if len(names) > 1 and "standard" not in word else names
            if len(names) != 1:
                choice = ", ".join(CONVENTIONS)
                self.fail(self.cells.line, f"there is no convention '{stated}'; use one of {choice}")
            said["the key `convention`"] = names.pop()
        if {"a", "alpha"} <= self.before:
            said["the index i-1 of a and alpha"] = "modified"
        if {"gamma", "b", "r"} <= set(self.columns):
            said["the columns gamma, b and r"] = "khalil"
        if "beta" in self.columns:
            said["the column beta"] = "hayati"
        if re.fullmatch("θⱼ dⱼ aⱼ [⍺α]ⱼ.*", " ".join(h for h in self.cells.headings if h)):
            said["the headings of the Robotics Toolbox"] = "standard"
        if "kind" in self.columns:
            for row in self.cells.rows:
                name = row.cells[self.columns["kind"]].lower()
                if name.endswith("mdh"):
                    said[f"the kind '{name}'"] = "modified"
                elif name.endswith("dh"):
                    said[f"the kind '{name}'"] = "standard"
        if len(set(said.values())) > 1:
            rows = " and ".join(f"{who} says {what}" for who, what in said.items())
            self.fail(self.cells.line, f"the convention is contradictory: {rows}")
        if not said:
            headings = " | ".join(self.cells.headings)
            text = (
                f"the headings ({headings}) do not say which convention the table has, and the robots would differ: "
                "state it by --dh standard (distal, Denavit-Hartenberg), --dh modified (proximal, Craig), --dh khalil "
                "or --dh hayati"
            )
            self.lacks(self.cells.line, text)
        return next(iter(said.values()))

    def _require_columns(self, convention: str) -> None:
        needed = {"alpha", "theta", "d", "r"} if convention == "khalil" else {"a", "alpha", "theta", "d"}
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
        allowed = {"joint", "offset", "kind", "lower", "upper", *needed}
        allowed |= {"gamma", "b", "antecedent", "mu"} if convention == "khalil" else set()
        allowed |= {"beta"} if convention == "hayati" else set()
        for column in self.columns:
            if column not in allowed:
                text = f"the {convention} convention has no column '{self.columns[column]}': remove it"
                self.fail(self.cells.line, text)

    def _units(self, kinds: list[str]) -> None:
        """Find the two units of the table; a second unit for lengths or for angles is an error."""
        self.unit = {
            "length": self._unit("length", _LENGTHS, self.given.length, kinds),
            "angle": self._unit("angle", _ANGLES, self.given.angle, kinds),
        }

    def _unit(self, what: str, columns: tuple[str, ...], given: str | None, kinds: list[str]) -> str:
        of_kind = ("mm", "cm", "m") if what == "length" else ("deg", "rad")
        said: list[tuple[str, str, int]] = []
        if given:
            said.append(("--units", given, self.cells.line))
        for word in re.split(r"[,;\s]+", self.cells.stated.get("units", "")):
            unit = _UNITS.get(word.lower())
            if word and unit is None:
                names = ", ".join(dict.fromkeys(_UNITS.values()))
                self.fail(self.cells.line, f"units: there is no unit '{word}'; use two of {names}")
            if unit is not None and unit in of_kind:
                said.append(("the key `units`", unit, self.cells.line))
        for column in columns:
            unit = self.heading_units.get(column)
            if column in self.columns and unit:
                if unit not in of_kind:
                    text = f"the heading '{self.columns[column]}' has the unit {unit}, but {column} is a {what}"
                    self.fail(self.cells.line, text)
                said.append((f"the heading '{self.columns[column]}'", unit, self.cells.line))
        for column in _LIKE_COORDINATE:
            unit = self.heading_units.get(column, "")
            if unit in of_kind:
                said.append((f"the heading '{self.columns[column]}'", unit, self.cells.line))
        plain: list[tuple[str, float, int]] = []
        multiples: list[tuple[str, str, int]] = []
        kind_of_unit = "prismatic" if what == "length" else "revolute"
        for row, kind in zip(self.cells.rows, kinds, strict=True):
            # offset and limits have the unit of the coordinate of their row
            stated_here = (*columns, *_LIKE_COORDINATE) if kind == kind_of_unit else columns
            for column in stated_here:
                if column not in self.columns:
                    continue
                text = row.cells[self.columns[column]]
                found = self._parsed(column, text)
                if found is None:
                    continue
                if found.unit:
                    if found.unit not in of_kind:
                        self.fail(row.line, f"{column} = '{text}' is in {found.unit}, but {column} is a {what}")
                    said.append((f"{column} = '{text}'", found.unit, row.line))
                elif found.of_pi:
                    multiples.append((f"{column} = '{text}'", "rad", row.line))
                elif found.value:
                    plain.append((f"{column} = '{text}'", found.value, row.line))
        if multiples and what == "angle":
            said.append(multiples[0])
        for who, unit, line in said:
            if unit != said[0][1]:
                text = (
                    f"mixed units: {said[0][0]} is in {said[0][1]}, but {who} in {unit}. Use one unit for every {what}"
                )
                self.fail(line, text)
        if multiples and what == "angle":
            for who, value, line in plain:
                if said[0][0] == multiples[0][0] and abs(value) > _TURN:
                    text = f"mixed units: {multiples[0][0]} is in rad, but {who} is more than a turn in rad"
                    self.fail(line, f"{text}. Use one unit for every angle")
        if said:
            return said[0][1]
        if plain:
            units = " or ".join(of_kind)
            example = "mm,deg" if what == "length" else "m,rad"
            text = f"the unit of {what}s ({plain[0][0]}) is not stated: {units}?"
            self.lacks(plain[0][2], f"{text} Give it by --units, as in --units {example}")
        return of_kind[-1]

    def _check_number(self, i: int, row: TableRow) -> None:
        """Require that rows with numbers count from the first: 1, 2, 4 lacks a row."""
        if "joint" not in self.columns:
            return
        heading = self.columns["joint"]
        number = re.fullmatch(r"(?:[A-Za-z]+[ _]?)?(\d+)", _plain(row.cells[heading]))
        first = re.fullmatch(r"(?:[A-Za-z]+[ _]?)?(\d+)", _plain(self.cells.rows[0].cells[heading]))
        if number and first and int(number[1]) != int(first[1]) + i:
            text = f"the row of joint {int(first[1]) + i} is missing: row {i + 1} is joint {number[1]}"
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
            text = _plain(row.cells[self.columns[self.moving[kind == "prismatic"]]])
            coordinate = _VARIABLE.search(text)
            number = re.search(r"\d+", coordinate[0]) if coordinate else None
            if number is None:
                continue
            index = int(number[0])
            name = coordinate[0].strip(" *") if coordinate else ""
            if last is not None and index <= last:
                why = f"the coordinate {name} stands after {before}, but the rows are read from the base to the tool"
                self.fail(row.line, f"{why}. Put the rows in the order of the joints, or number the coordinates anew")
            if last is not None and index > last + fixed + 1:
                self.fail(
                    row.line, f"the row of a joint is missing: {name} follows {before}. Write a row for each joint"
                )
            before = name
            last = index
            fixed = 0

    def _kinds(self) -> list[str]:
        """Return the type of each joint."""
        slide = self.moving[1]
        kinds: list[str] = []
        for row in self.cells.rows:
            turns = _is_variable(row.cells[self.columns["theta"]])
            slides = _is_variable(row.cells[self.columns[slide]])
            if turns and slides:
                text = f"theta and {slide} are both variables ({row.cells[self.columns['theta']]}, "
                text += f"{row.cells[self.columns[slide]]}): a joint has one. Write the number of the other"
                self.fail(row.line, text)
            marked = "revolute" if turns else "prismatic" if slides else ""
            if "kind" in self.columns:
                word = row.cells[self.columns["kind"]]
                name = _plain(word).lower().replace(" ", "")
                kind = _KINDS.get(re.sub("^jointmodel|m?dh$", "", name))
                if kind is None:
                    text = f"there is no kind of joint '{word}'; use revolute, prismatic, fixed, R, P, 0, 1 or 2"
                    self.fail(row.line, text)
                if marked and kind != marked:
                    text = f"the kind '{word}' contradicts the variable in {'theta' if turns else slide}"
                    self.fail(row.line, text)
                kinds.append(kind)
            else:
                kinds.append(marked or "fixed")
        if "kind" not in self.columns and set(kinds) == {"fixed"}:
            self.guessed.append(
                "no column and no variable (q1, theta_1) states the kinds of the joints: all are hinges, and theta is "
                "their offset."
            )
            return ["revolute"] * len(kinds)
        for row, kind in zip(self.cells.rows, kinds, strict=True):
            if kind == "fixed" and "kind" not in self.columns:
                text = f"the row in line {row.line} has no coordinate, unlike others: it is a fixed joint."
                self.guessed.append(text)
        if set(kinds) == {"fixed"}:
            self.fail(self.cells.line, "all joints are fixed, so there is no mechanism")
        return kinds

    def _row(self, row: TableRow, kind: str, convention: str) -> DhRow:
        parameters = ["alpha", "theta", "d"]
        parameters += ["r", "b", "gamma"] if convention == "khalil" else ["a"]
        values: dict[str, CellQuantity] = {}
        for parameter in parameters:
            values[parameter] = self._value(row, parameter)
        parallel = False
        if convention == "hayati":
            text = _plain(row.cells[self.columns["beta"]]) if "beta" in self.columns else ""
            parallel = text not in ("", "-")
            if parallel:
                values["beta"] = self._value(row, "beta")
                if values["d"].value:
                    shown = row.cells[self.columns["d"]]
                    self.fail(row.line, f"a row of Hayati with beta has no d, but d = '{shown}': write 0 or -")
                if kind == "prismatic":
                    self.fail(row.line, "a row of Hayati with beta is a hinge: leave beta empty ('-') for a slide")
        self._check_tree(row, convention)
        if "offset" in self.columns:
            moved = self.moving[kind == "prismatic"]
            offset = self._value(row, "offset", moved)
            own = values[moved]
            values[moved] = CellQuantity(own.value + offset.value, own.shown + offset.shown, own.unit)
        return DhRow(row.line, self._name(row), kind, values, parallel, self._limits(row, kind))

    def _check_tree(self, row: TableRow, convention: str) -> None:
        if convention != "khalil" or "antecedent" not in self.columns:
            return
        text = _plain(row.cells[self.columns["antecedent"]])
        before = self.cells.rows.index(row)
        if text != str(before):
            why = f"the antecedent of joint {before + 1} is '{text}', but only chains are read: write {before}"
            self.fail(row.line, f"{why}, or a table for each branch")

    def _name(self, row: TableRow) -> str:
        if "joint" not in self.columns:
            return ""
        text = _plain(row.cells[self.columns["joint"]])
        return text if re.search("[A-Za-z]", text) else ""

    def _limits(self, row: TableRow, kind: str) -> tuple[float, float] | None:
        if kind == "fixed" or not {"lower", "upper"} <= set(self.columns):
            return None
        like = "theta" if kind == "revolute" else "d"
        low = self._value(row, "lower", like).value
        high = self._value(row, "upper", like).value
        if not low < high:
            shown = f"{row.cells[self.columns['lower']]} and {row.cells[self.columns['upper']]}"
            self.fail(row.line, f"the lower limit is not below the upper limit: {shown}")
        return low, high

    def _value(self, row: TableRow, column: str, like: str = "") -> CellQuantity:
        """Return the constant part of a cell; `like` is the parameter whose unit it has."""
        if column not in self.columns:
            return ZERO
        what = "length" if (like or column) in _LENGTHS else "angle"
        unit = self.unit[what]
        text = row.cells[self.columns[column]]
        if column == "d" and _plain(text) == "-" and "beta" in self.columns:
            return ZERO
        found = self._parsed(column, text)
        if found is not None and found.factor not in (0.0, 1.0):
            why = f"{column} = '{text}': the coordinate has the factor {found.factor:g}, but must have 1"
            self.fail(row.line, f"{why}. Turn the axis, or write a table of the joints without their gears")
        stated_unit = self.heading_units.get(column, unit)
        if stated_unit != unit:
            heading = self.columns[column]
            self.fail(row.line, f"mixed units: the heading '{heading}' is in {stated_unit}, but '{text}' is in {unit}")
        if found is None or not math.isfinite(found.value):
            name = self.columns[column] or column
            hint = "write a number, a multiple of pi, or for the coordinate its name, as in q1 + 90"
            self.fail(row.line, f"{name} = '{text}' is not a number: {hint}")
        if found.unit and found.unit != unit:
            self.fail(row.line, f"mixed units: {column} = '{text}', but the table is in {unit}")
        if found.of_pi and unit == "deg":
            self.fail(row.line, f"mixed units: {column} = '{text}' is a multiple of pi, but the table is in degrees")
        if what == "angle" and unit == "deg" and not found.unit and _is_quarter_in_rad(found.value):
            why = f"{column} = '{text}' is a quarter or half turn in rad, but the table is in degrees"
            self.fail(row.line, f"mixed units: {why}. Write it in degrees, or give its unit: {text} deg")
        return CellQuantity(found.value * _SIZE[unit], found.value, unit)

    def _parsed(self, column: str, text: str) -> _Number | None:
        """Return the number of a cell; only where the coordinate can be, its name stands for 0."""
        return _parsed(text, column in self.moving)


def _is_quarter_in_rad(value: float) -> bool:
    """Return whether a number is a quarter or half turn in rad, written with three digits or more."""
    return any(abs(abs(value) - turn) < 3e-4 for turn in (0.5 * math.pi, math.pi))


@dataclass(frozen=True)
class _Number:
    """A constant, its unit or "", whether it is a multiple of pi, the factor of the coordinate (0: there is none)."""

    value: float
    unit: str
    of_pi: bool
    factor: float


_SUBSCRIPTS = str.maketrans("₀₁₂₃₄₅₆₇₈₉₊₋ⱼᵢ⁻⁺", "0123456789+-ji-+")


_SUPERSCRIPT = re.compile("(?<=[0-9])([⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
"""An exponent: 10⁻³. After another sign, as in q⁻, it is a part of a name."""


def _power(found: re.Match[str]) -> str:
    exponent = unicodedata.normalize("NFKC", found[1]).replace("−", "-")
    return f"**({exponent})"


def _plain(text: str) -> str:
    """Return a text without the marks of LaTeX and Markdown, with ASCII signs and the names of Greek letters."""
    text = _SUPERSCRIPT.sub(_power, text)
    text = text.translate(_SUBSCRIPTS)
    for letter, name in _GREEK.items():
        text = text.replace(letter, name)
    text = unicodedata.normalize("NFKC", text)
    text = re.sub(r"\\(?:[dt]?frac)\{([^{}]*)\}\{([^{}]*)\}", r"((\1)/(\2))", text)
    text = re.sub(r"\\(?:mathrm|text|textbf|mathbf|textit|bm|boldsymbol|rm|operatorname)\s*\{([^{}]*)\}", r"\1", text)
    text = re.sub(r"\\sqrt\{([^{}]*)\}", r"sqrt(\1)", text)
    text = re.sub(r"\^\s*\{?\s*(?:\\circ|\\degree|∘|o)\s*\}?|\\degree|\\si\{\\degree\}|[º˚]", "°", text)
    text = re.sub(r"\\(?:cdot|times)", "*", text)
    text = text.replace("\\varepsilon", "").replace("\\vartheta", "theta").replace("\\,", " ").replace("\\ ", " ")
    text = re.sub(r"\\(alpha|beta|gamma|theta|sigma|mu|pi)", r"\1", text).replace("π", "pi").replace("·", "*")
    text = re.sub("[−–—‐‑]", "-", text).replace("×", "*").replace("÷", "/")
    text = re.sub(r"\\[a-zA-Z]+|[${}`\\]", "", text).strip()
    text = re.sub(r"(?<=10)\s*\^\s*\(?\s*([+-]?\d+)\s*\)?", r"**(\1)", text)
    bold = re.fullmatch(r"\*\*([^*].*?)\*\*", text)
    return bold[1].strip() if bold else text


def _bare(heading: str) -> tuple[str, str, bool]:
    """Return (name without index and unit, unit or "", whether the index is that of the joint before)."""
    text = _plain(heading)
    unit = ""
    found = re.search(r"[\[(/,]\s*([A-Za-z°]+)\s*[\])]?\s*$", text) or re.search(r"[_\s](mm|cm|m|deg|rad)$", text)
    if found and found[1].lower() in _UNITS and found.start():
        unit = _UNITS[found[1].lower()]
        text = text[: found.start()]
    text = re.sub(r"[\s_]+", "", text).lower()
    before = re.search(r"(?<=.)\(?[ijkn]-1\)?$", text)
    if before:
        return text[: before.start()], unit, True
    if text in _every_heading():
        return text, unit, False
    return re.sub(r"(?<=.)\(?[ijkn]\)?$", "", text), unit, False


def _every_heading() -> set[str]:
    return {name for names in _HEADINGS.values() for name in names}


_VARIABLE = re.compile(
    r"(?<![\w.])(?:q|theta|d|r)_?\s*\(?(?:\d+|[ij])\)?\s*\*?(?:\(t\))?|(?<![\w.])(?:q|theta|var|variable)\b|^\*$"
)
"""The coordinate of a joint in a cell: q1, theta_1, d3*, q."""


def _is_variable(text: str) -> bool:
    return _VARIABLE.search(_plain(text)) is not None


_OPERATORS: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


_CODE = re.compile(r"\d_\d|(?<![\w.])0[xobXOB]")
"""Numbers of Python that no paper prints: 1_0, 0x10."""


def _parsed(text: str, moving: bool) -> _Number | None:
    """Return the number of a cell, and if `moving`, the factor of its coordinate; None if it is not a number.

    The number of "q1 + pi/2" is pi/2.
    """
    rest = _plain(text)
    if moving:
        rest = _VARIABLE.sub(" COORDINATE ", rest, count=1)
    unit = ""
    found = re.search(r"(?<=[\d.)\s])\s*(mm|cm|m|deg|degrees|rad|°)$", rest) or re.search("°", rest)
    if found:
        unit = _UNITS[found[0].strip().lower()]
        rest = rest.replace("°", "") if found[0].strip() == "°" else rest[: found.start()]
    of_pi = "pi" in rest.lower()
    rest = re.sub(r"(?<=\d)\s*(?=pi)", "*", rest.strip(), flags=re.IGNORECASE)
    if not rest or len(rest) > 100 or _CODE.search(rest):
        return None
    try:
        values: list[float] = []
        for coordinate in ("0", "1", "2"):
            with_coordinate = rest.replace("COORDINATE", coordinate).strip()
            values.append(_evaluated(ast.parse(with_coordinate, mode="eval").body))
        factor = values[1] - values[0]
        if values[2] - values[1] != factor:
            return None
        return _Number(values[0], unit, of_pi, round(factor, 9))
    except (SyntaxError, ValueError, ZeroDivisionError, OverflowError, RecursionError, MemoryError):
        return None


def _evaluated(node: ast.expr) -> float:
    """Return the value of numbers, pi, sqrt(), signs, the four operations and powers of ten.

    Raises:
        ValueError: it is another expression.
    """
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value)
    if isinstance(node, ast.Name) and node.id.lower() == "pi":
        return math.pi
    if isinstance(node, ast.Attribute) and node.attr == "pi":  # np.pi, math.pi
        return math.pi
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_evaluated(node.operand)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd):
        return _evaluated(node.operand)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        exponent = _evaluated(node.right)
        # only powers of ten are a way to print a number
        if _evaluated(node.left) != 10.0 or abs(exponent) > 30 or exponent != int(exponent):
            raise ValueError
        return float(f"1e{int(exponent)}")
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_evaluated(node.left), _evaluated(node.right))
    if (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "sqrt"
        and len(node.args) == 1
    ):
        return math.sqrt(_evaluated(node.args[0]))
    raise ValueError
