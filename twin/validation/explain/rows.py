"""The rows of a formula: the place of each in the file, its expected value, and its equation."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import CodeType, FunctionType
from typing import Any

from twin.formula.contract import Equation, Stage
from twin.formula.rows import PlainRows
from twin.validation.explain.source import Source


@dataclass(frozen=True)
class Tolerance:
    """Maximum deviations that count as agreement, in m and rad."""

    length: float = 1e-9
    angle: float = 1e-8


@dataclass(frozen=True)
class Place:
    """One row: an output of an equation, at the statement that assigns or returns it."""

    equation: str
    variant: str
    statement: int
    position: int
    symbol: str
    line: int


@dataclass
class Step:
    """One equation, ready to be run statement by statement.

    `known` are its outputs that the mechanism also gives, `held` those of them by which a statement may be judged,
    `free` the values (k,) of a parameter that differs for each state (the swivel).
    """

    equation: Equation
    variant: str
    source: Source
    codes: list[CodeType]
    scope: dict[str, Any]
    inputs: tuple[str, ...]
    required: tuple[str, ...]
    missing: str = ""
    stuck: bool = False
    before: list[dict[str, Any]] = field(default_factory=list)
    computed: dict[str, Any] = field(default_factory=dict)
    gave: dict[str, Any] = field(default_factory=dict)
    known: frozenset[str] = frozenset()
    held: frozenset[str] = frozenset()
    plain: PlainRows | None = None
    lines: tuple[int, ...] = ()
    places: dict[tuple[int, int, str], Place] = field(default_factory=dict)
    free: dict[str, Any] = field(default_factory=dict)

    def place(self, statement: int, position: int, symbol: str, line: int) -> Place:
        """Return the place of a row."""
        k = (statement, position, symbol)
        if k not in self.places:
            self.places[k] = Place(self.equation.name, self.variant, statement, position, symbol, line)
        return self.places[k]

    @property
    def stage(self) -> Stage:
        """The stage of the equation."""
        return self.equation.stage


@dataclass(frozen=True)
class Helper:
    """A plain function that rows call: its source, its numeric form, and the names through which rows reach it."""

    source: Source
    function: FunctionType
