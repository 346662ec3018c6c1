"""Evaluate the whole formula file after edits: how many rows are wrong, and whether rows agree only by chance.

The edited file exists while the edited formula is judged.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core.atomic import Scratch
from twin.core.errors import KinematicsError
from twin.formula.contract import Formula
from twin.robots import load_formula
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.function_source import Edit, patched
from twin.validation.explain.parameter_coincidences import coincidences, condition, returns_to_pose
from twin.validation.explain.row_deviations import Judge, worst


def source_path(formula: Formula) -> Path:
    """Return the file of a formula: that of its first equation."""
    home = formula.equations[0]
    return Path(inspect.unwrap(home.variants[home.default]).__code__.co_filename)  # type: ignore[attr-defined]


@contextmanager
def edited_formula(formula: Formula, change: Sequence[Edit]) -> Iterator[Formula | None]:
    """Yield a formula after edits of its file; None if it cannot be loaded, or if an edit is in another file.

    An edit of a left side is no edit of the file alone. The edited file exists while the context lasts: what judges the
    formula may read its statements.
    """
    path = source_path(formula)
    for edit in change:
        if edit.path != path or edit.kind == "left side":
            yield None
            return
    with Scratch() as folder:
        file = Path(folder) / "formula.py"
        file.write_text(patched(change), encoding="utf-8")
        yield _loaded(formula, file)


def _loaded(formula: Formula, file: Path) -> Formula | None:
    """Return the edited formula in a file; None if it cannot be loaded."""
    joints: list[tuple[str, bool]] = []
    for joint in formula.joints:
        joints.append((joint.name, joint.kind == "revolute"))
    try:
        return load_formula(file, formula.name, lambda: (joints, np.eye(4), None), trial=True)
    except KinematicsError:
        return None


_WORSE_FACTOR = 1.001
"""An edit is refused if the residual of a row is larger than before by this factor."""


@dataclass(frozen=True)
class FormulaState:
    """State of a whole formula after edits: number of wrong rows, and whether it holds only by chance.

    By chance means: only for the present values of equal or assumed parameters; see `parameter_coincidences`.

    Attributes:
        wrong: number of wrong rows.
        chance_condition: the condition, as "because a = b"; "" if the formula holds in general.
        is_worse: whether a row is further off than before.
        failing: the wrong rows.
    """

    wrong: int
    chance_condition: str
    is_worse: bool = False
    failing: frozenset[RowKey] = frozenset()


def is_worse(worst_before: Mapping[RowKey, float], row: RowKey, residual: float) -> bool:
    """Return whether a row disagrees more than before edits; `residual`: its worst one after them.

    `worst_before` are the worst residuals before. A row that had none does not count as worse.
    """
    before = worst_before.get(row, np.inf)
    return residual > max(1.0, _WORSE_FACTOR * before)


class FormulaStates:
    """The states of one formula after edits; each is computed once."""

    def __init__(self, judge: Judge, base: Mapping[RowKey, float]) -> None:
        """Set up for a judged formula; `base` are the worst residuals of its rows, in units of the tolerance."""
        self.judge = judge
        self.worst_before = base
        self.computed: dict[tuple[Edit, ...], FormulaState | None] = {}

    def is_known(self, change: Sequence[Edit]) -> bool:
        """Return whether the state after edits was computed before, so that `after` takes no time."""
        return tuple(change) in self.computed

    def after(self, change: Sequence[Edit]) -> FormulaState | None:
        """Return the state of the formula file after edits; None if it cannot be evaluated."""
        key = tuple(change)
        if key not in self.computed:
            self.computed[key] = self._evaluated(key)
        return self.computed[key]

    def _evaluated(self, change: Sequence[Edit]) -> FormulaState | None:
        with edited_formula(self.judge.formula, change) as formula:
            return None if formula is None else self._state(formula)

    def _state(self, formula: Formula) -> FormulaState:
        """Return the state of an edited formula, judged by the same values of the mechanism."""
        before = self.judge
        judge = Judge(formula, before.variants, before.reference, before.tolerance, before.limits)
        failing = frozenset(judge.failing_rows())
        wrong = len(failing)
        has_worse_row = False
        for place, residual in judge.residuals.items():
            has_worse_row |= is_worse(self.worst_before, place.key, worst(residual))
        conditions: list[str] = []
        for group in coincidences(judge):
            conditions.append(condition(group))
        chance = " and ".join(conditions)
        swivel = before.reference.free_parameter
        if not wrong and not chance and swivel and returns_to_pose(judge, {}) is False:
            # The rows were judged at the best value of the swivel, which need not be the formula's value.
            chance = f"for another {swivel} than that of the equations"
        return FormulaState(wrong, chance, has_worse_row, failing)
