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

    Attributes:
        equation, variant, source: the equation, the judged variant of it, and the text of this variant's function.
        codes: the compiled statements of the function.
        scope: globals with which the statements run, see `Rebuilder.scope`.
        inputs, required: arguments of the function, and those of them without a default.
        missing: the symbols without a value, or the error, if the equation cannot be judged; else "".
        stuck: whether a statement uses an unknown name.
        without_value: the places (statement, element of the returned tuple) that use an unknown name or a wrong index;
            element -1 stands for a whole statement.
        before: the variables before each statement.
        computed: outputs of earlier equations.
        output_values: outputs of this equation; known outputs have the mechanism's values.
        known_outputs: outputs for which the mechanism also has a value.
        compared_variables: known outputs that the function assigns to a variable of the same name. They are compared at
            the assignment, the other known outputs at the return.
        plain_function: description of a function without printed rows; None for an equation with rows.
        lines: line of each output in the return statement.
        places: the rows by (statement, position, symbol).
        swivel: name and values (k,) of the free parameter of a redundant mechanism; empty for other mechanisms.
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
    output_values: dict[str, Value] = field(default_factory=dict)
    known_outputs: frozenset[str] = frozenset()
    compared_variables: frozenset[str] = frozenset()
    plain_function: PlainRows | None = None
    lines: tuple[int, ...] = ()
    places: dict[tuple[int, int, str], RowPlace] = field(default_factory=dict)
    swivel: dict[str, Value] = field(default_factory=dict)

    def place(self, statement: int, position: int, symbol: str, line: int) -> RowPlace:
        """Return the `RowPlace` of a row of this equation; `position` is the position of `symbol` in the statement."""
        # One object for each row: `Judge.residuals` is keyed by them, and trials look rows up thousands of times.
        row = (statement, position, symbol)
        if row not in self.places:
            self.places[row] = RowPlace(self.equation.name, self.variant, statement, position, symbol, line)
        return self.places[row]

    @property
    def stage(self) -> Stage:
        """Stage of the equation: "inverse", "forward" or "helper"."""
        return self.equation.stage


@dataclass(frozen=True)
class Helper:
    """A plain function that rows call: source text and numeric version of the function."""

    source: Source
    function: Callable[..., Value]
