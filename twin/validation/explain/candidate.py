"""Edits of the equations that were tried, and the search result for a group of rows (assignments of equations)."""

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
"""Kinds of edits that change one token, as misprints do. Other kinds have a lower rank."""

REST = ("transpose", "order", "parenthesis", "surplus", "missing")

_ORDER = (*TOKENS, *REST)

Key = tuple[str, int, int]
"""Key of a row, independent of the symbol it assigns: (equation, statement, position)."""


@dataclass
class Candidate:
    """One or two edits of one equation that were tried.

    Attributes:
        step: the equation.
        edits: one or two.
        extra: values of the aliases that the edits use.
        scores: worst residual of each row that the edits change.
        broken: whether a row that agreed now disagrees.
        hollow: whether a fixed row becomes empty (true for any values of its symbols).
        dropped: symbols that a fixed row no longer depends on.
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
        """Return the worst residual over the given rows."""
        return max(self.scores.get(k, base[k]) for k in rows)

    @property
    def serves(self) -> bool:
        """Whether the candidate may be proposed: it breaks no row and makes none empty."""
        return not self.broken and not self.hollow

    @property
    def rank(self) -> tuple[int, int, int, int]:
        """Rank among equally good candidates."""
        kinds = [_ORDER.index(e.kind) if e.kind in _ORDER else len(_ORDER) for e in self.edits]
        new_argument = sum(e.define is not None and not e.define[1] for e in self.edits)
        length = sum(abs(len(e.new) - len(e.old)) + len(e.new) + len(e.old) for e in self.edits)
        foreign = sum(e.function != self.step.source.name for e in self.edits)
        return (len(self.edits), foreign, new_argument, max(kinds) * 1000 + length)


@dataclass
class Found:
    """Search result for one group of rows: exact candidates, and the runner-up.

    A way is a function that fixes the rows; its readings are different edits that make this function.

    Attributes:
        rows: the group.
        cures: functions that fix the group, each with all its readings.
        runner_up: the best edit that is not exact.
        after, next: worst residual of the best edit, and of the runner-up.
        tried: number of edits evaluated.
        complete: whether every edit, and every pair if no single edit is exact, was tried.
        seconds: duration of the search for pairs.
    """

    rows: list[Key]
    cures: list[list[Candidate]]
    runner_up: Candidate | None
    after: float
    next: float
    tried: int
    complete: bool = True
    seconds: float = 0.0

    @property
    def credible(self) -> bool:
        """Whether one small edit fixes the rows and drops no symbol, so that the search can stop.

        Two edits are not enough to stop: one changed number that explains the same rows is simpler.
        """
        return bool(self.cures) and len(self.cures[0][0].edits) == 1 and not self.cures[0][0].dropped


def key(place: Place) -> Key:
    """Return the key of the row at a place."""
    return place.equation, place.statement, place.position


def aliases(judge: Judge, step: Step, change: Sequence[Edit]) -> dict[str, Any] | None:
    """Return the values of names that edits introduce with a definition; None if a name has no value."""
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
    """Return the residuals of the rows that edits change, by any judge of the same formula; None if there are none.

    Without edits: the residuals of all unchanged rows. `extra` are values of names that the edits use; default:
    aliases.
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
