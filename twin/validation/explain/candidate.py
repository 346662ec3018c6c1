"""An edit of the equations that was tried, and what the search has for a group of rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.validation.explain.judge import Judge, evaluate, worst
from twin.validation.explain.rows import Place, Step
from twin.validation.explain.source import Edit

TOKENS = ("trig", "index", "parameter", "name", "sign", "left side", "function", "number", "operator", "exponent")
"""Kinds of edits that change one token: what misprints usually are. Others rank behind them."""

REST = ("transpose", "order", "parenthesis", "surplus", "missing")

_ORDER = (*TOKENS, *REST)

Key = tuple[str, int, int]
"""A row whatever symbol it assigns: equation, statement, position."""


@dataclass
class Candidate:
    """Edits of one equation that were tried.

    Attributes:
        step: the equation. edits: one or two. extra: values of the aliases that they use.
        scores: worst residual by row, of the rows that it changes.
        broken: whether it harms a row that agreed.
        hollow: whether a row that it cures is left empty: true whatever its symbols are.
        dropped: symbols that a cured row depended on and does not any more.
        changed: residuals of the rows that were judged before.
    """

    step: Step
    edits: list[Edit]
    extra: dict[str, Any]
    scores: dict[Key, float]
    broken: bool
    changed: dict[Key, Array] = field(default_factory=dict, repr=False)
    hollow: bool = False
    dropped: tuple[str, ...] = ()

    def over(self, rows: Iterable[Key], base: dict[Key, float]) -> float:
        """Return the worst residual over some rows."""
        return max(self.scores.get(k, base[k]) for k in rows)

    @property
    def serves(self) -> bool:
        """Whether it may be offered: it harms no row and empties none."""
        return not self.broken and not self.hollow

    @property
    def rank(self) -> tuple[int, int, int, int]:
        """Order among edits that serve as well."""
        kinds = [_ORDER.index(e.kind) if e.kind in _ORDER else len(_ORDER) for e in self.edits]
        new_argument = sum(e.define is not None and not e.define[1] for e in self.edits)
        length = sum(abs(len(e.new) - len(e.old)) + len(e.new) + len(e.old) for e in self.edits)
        foreign = sum(e.function != self.step.source.name for e in self.edits)
        return (len(self.edits), foreign, new_argument, max(kinds) * 1000 + length)


@dataclass
class Found:
    """What the search has for one group of rows: exact candidates by way and reading, and the runner-up.

    Attributes:
        rows: the group. ways: functions that cure it, each in all its readings.
        runner_up: the edit that comes next. after, next: worst residual of the best edit, of the runner-up.
        tried: edits evaluated. complete: whether every edit, and every pair where no single one serves, was tried.
        seconds: how long pairs were searched.
    """

    rows: list[Key]
    ways: list[list[Candidate]]
    runner_up: Candidate | None
    after: float
    next: float
    tried: int
    complete: bool = True
    seconds: float = 0.0

    @property
    def credible(self) -> bool:
        """Whether one small edit cures the rows and drops nothing: then no other explanation need be sought.

        Two edits are many: one changed number that explains the same rows is the simpler explanation.
        """
        return bool(self.ways) and len(self.ways[0][0].edits) == 1 and not self.ways[0][0].dropped


def key(place: Place) -> Key:
    """Return the row of a place."""
    return place.equation, place.statement, place.position


def aliases(judge: Judge, step: Step, change: Sequence[Edit]) -> dict[str, Any] | None:
    """Return the values of names that edits bring in with a definition; None where one has no value."""
    out: dict[str, Any] = {}
    for e in change:
        if e.define and e.define[1]:
            env = dict(judge.step(step.equation.name).before[e.statement])
            try:
                with np.errstate(all="ignore"):
                    out[e.define[0]] = eval(e.define[1], env)
            except Exception:
                return None
    return out


def residuals(
    judge: Judge, equation: str, change: Sequence[Edit], extra: dict[str, Any] | None = None
) -> dict[Key, Array] | None:
    """Return the residuals of the rows that edits change, under any judge of the same formula; None if there are none.

    Without edits: those of all rows as they stand. `extra` are values of names that the edits use; default aliases.
    """
    if not change:
        return {key(p): r for p, r in judge.residuals.items()}
    try:
        step = judge.step(equation)
        extra = aliases(judge, step, change) if extra is None else extra
        found = None if extra is None else evaluate(judge, step, list(change), extra)
    except (StopIteration, KinematicsError, IndexError):
        return None
    return {key(p): r for p, r in found.items()} if found else None


def scores(changed: dict[Key, Array]) -> dict[Key, float]:
    """Return the worst residual of each row."""
    return {k: worst(r) for k, r in changed.items()}
