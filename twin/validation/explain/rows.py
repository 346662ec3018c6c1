"""The rows of a formula: where each is, what it is judged by, and the equation that it belongs to."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import CodeType, FunctionType
from typing import Any

from twin.formula.contract import Equation, Stage
from twin.formula.rows import PlainRows
from twin.validation.explain.source import Source


@dataclass(frozen=True)
class Tolerance:
    """What counts as agreement: m, rad."""

    length: float = 1e-9
    angle: float = 1e-8


@dataclass(frozen=True)
class Place:
    """One row: an output of an equation, where it is assigned or returned."""

    equation: str
    variant: str
    statement: int
    position: int
    symbol: str
    line: int


@dataclass
class Step:
    """One equation, ready to be run statement by statement.

    `known` are its outputs that the mechanism knows, `held` those of them that a statement may be judged by, `free` the
    values (k,) of a parameter that each state has its own of.
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
    """A plain function that rows call: its source, its numeric form, the names of what leads to it."""

    source: Source
    function: FunctionType
