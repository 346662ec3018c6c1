"""Measure on which symbols the rows depend, to reject repairs that make a row trivial.

If a row has its unknown on the right side (q1 = ... q2 - q1 ...), an edit can make the row trivial: q1 = q1, or a copy
of another row. Such a row always agrees, and so does a row with a zero factor. Residuals at the mechanism's poses do
not reveal these edits. Therefore, one symbol at a time is perturbed, and the change of the residuals is observed.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import Candidate, residuals
from twin.validation.explain.judge import Judge
from twin.validation.explain.numeric import Matrix
from twin.validation.explain.rows import Key, Step
from twin.validation.explain.source import Edit, Source

_STIR = 1e-3
"""Relative perturbation of a symbol, to test whether a row depends on the symbol."""

_STILL = 1e-9
"""Largest change of a residual that counts as rounding, relative to the larger of the residual and the tolerance."""

_STEP = 1e-5
"""Step (m, rad) of numeric derivatives with respect to the unknowns of an implicit equation."""

_PARALLEL = 1e-6
"""Minimum size of the component of a row's unit gradient outside the span of the other rows' gradients."""


class Dependence:
    """Dependence of the rows of a formula on symbols, at the mechanism's poses and at other values."""

    def __init__(self, judge: Judge, shaken: Judge) -> None:
        """Store the judge, and a judge of the same formula at perturbed values that no mechanism has."""
        self.judge = judge
        self.bases = (judge, shaken)
        self._stirred: dict[tuple[int, str, frozenset[str], str], Judge] = {}
        self._stepped: dict[tuple[str, str, int], Judge] = {}
        self._symbol = {p.key: p.symbol for p in judge.residuals}
        self._read: dict[tuple[str, Key], set[str]] = {}

    def judged(self, c: Candidate, rows: Collection[Key]) -> None:
        """Set `hollow` and `dropped` of a candidate that repairs `rows`; see `Candidate`."""
        if not rows:
            return
        if any(not self.determined(c, k) for k in rows):
            c.hollow = True
            return
        dropped: set[str] = set()
        after = self._answers(c.step, c.edits, rows)
        before = {k: self.reads(c.step, k, rows) for k in rows}
        for k in rows:
            if self._returns_own(c, k):
                after[k].add(self._symbol[k])
            dropped |= before[k] - after[k]
        c.dropped = tuple(sorted(dropped))
        # A symbol that is still in the text but has no effect was multiplied by zero or cancelled. A single edit may
        # correctly restore a zero that was misprinted; for two edits this is not credible.
        c.hollow = any(before[k] and not after[k] for k in rows) or (len(c.edits) > 1 and bool(dropped - _touched(c)))

    def _returns_own(self, c: Candidate, row: Key) -> bool:
        """Return whether an edited return statement gives a symbol that another row computes and that is judged there.

        Such a row always agrees, because the symbol has the mechanism's value; it is not trivial.
        """
        equation, index, position = row
        symbol = self._symbol[row]
        statement = c.step.source.statements[index]
        if equation != c.step.equation.name or not statement.returns:
            return False
        edits = [e for e in c.edits if e.function == c.step.source.name and e.statement == index]
        if not edits:
            return False
        text = c.step.source.edited(statement, edits)
        value = ast.parse(f"({text.removeprefix('return').strip()}\n)", mode="eval").body
        returned = value.elts[position] if isinstance(value, ast.Tuple | ast.List) else value
        if not (isinstance(returned, ast.Name) and returned.id == symbol):
            return False
        return any(p.equation == equation and p.symbol == symbol and p.statement < index for p in self.judge.residuals)

    def reads(self, step: Step, row: Key, rows: Collection[Key] = ()) -> set[str]:
        """Return the symbols on which an unedited row depends; `rows`: further rows to evaluate in the same run."""
        name = step.equation.name
        if (name, row) not in self._read:
            for k, found in self._answers(step, (), {row, *rows}).items():
                self._read[name, k] = found
        return self._read[name, row]

    # -- symbols of rows ----------------------------------------------------------------------------------------

    def _answers(self, step: Step, change: Sequence[Edit], rows: Collection[Key]) -> dict[Key, set[str]]:
        """Return {row: symbols on which the row depends} after the edits `change`; no edits: the original rows."""
        name = step.equation.name
        equations = frozenset({name})
        if any(k[0] != name for k in rows):  # rows of later equations depend on symbols through this equation
            later = self.judge.steps[self.judge.steps.index(self.judge.step(name)) :]
            equations = frozenset(s.equation.name for s in later if s.stage == step.stage)
        out: dict[Key, set[str]] = {k: set() for k in rows}
        for i, base in enumerate(self.bases):
            at = residuals(base, name, change)
            if at is None:
                continue
            # An output that a later row uses is also a symbol of that row, with the mechanism's value.
            for symbol in (*step.inputs, *(n for n in step.equation.outputs if n in step.held - set(step.inputs))):
                moved = self._moved(i, step, equations, symbol)
                if moved is None:
                    continue
                there = residuals(moved, name, change)
                if there is None:
                    continue
                for k in rows:
                    if symbol == self._symbol[k] and symbol not in step.inputs:
                        continue  # the symbol is the left side
                    if symbol not in out[k] and k in at and k in there and _differ(at[k], there[k]):
                        out[k].add(symbol)
        return out

    def _moved(self, i: int, step: Step, equations: frozenset[str], symbol: str) -> Judge | None:
        """Return a judge of the given equations with one symbol perturbed; None if the symbol has no value."""
        at = (i, step.equation.name, equations, symbol)
        if at not in self._stirred:
            base = self.bases[i]
            mine = base.step(step.equation.name)
            # Results of earlier equations are reused.
            values = {**mine.computed, **base.truth.symbols}
            if symbol not in values:
                return None
            values[symbol] = _stirred(values[symbol], base.truth.k)
            self._stirred[at] = base.on(base.truth.with_parameters(values), equations)
        return self._stirred[at]

    # -- unknowns of implicit rows ---------------------------------------------------------------------------

    def determined(self, c: Candidate, row: Key) -> bool:
        """Return whether an edited row still determines its unknown, together with the other rows of the equation.

        Only an equation that uses its own outputs can fail this check. The gradient of each row (right side minus left
        side) with respect to these outputs is computed at the mechanism's poses. The gradient of the edited row must
        not be in the span of the other gradients.
        """
        step = self.judge.step(row[0])
        unknown = [n for n in step.equation.outputs if n in step.known and n in step.inputs]
        new = {e.define[0] for e in c.edits if e.define and not e.define[1]}
        unknown += [n for n in step.equation.outputs if n in step.known and n in new and n not in unknown]
        if not unknown:
            return True
        places = [p.key for p in self.judge.residuals if p.equation == row[0]]
        if row not in places or any(
            self.judge.residuals[p].shape[1] != 1 for p in self.judge.residuals if p.key == row
        ):
            return True
        kinds = {p.key: self.judge.truth.kinds[p.symbol] for p in self.judge.residuals}
        t = self.judge.tolerance
        gradient: dict[Key, list[Array]] = {k: [] for k in places}
        for name in unknown:
            sides = [self._sides(c, row[0], name, sign) for sign in (1, -1)]
            if sides[0] is None or sides[1] is None:
                return False
            for k in places:
                tolerance = t.angle if kinds[k] == "angle" else t.length
                slope = (sides[0][k] - sides[1][k]) * (tolerance / (2 * _STEP))
                gradient[k].append(slope[:, 0] if slope.shape[1] == 1 else np.full(len(slope), np.nan))
        J = {k: np.stack(g, axis=1) for k, g in gradient.items()}
        mine = J.pop(row)
        others = [g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), _PARALLEL) for g in J.values()]
        others = [np.where(np.isfinite(g).all(axis=1, keepdims=True), g, 0.0) for g in others]
        good = np.isfinite(mine).all(axis=1)
        if not good.any():
            return False
        rest = mine
        if others:
            A = np.stack(others, axis=1)  # (k, rows, unknowns)
            span = np.linalg.pinv(A, rcond=1e-8) @ A
            rest = mine - (mine[:, None, :] @ span)[:, 0]
        return float(np.mean(np.linalg.norm(rest, axis=1)[good] > _PARALLEL)) > 0.5

    def _sides(self, c: Candidate, equation: str, name: str, sign: int) -> dict[Key, Array] | None:
        at = (equation, name, sign)
        if at not in self._stepped:
            step = self.judge.step(equation)
            values = {**step.computed, **self.judge.truth.symbols}
            values[name] = values[name] + sign * _STEP
            self._stepped[at] = self.judge.on(self.judge.truth.with_parameters(values), {equation})
        judge = self._stepped[at]
        as_it_stands = residuals(judge, equation, ()) or {}
        mine = [e for e in c.edits if c.step.equation.name == equation]
        changed = residuals(judge, equation, mine) if mine else {}
        return None if changed is None else {**as_it_stands, **changed}


def _stirred(x: Any, k: int) -> Any:
    sign = np.where(np.arange(k) % 2, -1.0, 1.0)
    if isinstance(x, Matrix):
        pattern = np.cos(1.0 + np.arange(x.a[0].size)).reshape(x.a[0].shape)
        return Matrix(x.a * (1 + _STIR * sign[:, None, None] * pattern) + _STIR / 10 * pattern)
    return np.broadcast_to(np.asarray(x, float), (k,)) * (1 + _STIR * sign) + _STIR / 10 * sign


def _differ(a: Array, b: Array) -> bool:
    if a.shape != b.shape:
        return True
    both = np.isfinite(a) & np.isfinite(b)
    if not both.any():
        return bool((np.isfinite(a) != np.isfinite(b)).any())
    return bool((np.abs(a - b)[both] > _STILL * np.maximum(np.abs(a)[both], 1.0)).any())


def _touched(c: Candidate) -> set[str]:
    """Return the symbols in the text that the edits replace, and the symbols from which these are computed."""
    out: set[str] = set()
    for e in c.edits:
        try:
            names: set[str] = {n.id for n in ast.walk(ast.parse(e.old.strip() or "0")) if isinstance(n, ast.Name)}
        except SyntaxError:
            names = set()
        if e.function != c.step.source.name:
            out |= set(c.step.inputs) if names else set()
            continue
        out |= _leads(c.step.source, e.statement, names)
    return out


def _leads(source: Source, index: int, names: Iterable[str]) -> set[str]:
    out = set(names)
    for s in reversed(source.statements[:index]):
        if out & set(s.writes):
            out |= s.reads
    return out
