"""Search pairs of edits; one evaluation tries all combinations of replacements at two positions in the text.

If a token is a number or the name of a scalar, all its replacements are evaluated at once: the token is replaced by an
array with one entry per combination of replacements at the two positions. Edits that change the form (operators, signs,
functions, indices) are tried one by one. A few samples exclude nearly all pairs; the remaining pairs are checked like
single edits.
"""

from __future__ import annotations

import ast
import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Scalar
from twin.validation.explain import plain
from twin.validation.explain.candidate import aliases, residuals
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.judge import Judge
from twin.validation.explain.numeric import Matrix
from twin.validation.explain.rows import Key, Step
from twin.validation.explain.source import Edit

_PLACES = 2
"""Number of the mechanism's samples used to exclude pairs; one perturbed sample is added."""

_AWAY = 100
"""Assumed distance, in statements, between the row and a token in another function."""

_MANY = 4096
"""Maximum number of combinations in one evaluation."""


@dataclass(frozen=True)
class _Position:
    """A token, and the edits that replace it; `free`: whether all these edits can be evaluated at once."""

    edits: tuple[Edit, ...]
    free: bool

    @property
    def start(self) -> int:
        return self.edits[0].start

    @property
    def end(self) -> int:
        return self.edits[0].end


class Pairs:
    """Search for pairs of edits that fix one row, in an equation and in the functions that the equation calls."""

    def __init__(
        self, judge: Judge, shaken: Judge, step: Step, row: Key, edits: Sequence[Edit], deadline: Deadline
    ) -> None:
        """Set up the search.

        `shaken` judges the formula at perturbed values; `edits` are single edits of one token that change the row.
        """
        self.judge, self.shaken, self.step, self.row = judge, shaken, step, row
        self.deadline = deadline
        self.evaluated = 0
        self._late = False
        self._tiled: dict[int, Judge] = {}
        self._pick = (_Choice(0), _Choice(1))
        r = next(r for p, r in judge.residuals.items() if p.key == row)
        good = np.flatnonzero(np.isfinite(r).all(axis=1))
        good = good if len(good) >= _PLACES else np.arange(judge.truth.k)
        self._places = good[np.linspace(0, len(good) - 1, _PLACES).astype(int)]
        self.positions = self._sorted(edits)
        n = len(self.positions)
        self.total = n * (n - 1) // 2

    def found(self) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs that make the row agree at a few poses but not at perturbed values; stop at the deadline.

        Call this method with NumPy's warnings disabled.
        """
        for a, b in self._order():
            if self.deadline.passed:
                return
            self.evaluated += 1
            if a.edits[0].path == b.edits[0].path and a.start <= b.end and b.start <= a.end:
                continue
            yield from self._try(a, b)

    @property
    def complete(self) -> bool:
        """Whether every pair was tried."""
        return self.evaluated >= self.total and not self._late

    def _order(self) -> Iterator[tuple[_Position, _Position]]:
        """Yield pairs of positions, nearest first: in one statement, then in one function, then in different functions.

        Pairs at equal distance are sorted by their distance from the row. Two misprints are often near each other.
        """
        groups: dict[tuple[str, str, int], list[_Position]] = {}
        for p in self.positions:
            e = p.edits[0]
            groups.setdefault((str(e.path), e.function, e.statement), []).append(p)

        def near(pair: tuple[tuple[str, str, int], tuple[str, str, int]]) -> tuple[bool, int, int]:
            (*a, i), (*b, j) = pair
            away = sum(abs(self.row[1] - k) if f == self.step.source.name else _AWAY for _, f, k in pair)
            return a != b, abs(i - j) if a == b else 0, away

        for k, other in sorted(itertools.combinations_with_replacement(groups, 2), key=near):
            if k == other:
                yield from itertools.combinations(groups[k], 2)
            else:
                yield from itertools.product(groups[k], groups[other])

    def _sorted(self, edits: Sequence[Edit]) -> list[_Position]:
        """Group the edits by token; tokens whose replacements can be evaluated at once come first."""
        together: dict[tuple[str, int, int], list[Edit]] = {}
        alone: list[_Position] = []
        for e in edits:
            if _is_value(e):
                together.setdefault((str(e.path), e.start, e.end), []).append(e)
            else:
                alone.append(_Position((e,), False))
        free: list[_Position] = []
        for group in together.values():
            if self.deadline.passed:
                self._late = True
                break
            position = _Position(tuple(group), True)
            done = self._residual([self._choice(position, 0)], position.edits, (len(group), 1))
            if done is None:  # for example, a name that is not yet defined
                alone += [_Position((e,), False) for e in group if self._residual([e], [e], (1, 1)) is None]
                group = [e for e in group if all(p.edits[0] is not e for p in alone)]
                if not group:
                    continue
                position = _Position(tuple(group), True)
                done = self._residual([self._choice(position, 0)], position.edits, (len(group), 1))
            odd = set(range(len(group))) if done is None else self._pick[0].odd  # matrices and lists: one by one
            alone += [_Position((e,), False) for i, e in enumerate(group) if i in odd]
            scalar = tuple(e for i, e in enumerate(group) if i not in odd)
            free += [_Position(scalar, True)] if scalar else []
        return free + alone

    # -- evaluation -------------------------------------------------------------------------------------------

    def _try(self, a: _Position, b: _Position) -> Iterator[tuple[Edit, Edit]]:
        most = max(_MANY // len(b.edits), 1)
        if len(a.edits) > most:
            for i in range(0, len(a.edits), most):
                yield from self._try(_Position(a.edits[i : i + most], True), b)
            return
        shape = (len(a.edits), len(b.edits))
        change = [self._choice(a, 0), self._choice(b, 1)]
        r = self._residual(change, (*a.edits, *b.edits), shape)
        if r is None:
            return
        on, off = np.abs(r[:, :_PLACES]).max(axis=(1, 2)), np.abs(r[:, _PLACES:]).max(axis=(1, 2))
        for c in np.flatnonzero((on <= 1) & ~(off <= 1e-3)):  # NaN counts as disagreement at perturbed values
            i, j = divmod(int(c), shape[1])
            yield a.edits[i], b.edits[j]

    def _choice(self, p: _Position, axis: int) -> Edit:
        """Return the edit that inserts all replacements of a token as an array, or its only replacement."""
        if not p.free:
            return p.edits[0]
        words = ", ".join(e.new for e in p.edits)
        return dataclasses.replace(p.edits[0], new=f"{_NAMES[axis]}({words})", kind="choice", define=None)

    def _residual(self, change: list[Edit], edits: Sequence[Edit], shape: tuple[int, int]) -> Array | None:
        """Return the row's residuals (combinations, samples, entries) after edits; the last sample is a perturbed one.

        Return None if the edited text has no value.
        """
        count = shape[0] * shape[1]
        n = 1 << (count - 1).bit_length()
        judge = self._judge(n)
        for pick in self._pick:
            pick.shape, pick.size = (*shape, _PLACES + 1), n * (_PLACES + 1)
            pick.odd = set()
        step = judge.step(self.step.equation.name)
        defined = [e for e in edits if e.define]
        extra = aliases(judge, step, defined)
        if extra is None:
            return None
        for e in defined:
            if e.define and not e.define[1] and e.define[0] in judge.truth.symbols:
                extra[e.define[0]] = plain.inside(step.plain, judge.truth.symbols[e.define[0]])
        picks: dict[str, Any] = dict(zip(_NAMES, self._pick, strict=True))
        called = [h.function.__globals__ for h in judge.helpers(step)] if self._foreign(change) else []
        for scope in called:
            scope.update(picks)
        found = residuals(judge, self.step.equation.name, change, {**extra, **picks})
        for scope in called:
            for name in picks:
                scope.pop(name, None)
        if found is None or self.row not in found:
            return None
        r = found[self.row]
        return r.reshape(n, _PLACES + 1, -1)[:count] if len(r) == n * (_PLACES + 1) else None

    def _foreign(self, change: list[Edit]) -> bool:
        return any(e.function != self.step.source.name for e in change)

    def _judge(self, n: int) -> Judge:
        """Return a judge at the few samples used to exclude pairs, repeated for n combinations."""
        if n not in self._tiled:
            step, other = self.step, self.shaken.step(self.step.equation.name)
            on = {**step.computed, **self.judge.truth.symbols}
            off = {**other.computed, **self.shaken.truth.symbols}
            symbols = {name: self._tile(on[name], off[name], n) for name in on if name in off}
            later = self.judge.steps[self.judge.steps.index(step) :]
            equations = {step.equation.name}
            if self.row[0] != step.equation.name:
                equations = {s.equation.name for s in later if s.stage == step.stage}
            truth = dataclasses.replace(self.judge.truth, symbols=symbols, k=n * (_PLACES + 1), run=None)
            self._tiled[n] = self.judge.on(truth, equations)
        return self._tiled[n]

    def _tile(self, on: Any, off: Any, n: int) -> Any:
        k = self.judge.truth.k
        if isinstance(on, Matrix):
            a, b = (np.broadcast_to(x.a, (k, *x.a.shape[1:])) for x in (on, off))
            return Matrix(np.tile(np.concatenate([a[self._places], b[self._places[:1]]]), (n, 1, 1)))
        a, b = (np.broadcast_to(np.asarray(x, float), (k,)) for x in (on, off))
        return np.tile(np.concatenate([a[self._places], b[self._places[:1]]]), n)


_NAMES = ("_first_", "_second_")
"""Names of the two `_Choice` functions in the edited text."""


class _Choice:
    """Function that expands its arguments, the replacements at one position, along one of two axes.

    Two such functions give all combinations: entry (i, j) has replacement i at the first position and replacement j at
    the second.
    """

    def __init__(self, axis: int) -> None:
        self.axis = axis
        self.shape: tuple[int, int, int] = (1, 1, 1)
        self.size = 1
        self.odd: set[int] = set()

    def __call__(self, *values: Any) -> Any:
        out = np.ones(self.size)
        mixed = out[: int(np.prod(self.shape))].reshape(self.shape)
        wrap = None
        for i, value in enumerate(values):
            at = (i,) if self.axis == 0 else (slice(None), i)
            if isinstance(value, Scalar):
                wrap, value = type(value), value.x
            try:
                x = np.asarray(value, float)
            except (TypeError, ValueError):
                x = np.zeros(0)
            if x.shape not in ((), (self.size,)):
                self.odd.add(i)
                mixed[at] = np.nan
                continue
            mixed[at] = x if not x.ndim else x[: mixed.size].reshape(self.shape)[at]
        return out if wrap is None else wrap(out)


def _is_value(e: Edit) -> bool:
    """Return whether old and new text of an edit are both a number or scalar, so that an array can contain both."""
    if e.kind not in ("name", "parameter", "trig", "index", "number", "exponent"):
        return False
    old, new = (_parsed(t) for t in (e.old, e.new))
    if isinstance(old, ast.Constant) and e.kind == "index":
        return False
    return isinstance(old, ast.Name | ast.Constant) and new is not None and not isinstance(new, ast.Call)


def _parsed(text: str) -> ast.expr | None:
    try:
        return ast.parse(text, mode="eval").body
    except SyntaxError:
        return None
