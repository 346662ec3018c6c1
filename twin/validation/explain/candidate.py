"""Candidate edits of the equations with their residuals, and the search result for a group of rows (assignments)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.validation.explain.judge import Judge, evaluate
from twin.validation.explain.rows import Key, Step
from twin.validation.explain.source import Edit

TOKENS = ("trig", "index", "parameter", "name", "sign", "left side", "function", "number", "operator", "exponent")
"""Kinds of edits that change one token, like a misprint; these edits are ranked before edits of other kinds."""

REST = ("transpose", "order", "parenthesis", "surplus", "missing")

_ORDER = (*TOKENS, *REST)


@dataclass
class Candidate:
    """One or two edits of one equation, with the resulting residuals.

    Attributes:
        edits: one or two edits.
        extra: values of names that the edits define.
        scores: worst residual of each row that the edits change, in units of the tolerance.
        broken: whether a row that agreed with the mechanism before the edits disagrees after them.
        hollow: whether a repaired row is trivial: it agrees for any values of its symbols.
        dropped: symbols on which a repaired row no longer depends.
        changed: residuals (k, entries) of the changed rows.
        by_chance: whether the repaired rows agree only for the present values of equal or assumed parameters.
    """

    step: Step
    edits: list[Edit]
    extra: dict[str, Any]
    scores: dict[Key, float]
    broken: bool
    changed: dict[Key, Array] = field(default_factory=dict, repr=False)
    hollow: bool = False
    dropped: tuple[str, ...] = ()
    by_chance: bool = False

    def over(self, rows: Iterable[Key], base: dict[Key, float]) -> float:
        """Return the worst residual over the given rows after the edits, in units of the tolerance.

        `base` is the worst residual of each row before the edits. It is used for rows that the edits do not change.
        """
        return max(self.scores.get(k, base[k]) for k in rows)

    @property
    def serves(self) -> bool:
        """Whether the candidate may be proposed: no row becomes wrong or trivial, and rows agree not only by chance."""
        return not (self.broken or self.hollow or self.by_chance)

    @property
    def rank(self) -> tuple[int, int, int, int]:
        """Sort key for candidates that fix the same rows; the best candidate has the smallest key."""
        kinds = [_ORDER.index(e.kind) if e.kind in _ORDER else len(_ORDER) for e in self.edits]
        new_argument = sum(e.define is not None and not e.define[1] for e in self.edits)
        length = sum(abs(len(e.new) - len(e.old)) + len(e.new) + len(e.old) for e in self.edits)
        foreign = sum(e.function != self.step.source.name for e in self.edits)
        return (len(self.edits), foreign, new_argument, max(kinds) * 1000 + length)


@dataclass
class Found:
    """Search result for one group of rows: the edits that fix these rows, and the best of all other edits.

    A cure is an edited function that makes the rows agree. Different edits that result in this function are the
    readings of the cure.

    Attributes:
        rows: the rows of the group.
        cures: cures of the group; each cure is the list of its readings.
        runner_up: the best edit that does not fix the group; None if there is none.
        after, next: worst residual of the best edit and of the runner-up, in units of the tolerance.
        tried: number of evaluated edits.
        complete: whether every single edit was tried and, if no single edit is exact, every pair.
        seconds: duration of the search for pairs, in s.
    """

    rows: list[Key]
    cures: list[list[Candidate]]
    runner_up: Candidate | None
    after: float
    next: float
    tried: int
    complete: bool = True
    seconds: float = 0.0


def aliases(judge: Judge, step: Step, change: Sequence[Edit]) -> dict[str, Any] | None:
    """Return {name: value} of the new names that the edits define; None if a value cannot be computed."""
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
    """Return the residuals of the rows that edits of an equation change; None if the edits cannot be evaluated.

    Without edits, the residuals of all rows are returned. `extra` contains the values of the names that the edits
    define; None: these values are computed.
    """
    if not change:
        return {p.key: r for p, r in judge.residuals.items()}
    try:
        step = judge.step(equation)
        extra = aliases(judge, step, change) if extra is None else extra
        found = None if extra is None else evaluate(judge, step, list(change), extra)
    except (StopIteration, KinematicsError, IndexError):
        return None
    return {p.key: r for p, r in found.items()} if found else None
