"""Rows (assignments) of a formula: equation and line of each row, and the tolerances for comparing values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import CodeType

from twin.formula.contract import Equation, Stage
from twin.formula.plain_function import PlainRows
from twin.formula.scalar import Value
from twin.validation.explain.function_source import Source


@dataclass(frozen=True)
class Tolerance:
    """Largest deviations that count as agreement, in m and rad."""

    length: float = 1e-9
    angle: float = 1e-8


RowKey = tuple[str, int, int]
"""Key of a row (assignment): (equation, statement, position)."""


@dataclass(frozen=True)
class RowPlace:
    """One row: an output of an equation, and the statement that assigns or returns it."""

    equation: str
    variant: str
    statement: int
    position: int
    symbol: str
    line: int

    @property
    def key(self) -> RowKey:
        """Key of the row, independent of the assigned symbol."""
        return self.equation, self.statement, self.position

    @property
    def name(self) -> str:
        """Equation and symbol, "eq1.X_S1"."""
        return f"{self.equation}.{self.symbol}"


@dataclass
class Step:
    """One equation, prepared to be run statement by statement.

    `missing`: the symbols without a value, or the error, if the equation cannot be judged. `stuck`: whether a statement
    uses an unknown name. `before`: the variables before each statement. `computed`: outputs of earlier equations.
    `known`: outputs for which the mechanism also has a value. `gave`: values of the outputs of this equation; known
    outputs have the mechanism's values. `held`: known outputs that the function assigns to a variable of the same name;
    these outputs are compared at the assignment. `free`: name and values (k,) of the free parameter (the swivel angle
    of a redundant mechanism), one value for each state. `without_value`: the places (statement, element of the returned
    tuple) that use an unknown name or a wrong index, element -1 for a whole statement.
    """

    equation: Equation
    variant: str
    source: Source
    codes: list[CodeType]
    scope: dict[str, Value]
    inputs: tuple[str, ...]
    required: tuple[str, ...]
    missing: str = ""
    stuck: bool = False
    without_value: frozenset[tuple[int, int]] = frozenset()
    before: list[dict[str, Value]] = field(default_factory=list)
    computed: dict[str, Value] = field(default_factory=dict)
    gave: dict[str, Value] = field(default_factory=dict)
    known: frozenset[str] = frozenset()
    held: frozenset[str] = frozenset()
    plain: PlainRows | None = None
    lines: tuple[int, ...] = ()
    places: dict[tuple[int, int, str], RowPlace] = field(default_factory=dict)
    free: dict[str, Value] = field(default_factory=dict)

    def place(self, statement: int, position: int, symbol: str, line: int) -> RowPlace:
        """Return the `RowPlace` of a row of this equation; `position` is the position of `symbol` in the statement."""
        k = (statement, position, symbol)
        if k not in self.places:
            self.places[k] = RowPlace(self.equation.name, self.variant, statement, position, symbol, line)
        return self.places[k]

    @property
    def stage(self) -> Stage:
        """Stage of the equation: "inverse", "forward" or "helper"."""
        return self.equation.stage


@dataclass(frozen=True)
class Helper:
    """A plain function that rows call: source text and numeric version of the function."""

    source: Source
    function: Callable[..., Value]
