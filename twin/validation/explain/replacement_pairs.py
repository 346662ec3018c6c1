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

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.formula.scalar import Scalar, Value
from twin.validation.explain import plain_values
from twin.validation.explain.candidate import alias_values, edited_residuals, names_in_helpers
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.dependence import equations_from
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.function_source import ByteRange, Edit
from twin.validation.explain.rebuilt_functions import Matrix
from twin.validation.explain.row_deviations import Judge, by_row

_FEW_SAMPLES = 2
"""Number of the mechanism's samples used to exclude pairs; one perturbed sample is added."""

_CHANCE_RESIDUAL = 1e-3
"""Residual, in units of the tolerance, up to which a row agrees exactly at perturbed values: it says nothing then."""

_OTHER_FUNCTION_DISTANCE = 100
"""Assumed distance, in statements, between the row and a token in another function."""

_MOST_COMBINATIONS = 4096
"""Maximum number of combinations in one evaluation."""


@dataclass(frozen=True)
class _Position:
    """A token, and the edits that replace it; `is_batched`: whether all these edits can be evaluated at once."""

    edits: tuple[Edit, ...]
    is_batched: bool

    @property
    def start(self) -> int:
        return self.edits[0].start

    @property
    def end(self) -> int:
        return self.edits[0].end


class ReplacementPairs:
    """Search for pairs of edits that fix one row, in an equation and in the functions that the equation calls."""

    def __init__(
        self,
        judge: Judge,
        perturbed_judge: Judge,
        step: Step,
        row: RowKey,
        edits: Sequence[Edit],
        deadline: Deadline,
        needed: Sequence[ByteRange] = (),
    ) -> None:
        """Set up the search.

        `perturbed_judge` judges the formula at perturbed values; `edits` are single edits of one token that change the
        row. `needed` are parts of the file that one of both edits must replace: names without a value.
        """
        self.needed = list(needed)
        self.judge = judge
        self.perturbed_judge = perturbed_judge
        self.step = step
        self.row = row
        self.deadline = deadline
        self.evaluated = 0
        self._late = False
        self._tiled: dict[int, Judge] = {}
        self._expansions = (_Expansion(0), _Expansion(1))
        self._samples = self._chosen_samples()
        self.positions = self._sorted(edits)
        n = len(self.positions)
        self.total = n * (n - 1) // 2

    def _chosen_samples(self) -> NDArray[np.int_]:
        """Return the indices of the few samples, from those at which the row has a value."""
        residual = by_row(self.judge.residuals)[self.row]
        valued = np.flatnonzero(np.isfinite(residual).all(axis=1))
        if len(valued) < _FEW_SAMPLES:
            valued = np.arange(self.judge.reference.k)
        return valued[np.linspace(0, len(valued) - 1, _FEW_SAMPLES).astype(int)]

    def likely_pairs(self) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs that make the row agree at a few poses but not at perturbed values; stop at the deadline.

        Call this method with NumPy's warnings disabled.
        """
        for first, second in self._order():
            if self.deadline.passed:
                return
            self.evaluated += 1
            is_same_file = first.edits[0].path == second.edits[0].path
            if is_same_file and first.start <= second.end and second.start <= first.end:
                continue  # the edits overlap or touch
            if self._replaces_needed(first.edits[0], second.edits[0]):
                yield from self._agreeing_edits(first, second)

    def _replaces_needed(self, first: Edit, second: Edit) -> bool:
        """Return whether two edits together replace all parts of the file without which the equation cannot run."""
        return all(first.replaces(part) or second.replaces(part) for part in self.needed)

    @property
    def complete(self) -> bool:
        """Whether every pair was tried."""
        return self.evaluated >= self.total and not self._late

    def _order(self) -> Iterator[tuple[_Position, _Position]]:
        """Yield pairs of positions, nearest first: in one statement, then in one function, then in different functions.

        Pairs at equal distance are sorted by their distance from the row. Two misprints are often near each other.
        """
        groups: dict[_EditPlace, list[_Position]] = {}
        for position in self.positions:
            edit = position.edits[0]
            groups.setdefault((str(edit.path), edit.function, edit.statement), []).append(position)
        pairs = itertools.combinations_with_replacement(groups, 2)
        for first, second in sorted(pairs, key=self._distance):
            if first == second:
                yield from itertools.combinations(groups[first], 2)
            else:
                yield from itertools.product(groups[first], groups[second])

    def _distance(self, pair: tuple[_EditPlace, _EditPlace]) -> tuple[bool, int, int]:
        """Return (whether the functions differ, distance in statements, distance of both from the row)."""
        (*function, first_index), (*other_function, second_index) = pair
        from_row = 0
        for _, name, statement in pair:
            from_row += abs(self.row[1] - statement) if name == self.step.source.name else _OTHER_FUNCTION_DISTANCE
        if function != other_function:
            return True, 0, from_row
        return False, abs(first_index - second_index), from_row

    def _sorted(self, edits: Sequence[Edit]) -> list[_Position]:
        """Group the edits by token; tokens whose replacements can be evaluated at once come first."""
        together: dict[tuple[str, int, int], list[Edit]] = {}
        alone: list[_Position] = []
        for edit in edits:
            if _replaces_value(edit):
                together.setdefault((str(edit.path), edit.start, edit.end), []).append(edit)
            else:
                alone.append(_Position((edit,), False))
        batched: list[_Position] = []
        for group in together.values():
            if self.deadline.passed:
                self._late = True
                break
            scalar, single = self._split(group)
            for edit in single:
                alone.append(_Position((edit,), False))
            if scalar:
                batched.append(_Position(tuple(scalar), True))
        return batched + alone

    def _split(self, group: list[Edit]) -> tuple[list[Edit], list[Edit]]:
        """Split the edits of one token into those that can be evaluated at once, and those to try one by one."""
        single: list[Edit] = []
        non_scalars = self._non_scalars(group)
        if non_scalars is None:  # for example, a name that is not yet defined
            valued: list[Edit] = []
            for edit in group:
                defined = self._residual([edit], [edit], (1, 1)) is not None
                if defined:
                    valued.append(edit)
                else:
                    single.append(edit)
            group = valued
            if not group:
                return [], single
            non_scalars = self._non_scalars(group)
        if non_scalars is None:
            return [], single + group
        scalar: list[Edit] = []
        for i, edit in enumerate(group):
            if i in non_scalars:
                single.append(edit)
            else:
                scalar.append(edit)
        return scalar, single

    def _non_scalars(self, group: list[Edit]) -> set[int] | None:
        """Return which of the edits insert a matrix or a list; None if one of them has no value."""
        position = _Position(tuple(group), True)
        if self._residual([self._edit_of_position(position, 0)], position.edits, (len(group), 1)) is None:
            return None
        return self._expansions[0].non_scalars

    # -- evaluation -------------------------------------------------------------------------------------------

    def _agreeing_edits(self, first: _Position, second: _Position) -> Iterator[tuple[Edit, Edit]]:
        """Yield the pairs of edits of two positions after which the row agrees at the few poses, and not by chance."""
        most = max(_MOST_COMBINATIONS // len(second.edits), 1)
        if len(first.edits) > most:
            for i in range(0, len(first.edits), most):
                yield from self._agreeing_edits(_Position(first.edits[i : i + most], True), second)
            return
        shape = (len(first.edits), len(second.edits))
        change = [self._edit_of_position(first, 0), self._edit_of_position(second, 1)]
        r = self._residual(change, (*first.edits, *second.edits), shape)
        if r is None:
            return
        largest = np.abs(r).max(axis=2)
        agrees = largest[:, :_FEW_SAMPLES].max(axis=1) <= 1
        # At perturbed values an agreement would be a coincidence; NaN counts as disagreement.
        by_chance = largest[:, _FEW_SAMPLES:].max(axis=1) <= _CHANCE_RESIDUAL
        for combination in np.flatnonzero(agrees & ~by_chance).tolist():
            i, j = divmod(combination, shape[1])
            yield first.edits[i], second.edits[j]

    def _edit_of_position(self, position: _Position, axis: int) -> Edit:
        """Return the edit that inserts all replacements of a token as an array, or its only replacement."""
        if not position.is_batched:
            return position.edits[0]
        words = [edit.new for edit in position.edits]
        new = f"{_EXPANSION_NAMES[axis]}({', '.join(words)})"
        return dataclasses.replace(position.edits[0], new=new, kind="choice", define=None)

    def _residual(self, change: list[Edit], edits: Sequence[Edit], shape: tuple[int, int]) -> Array | None:
        """Return the row's residuals (combinations, samples, entries) after edits; the last sample is a perturbed one.

        Return None if the edited text has no value.
        """
        count = shape[0] * shape[1]
        repeats = 1 << (count - 1).bit_length()  # few sizes, because a judge is made for each of them
        judge = self._judge(repeats)
        for expansion in self._expansions:
            expansion.shape = (*shape, _FEW_SAMPLES + 1)
            expansion.size = repeats * (_FEW_SAMPLES + 1)
            expansion.non_scalars = set()
        step = judge.step(self.step.equation.name)
        extra = alias_values(judge, step, edits)
        if extra is None:
            return None
        for edit in edits:
            if edit.define is None:
                continue
            name, expression = edit.define
            if not expression and name in judge.reference.symbols:  # a new argument of the function
                extra[name] = plain_values.to_function_form(step.plain_function, judge.reference.symbols[name])
        functions: dict[str, Value] = dict(zip(_EXPANSION_NAMES, self._expansions, strict=True))
        with names_in_helpers(judge, step, change, functions):
            deviations = edited_residuals(judge, self.step.equation.name, change, {**extra, **functions})
        if deviations is None or self.row not in deviations:
            return None
        r = deviations[self.row]
        if len(r) != repeats * (_FEW_SAMPLES + 1):
            return None
        return r.reshape(repeats, _FEW_SAMPLES + 1, -1)[:count]

    def _judge(self, repeats: int) -> Judge:
        """Return a judge at the few samples used to exclude pairs, repeated for n combinations."""
        if repeats not in self._tiled:
            step = self.step
            name = step.equation.name
            of_mechanism = {**step.computed, **self.judge.reference.symbols}
            perturbed = {**self.perturbed_judge.step(name).computed, **self.perturbed_judge.reference.symbols}
            symbols: dict[str, Value] = {}
            for symbol, value in of_mechanism.items():
                if symbol in perturbed:
                    symbols[symbol] = self._tile(value, perturbed[symbol], repeats)
            equations = [name]
            if self.row[0] != name:  # the row is in a later equation
                equations = equations_from(self.judge, step)
            reference = dataclasses.replace(
                self.judge.reference, symbols=symbols, k=repeats * (_FEW_SAMPLES + 1), run=None
            )
            self._tiled[repeats] = self.judge.on(reference, equations)
        return self._tiled[repeats]

    def _tile(self, value: Value, perturbed: Value, n: int) -> Value:
        """Return the few samples of a symbol's values, then one of its perturbed values, repeated n times."""
        if isinstance(value, Matrix):
            return Matrix(np.tile(self._few(value.a, perturbed.a), (n, 1, 1)))
        return np.tile(self._few(np.asarray(value, float), np.asarray(perturbed, float)), n)

    def _few(self, values: Array, perturbed: Array) -> Array:
        """Return the few samples of values (k, ...) or (1, ...), then one of the perturbed values."""
        k = self.judge.reference.k
        samples = np.broadcast_to(values, (k, *values.shape[1:]))[self._samples]
        perturbed_sample = np.broadcast_to(perturbed, (k, *perturbed.shape[1:]))[self._samples[:1]]
        return np.concatenate([samples, perturbed_sample])


_EXPANSION_NAMES = ("_first_", "_second_")
"""Names of the two `_Expansion` functions in the edited text."""


_EditPlace = tuple[str, str, int]
"""(file, function, index of the statement) of an edit."""


class _Expansion:
    """Function that expands its arguments, the replacements at one position, along one of two axes.

    Two such functions give all combinations: entry (i, j) has replacement i at the first position and replacement j at
    the second.
    """

    def __init__(self, axis: int) -> None:
        """Set up for the replacements at the first (`axis` 0) or the second position (1)."""
        self.axis = axis
        self.shape: tuple[int, int, int] = (1, 1, 1)
        self.size = 1
        self.non_scalars: set[int] = set()
        """Indices of the arguments that are a vector, a matrix or a list."""

    def __call__(self, *values: Value) -> Value:
        """Return an array (size,) of all combinations, NaN for those whose value is no scalar; see `non_scalars`."""
        expanded = np.ones(self.size)
        combinations = expanded[: int(np.prod(self.shape))].reshape(self.shape)
        wrapper: type[Scalar] | None = None
        for i, value in enumerate(values):
            entries: tuple[slice | int, ...] = (i,)
            if self.axis == 1:
                entries = (slice(None), i)
            if isinstance(value, Scalar):
                wrapper = type(value)
                value = value.x
            try:
                x = np.asarray(value, float)
            except (TypeError, ValueError):  # a list, a matrix
                x = np.zeros(0)
            if x.shape == ():
                combinations[entries] = x
            elif x.shape == (self.size,):
                combinations[entries] = x[: combinations.size].reshape(self.shape)[entries]
            else:
                self.non_scalars.add(i)
                combinations[entries] = np.nan
        if wrapper is None:
            return expanded
        return wrapper(expanded)


def _replaces_value(edit: Edit) -> bool:
    """Return whether old and new text of an edit are both a number or scalar, so that an array can contain both."""
    if edit.kind not in ("name", "parameter", "trig", "index", "number", "exponent"):
        return False
    old = _parsed(edit.old)
    if isinstance(old, ast.Constant) and edit.kind == "index":  # an index must stay a whole number
        return False
    if not isinstance(old, ast.Name | ast.Constant):
        return False
    new = _parsed(edit.new)
    return new is not None and not isinstance(new, ast.Call)


def _parsed(text: str) -> ast.expr | None:
    try:
        return ast.parse(text, mode="eval").body
    except SyntaxError:
        return None
