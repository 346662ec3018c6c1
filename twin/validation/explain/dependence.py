"""Measure on which symbols the rows depend, to reject repairs that make a row trivial.

If a row has its unknown on the right side (q1 = ... q2 - q1 ...), an edit can make the row trivial: q1 = q1, or a copy
of another row. Such a row always agrees, and so does a row with a zero factor. Residuals at the mechanism's poses do
not reveal these edits. Therefore, one symbol at a time is perturbed, and the change of the residuals is observed. What
copies other rows is found by `determined_unknowns`.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Sequence

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.candidate import Candidate, edited_residuals
from twin.validation.explain.determined_unknowns import DeterminedUnknowns
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.function_source import Edit, Source
from twin.validation.explain.rebuilt_functions import Matrix
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.tokens import names_in

_RELATIVE_PERTURBATION = 1e-3
"""Relative perturbation of a symbol, to test whether a row depends on the symbol."""

_RESIDUAL_ROUNDING = 1e-9
"""Largest change of a residual that counts as rounding, relative to the larger of the residual and the tolerance."""


class Dependence:
    """Dependence of the rows of a formula on symbols, at the mechanism's poses and at other values."""

    def __init__(self, judge: Judge, perturbed_judge: Judge) -> None:
        """Store the judge, and a judge of the same formula at perturbed values that no mechanism has."""
        self.judge = judge
        self.base_judges = (judge, perturbed_judge)
        self._perturbed: dict[tuple[int, str, frozenset[str], str], Judge] = {}
        """Judges with one symbol perturbed, by index of the base, equation, judged equations, and symbol."""
        self._unknowns = DeterminedUnknowns(judge)
        self._symbol = {place.key: place.symbol for place in judge.residuals}
        self._symbols_read: dict[tuple[str, RowKey], set[str]] = {}
        """Symbols on which an unedited row depends, by equation in which the edits are, and row."""

    def judge_dependence(self, candidate: Candidate, rows: Collection[RowKey]) -> None:
        """Set `is_trivial` and `dropped` of a candidate that repairs `rows`; see `Candidate`.

        For example, the two edits of `q1 = Z - l_2 * sin(q2)` to `q1 = q1 - 0 * sin(q2)` agree at every pose. The
        residual of the row depended on Z, l_2 and q2, and depends on no symbol after the edits: it is trivial, and all
        three are dropped. Where an edited row does not determine its unknown, `dropped` stays as it is.
        """
        if not rows:
            return
        for row in rows:
            if not (self._returns_own(candidate, row) or self._unknowns.determines(candidate, row)):
                candidate.is_trivial = True
                return
        after = self._symbols_of(candidate.step, candidate.edits, rows)
        dropped: set[str] = set()
        trivial = False
        for row in rows:
            before = self.symbols_read(candidate.step, row, rows)
            if self._returns_own(candidate, row):
                after[row].add(self._symbol[row])
            dropped |= before - after[row]
            if before and not after[row]:
                trivial = True
        candidate.dropped = tuple(sorted(dropped))
        # A symbol that is still in the text but has no effect was multiplied by zero or cancelled. A single edit may
        # correctly restore a zero that was misprinted; for two edits this is not credible.
        if len(candidate.edits) > 1 and not dropped <= _replaced_symbols(candidate):
            trivial = True
        candidate.is_trivial = trivial

    def _returns_own(self, candidate: Candidate, row: RowKey) -> bool:
        """Return whether an edited return statement gives a symbol that another row computes and that is judged there.

        Such a row always agrees, because the symbol has the mechanism's value; it is not trivial.
        """
        equation, index, position = row
        symbol = self._symbol[row]
        statement = candidate.step.source.statements[index]
        if equation != candidate.step.equation.name or not statement.returns:
            return False
        edits: list[Edit] = []
        for edit in candidate.edits:
            if edit.function == candidate.step.source.name and edit.statement == index:
                edits.append(edit)
        if not edits:
            return False
        text = candidate.step.source.edited(statement, edits)
        value = ast.parse(f"({text.removeprefix('return').strip()}\n)", mode="eval").body
        if isinstance(value, ast.Tuple | ast.List):
            value = value.elts[position]
        if not isinstance(value, ast.Name) or value.id != symbol:
            return False
        for place in self.judge.residuals:
            if place.equation == equation and place.symbol == symbol and place.statement < index:
                return True
        return False

    def symbols_read(self, step: Step, row: RowKey, rows: Collection[RowKey] = ()) -> set[str]:
        """Return the symbols on which an unedited row depends; `rows`: further rows to evaluate in the same run."""
        name = step.equation.name
        if (name, row) not in self._symbols_read:
            for evaluated_row, symbols in self._symbols_of(step, (), {row, *rows}).items():
                self._symbols_read[name, evaluated_row] = symbols
        return self._symbols_read[name, row]

    # -- symbols of rows ----------------------------------------------------------------------------------------

    def _symbols_of(self, step: Step, change: Sequence[Edit], rows: Collection[RowKey]) -> dict[RowKey, set[str]]:
        """Return {row: symbols on which the row depends} after the edits `change`; no edits: the original rows."""
        name = step.equation.name
        equations = frozenset({name})
        for row in rows:
            if row[0] != name:  # rows of later equations depend on symbols through this equation
                equations = frozenset(equations_from(self.judge, self.judge.step(name)))
        # An output that a later row uses is also a symbol of that row, with the mechanism's value.
        symbols = list(step.inputs)
        for output in step.equation.outputs:
            if output in step.compared_variables and output not in step.inputs:
                symbols.append(output)
        symbols_of_row: dict[RowKey, set[str]] = {}
        for row in rows:
            symbols_of_row[row] = set()
        for i, base in enumerate(self.base_judges):
            before = edited_residuals(base, name, change)
            if before is None:
                continue
            for symbol in symbols:
                judge = self._with_perturbed(i, step, equations, symbol)
                if judge is None:
                    continue
                after = edited_residuals(judge, name, change)
                if after is None:
                    continue
                for row in rows:
                    if symbol == self._symbol[row] and symbol not in step.inputs:
                        continue  # the symbol is the left side
                    if symbol in symbols_of_row[row] or row not in before or row not in after:
                        continue
                    if _differ(before[row], after[row]):
                        symbols_of_row[row].add(symbol)
        return symbols_of_row

    def _with_perturbed(self, i: int, step: Step, equations: frozenset[str], symbol: str) -> Judge | None:
        """Return a judge of the given equations with one symbol perturbed; None if the symbol has no value.

        `i` is the index of the judge in `base_judges` whose other values it has.
        """
        key = (i, step.equation.name, equations, symbol)
        if key not in self._perturbed:
            base = self.base_judges[i]
            # Results of earlier equations are reused.
            values = {**base.step(step.equation.name).computed, **base.reference.symbols}
            if symbol not in values:
                return None
            values[symbol] = _with_perturbation(values[symbol], base.reference.k)
            self._perturbed[key] = base.on(base.reference.with_values(values), equations)
        return self._perturbed[key]


def equations_from(judge: Judge, step: Step) -> list[str]:
    """Return the names of an equation and of the later ones of its stage, which may use its outputs."""
    names: list[str] = []
    for later in judge.steps[judge.steps.index(step) :]:
        if later.stage == step.stage:
            names.append(later.equation.name)
    return names


def _with_perturbation(x: Value, k: int) -> Value:
    """Return a value with a perturbation of alternating sign, so that opposite effects do not cancel."""
    sign = np.where(np.arange(k) % 2, -1.0, 1.0)
    added = _RELATIVE_PERTURBATION / 10  # so that also a zero is changed
    if isinstance(x, Matrix):
        # Each entry is changed by another amount, because changes by the same one may have no effect together.
        pattern = np.cos(1.0 + np.arange(x.a[0].size)).reshape(x.a[0].shape)
        factor = 1 + _RELATIVE_PERTURBATION * sign[:, None, None] * pattern
        return Matrix(x.a * factor + added * pattern)
    values = np.broadcast_to(np.asarray(x, float), (k,))
    return values * (1 + _RELATIVE_PERTURBATION * sign) + added * sign


def _differ(before: Array, after: Array) -> bool:
    """Return whether residuals (k, entries) differ by more than rounding where both have a value."""
    if before.shape != after.shape:
        return True
    in_both = np.isfinite(before) & np.isfinite(after)
    if not in_both.any():
        return bool((np.isfinite(before) != np.isfinite(after)).any())
    difference = np.abs(before - after)[in_both]
    limit = _RESIDUAL_ROUNDING * np.maximum(np.abs(before)[in_both], 1.0)
    return bool((difference > limit).any())


def _replaced_symbols(candidate: Candidate) -> set[str]:
    """Return the symbols in the text that the edits replace, and the symbols from which these are computed."""
    touched: set[str] = set()
    for edit in candidate.edits:
        names = _names_in_text(edit.old)
        if edit.function == candidate.step.source.name:
            touched |= _with_origins(candidate.step.source, edit.statement, names)
        elif names:
            touched.update(candidate.step.inputs)
    return touched


def _names_in_text(text: str) -> set[str]:
    """Return the names in a part of a statement; none if it is no Python by itself."""
    try:
        tree = ast.parse(text.strip() or "0")
    except SyntaxError:
        return set()
    return names_in(tree)


def _with_origins(source: Source, index: int, names: set[str]) -> set[str]:
    """Return `names` and the names from which they are computed before a statement."""
    origins = set(names)
    for statement in reversed(source.statements[:index]):
        if not origins.isdisjoint(statement.writes):
            origins |= statement.reads
    return origins
