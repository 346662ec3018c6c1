"""Find two edits together, from the values that scalar expressions must have so that rows agree.

The largest scalar expressions of the statements are the unknowns. If the values of one of them, or of two of them, can
make the rows agree at every pose, Gauss-Newton finds these values. Both edits are then looked for in the text of this
one expression, or one edit in each of the two. A row with several entries, such as a pose, rejects nearly all wrong
pairs of expressions without a trial of any edit. For edits outside scalar expressions, and for rows with one entry,
one edit is tried first, and the other follows from the values of one expression.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, islice, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.batched_solutions import Batch, Choice, LargestScalar
from twin.validation.explain.candidate import residuals_with
from twin.validation.explain.counterparts import counterpart_edits
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.expression import Expression, Site
from twin.validation.explain.expression_shifts import FEWEST_POSES, Shift, shifted
from twin.validation.explain.function_source import Edit, TextPlace
from twin.validation.explain.plain_values import unwrapped
from twin.validation.explain.rebuilt_functions import unguarded
from twin.validation.explain.required_values import RequiredValues
from twin.validation.explain.row_deviations import Judge, by_row, entries_of, worst
from twin.validation.explain.term_pairs import with_term

_SHIFTS_IN_HALF_TURNS = (0.5, -0.5, 1.0)
"""Shifts, in units of pi, of an angle whose constant is wrong; Gauss-Newton does not reach them from zero."""

_SHIFTS_IN_VALUES = (0.0, -2.0, -1.0, 1.0, -0.5, -0.75, 3.0)
"""Shifts, as multiples of an expression's value: unchanged, other sign, zero, twice, half, a fourth, four times."""

_GUESS_POSES = 4
"""Number of poses at which such shifts are tried."""

_MOST_NAMES = 8
"""Number of names of the same function whose values an expression may have instead."""

_SHIFT_CHOICES = len(_SHIFTS_IN_VALUES) + len(_SHIFTS_IN_HALF_TURNS) + _MOST_NAMES
"""Number of shifts of each of two expressions that are tried in all combinations."""

_PAIRS_AT_ONCE = 8
"""Number of pairs of expressions for which such shifts are tried by one evaluation."""

_POSE_ENTRIES = 12
"""Number of entries of a row with which one pose decides whether shifts are good."""

_LARGEST_REMAINING_PART = 0.1
"""Largest part of the residuals that may be left after such shifts, for Gauss-Newton to start there."""

_MOST_EDITS = 6
"""Maximum number of edits of each of two expressions that are combined."""

_CHOICES_AT_ONCE = 256
"""Number of choices of expressions of which the solutions are found together."""


_ScalarPair = tuple[LargestScalar, LargestScalar]
"""Two expressions of one function."""


class RequiredPairs:
    """Search for two edits in the statements of one equation, or of one function that it calls."""

    def __init__(
        self, coarse: Batch, full: Batch, step: Step, sites: Sequence[Site], failing: Sequence[RowKey]
    ) -> None:
        """Set up the search.

        Args:
            coarse: few poses, which reject most expressions.
            full: all poses.
            step: the equation.
            sites: the statements on which the wrong rows depend.
            failing: the wrong rows.
        """
        self.coarse = coarse
        self.full = full
        self.step = step
        self.sites = sites
        self.failing = list(failing)
        self.unsure: list[TextPlace] = []
        """Places of expressions whose values may differ from call to call, so that one value of them proves nothing."""
        self._scalars: list[LargestScalar] | None = None
        self._in_loops: list[tuple[Site, ast.expr]] = []
        """The largest scalar expressions that an evaluation computes several times."""
        self._first_shifts: dict[LargestScalar, Array] = {}
        self._arguments: dict[tuple[Path, str], list[Array]] = {}

    @property
    def judge(self) -> Judge:
        """Judge at all poses, at which `if_else(condition, value, nan)` is `value`."""
        return self.full.copies(1)

    def in_one_expression(self, rows: Sequence[RowKey], deadline: Deadline) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits that both are in one expression."""
        for expression, required in self._required_of_one(rows, deadline):
            yield from expression.edit_pairs(required)

    def in_one_expression_with_term(self, rows: Sequence[RowKey], deadline: Deadline) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of an edit, and a missing term or factor in the same expression."""
        for expression, required in self._required_of_one(rows, deadline):
            yield from with_term(expression, required)

    def _required_of_one(self, rows: Sequence[RowKey], deadline: Deadline) -> Iterator[tuple[Expression, Array]]:
        """Yield expressions with the values (k,) that they must have so that rows agree."""
        choices = [(scalar,) for scalar in self.scalars(rows, deadline)]
        for (scalar,), (shift,) in self._solutions((), choices, rows, deadline):
            yield Expression(scalar.site, scalar.node, shift, deadline), _required_values(shift)
        for site, node in self._in_loops:
            if deadline.passed:
                return
            search = RequiredValues(self.judge, self.step, rows, deadline)
            shift = search.in_calls(site.source, site.statement, node)
            if shift is not None:
                yield Expression(site, node, shift, deadline), _required_values(shift)

    def in_two_expressions(self, rows: Sequence[RowKey], deadline: Deadline) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits in two expressions, the expressions first that explain most of the residuals."""
        unexplained: list[tuple[float, _ScalarPair]] = []
        for a, b in combinations(self.scalars(rows, deadline), 2):
            if deadline.passed:
                return
            if a.function == b.function:
                unexplained.append((self._unexplained(a, b, rows), (a, b)))
        unexplained.sort(key=lambda item: item[0])
        ordered = [pair for _, pair in unexplained]
        without_edit: list[_SolvedPair] = []
        # Gauss-Newton starts from the present values, and then from guesses near which the rows may agree.
        for is_guessed in (False, True):
            starts = None
            choices = ordered
            if is_guessed:
                starts = self._guesses(ordered, rows, deadline)
                choices = list(starts)
            for (a, b), (shift_of_a, shift_of_b) in self._solutions((), choices, rows, deadline, starts):
                edits_of_a = list(self._texts(a, shift_of_a, deadline))
                edits_of_b = list(self._texts(b, shift_of_b, deadline))
                if not (edits_of_a and edits_of_b):
                    without_edit.append(_SolvedPair((a, b), (shift_of_a, shift_of_b), edits_of_a, edits_of_b))
                yield from product(edits_of_a, edits_of_b)
        # Short formulas take longer than edits that are tried anyway, so that they come last.
        for pair in without_edit:
            a, b = pair.scalars
            shift_of_a, shift_of_b = pair.shifts
            edits_of_a = pair.edits_of_a or list(self._composed(a, shift_of_a, deadline))
            edits_of_b = pair.edits_of_b
            if edits_of_a and not edits_of_b:
                edits_of_b = list(self._composed(b, shift_of_b, deadline))
            yield from product(edits_of_a, edits_of_b)

    def with_edit_beside(
        self, firsts: Sequence[Edit], rows: Sequence[RowKey], deadline: Deadline, composed: bool = False
    ) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of one of the edits `firsts` and an edit of an expression that it does not touch.

        `composed`: whether the second edit may be a short formula.
        """
        scalars = self.scalars(rows, deadline)
        for first in firsts:
            if deadline.passed:
                return
            choices: list[tuple[LargestScalar, ...]] = []
            for scalar in scalars:
                _, start, end = scalar.place
                is_beside = first.end < start or end < first.start
                if first.is_of(scalar.site.source) and is_beside:
                    choices.append((scalar,))
            for (scalar,), (shift,) in self._solutions((first,), choices, rows, deadline):
                seconds = list(self._texts(scalar, shift, deadline))
                if composed and not seconds:
                    seconds = list(self._composed(scalar, shift, deadline))
                for second in seconds:
                    yield first, second

    def with_required_value(
        self, firsts: Sequence[Edit], rows: Sequence[RowKey], deadline: Deadline
    ) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of one of `firsts` and an edit from the value that a scalar or vector must then have."""
        for first in firsts:
            if deadline.passed:
                return
            search = RequiredValues(self.judge, self.step, rows, deadline, [first])
            # Statements of the rows themselves come first: most of their expressions move a row.
            for site in sorted(self.sites, key=lambda site: not self._assigns(site, rows)):
                if not first.is_of(site.source):
                    continue
                for second in search.edits(site.source, site.statement):
                    yield first, second

    @cached_property
    def counterparts(self) -> list[Edit]:
        """The edits that put back what a similar expression of the file has more; see `counterpart_edits`."""
        edits: list[Edit] = []
        for site in self.sites:
            edits += counterpart_edits(site.source, site.statement)
        return edits

    def _assigns(self, site: Site, rows: Sequence[RowKey]) -> bool:
        """Return whether a statement assigns one of the rows itself."""
        if site.source is not self.step.source:
            return False
        statement = (self.step.equation.name, site.statement.index)
        return any(row[:2] == statement for row in rows)

    def outside(self, edits: Sequence[Edit], deadline: Deadline) -> tuple[list[Edit], list[Edit]]:
        """Return (edits in no scalar expression, of which only `with_edit_beside` finds pairs; the other edits)."""
        places = [scalar.place for scalar in self.scalars(self.failing, deadline)]
        outside: list[Edit] = []
        inside: list[Edit] = []
        for edit in edits:
            is_inside = False
            for path, start, end in places:
                is_inside |= edit.path == path and edit.is_within((start, end))
            if is_inside:
                inside.append(edit)
            else:
                outside.append(edit)
        return outside, inside

    def refuted(self, rows: Sequence[RowKey], deadline: Deadline) -> list[TextPlace]:
        """Return the places of expressions with no value of which one of the wrong rows `rows` agrees.

        No single edit inside them can repair a row. Only rows with several entries can show this.
        """
        base = self.full.residuals
        trials: list[Choice] = []
        possible: set[LargestScalar] = set()  # expressions in which an edit may repair a row, as far as is known
        scalars = self.scalars(rows, deadline)
        for scalar in scalars:
            for row in rows:
                if row not in scalar.slopes:
                    continue
                r = base[row]
                poses_with_value = np.isfinite(r).all(axis=1).sum()
                # One entry has a right value nearly everywhere, and several calls may need several values.
                if scalar.is_repeated or r.shape[1] == 1 or poses_with_value < FEWEST_POSES:
                    possible.add(scalar)
                for turn in (0.0, *_SHIFTS_IN_HALF_TURNS):
                    start = np.full((len(self.coarse.poses), 1), turn * np.pi)
                    trials.append(Choice((scalar,), (row,), start))
        undecided: list[Choice] = []
        for trial in trials:
            if trial.scalars[0] not in possible:
                undecided.append(trial)
        for i, _ in self.coarse.solved(self.step.equation.name, (), undecided, deadline):
            possible.add(undecided[i].scalars[0])
        if deadline.passed:  # expressions may be undecided
            return []
        return [scalar.place for scalar in scalars if scalar not in possible]

    # -- expressions ------------------------------------------------------------------------------------------------

    def scalars(self, rows: Sequence[RowKey], deadline: Deadline) -> list[LargestScalar]:
        """Return the largest scalar expressions of the statements whose values move the rows."""
        if self._scalars is None:
            largest = self._largest_scalars(deadline)
            if largest is None:  # the time is over; a later call has more
                return []
            self._scalars = largest
        return [scalar for scalar in self._scalars if scalar.moves_one_of(rows)]

    def _largest_scalars(self, deadline: Deadline) -> list[LargestScalar] | None:
        """Return the largest scalar expressions of the statements; None if the time is over.

        Those that are computed several times in an evaluation are stored in `_in_loops`.
        """
        todo: list[tuple[Site, ast.AST]] = []
        for site in self.sites:
            todo.append((site, site.statement.node))
        scalars: list[LargestScalar] = []
        # All nodes of one depth are probed together: an evaluation of the equation takes as long for one as for many.
        while todo:
            if deadline.passed:
                return None
            possible_scalars: list[tuple[Site, ast.expr]] = []
            below: list[tuple[Site, ast.AST]] = []
            for site, node in todo:
                if _may_be_scalar(node, site.parents):
                    assert isinstance(node, ast.expr)
                    possible_scalars.append((site, node))
                else:
                    below += _nodes_below(site, node)
            for (site, node), probe in zip(possible_scalars, self._probed(possible_scalars), strict=True):
                is_scalar = False
                if probe is not None:
                    if probe.has_mixed_values or probe.is_repeated:
                        self.unsure.append(LargestScalar(site, node, {}).place)
                    if probe.is_scalar and probe.is_repeated and not _is_inside(site, node, self._in_loops):
                        self._in_loops.append((site, node))
                    if probe.is_scalar and not probe.has_mixed_values:
                        is_scalar = True
                        scalars.append(LargestScalar(site, node, {}, probe.value[:, 0], probe.is_repeated))
                if not is_scalar:
                    below += _nodes_below(site, node)
            todo = below
        slopes_of_scalars = self.full.slopes(self.step.equation.name, scalars)
        moving: list[LargestScalar] = []
        for scalar, slopes in zip(scalars, slopes_of_scalars, strict=True):
            if slopes:
                moving.append(LargestScalar(scalar.site, scalar.node, slopes, scalar.value, scalar.is_repeated))
        return sorted(moving, key=lambda scalar: scalar.place)

    def _probed(self, nodes: Sequence[tuple[Site, ast.expr]]) -> list[_Probe | None]:
        """Return the probes of expressions; None if the text with a probe cannot be evaluated, or is not."""
        by_function: dict[tuple[Path, str], list[int]] = {}
        for i, (site, _) in enumerate(nodes):
            by_function.setdefault((site.source.path, site.source.name), []).append(i)
        probe_of_node: list[_Probe | None] = [None] * len(nodes)
        for indices in by_function.values():
            parts = [indices]
            if not self._probe(nodes, indices):
                parts = [[i] for i in indices]  # one of them has no value, so that each is tried alone
            for part in parts:
                probes = self._probe(nodes, part)
                for i, probe in zip(part, probes, strict=False):
                    if probe.called:
                        probe_of_node[i] = probe
        return probe_of_node

    def _probe(self, nodes: Sequence[tuple[Site, ast.expr]], indices: Sequence[int]) -> list[_Probe]:
        """Return the probes of some of `nodes`, of one function, all at once; an empty list if they have no values."""
        probes: list[_Probe] = []
        change: list[Edit] = []
        extra: dict[str, Value] = {}
        for i in indices:
            site, node = nodes[i]
            name = f"_required_{i}_"
            probe = _Probe(self.judge.reference.k)
            change.append(shifted(site.source, site.statement, node, name, scope=False))
            extra[name] = probe
            probes.append(probe)
        with unguarded():
            deviations = residuals_with(self.judge, self.step.equation.name, change, extra)
        if deviations is None:
            return []
        return probes

    def _unexplained(self, a: LargestScalar, b: LargestScalar, rows: Sequence[RowKey]) -> float:
        """Return the part of the residuals that small changes of two expressions cannot remove, on average."""
        base = self.full.residuals
        residuals: list[Array] = []
        slopes_of_a: list[Array] = []
        slopes_of_b: list[Array] = []
        for key in rows:
            if key not in a.slopes and key not in b.slopes:
                continue
            unmoved = np.zeros_like(base[key])
            residuals.append(base[key])
            slopes_of_a.append(a.slopes.get(key, unmoved))
            slopes_of_b.append(b.slopes.get(key, unmoved))
        r = np.hstack(residuals)
        J = np.stack([np.hstack(slopes_of_a), np.hstack(slopes_of_b)], axis=2)
        has_values = np.isfinite(J).all(axis=(1, 2)) & np.isfinite(r).all(axis=1)
        usable = has_values & (r != 0).any(axis=1)  # a pose at which the rows agree says nothing
        if not usable.any():
            return 1.0
        r = r[usable]
        J = J[usable]
        # J pinv(J) r is the part of r that a step of least squares removes.
        removed = (J @ (np.linalg.pinv(J) @ r[:, :, None]))[:, :, 0]
        remaining = np.sum((r - removed) ** 2, axis=1) / np.sum(r**2, axis=1)
        return float(np.mean(remaining))

    # -- values -------------------------------------------------------------------------------------------------------

    def _binding(self, scalars: Sequence[LargestScalar], rows: Sequence[RowKey]) -> tuple[RowKey, ...]:
        """Return the rows that determine the values of expressions: rows that agree must still agree."""
        moved_rows: set[RowKey] = set()
        for scalar in scalars:
            moved_rows.update(scalar.slopes)
        binding: list[RowKey] = []
        for row, residual in self.full.residuals.items():
            if row in moved_rows and (row in rows or worst(residual) <= 1):
                binding.append(row)
        return tuple(binding)

    def _solutions(
        self,
        fixed: Sequence[Edit],
        choices: Sequence[tuple[LargestScalar, ...]],
        rows: Sequence[RowKey],
        deadline: Deadline,
        starts: dict[tuple[LargestScalar, ...], Array] | None = None,
    ) -> Iterator[tuple[tuple[LargestScalar, ...], list[Shift]]]:
        """Yield expressions and their shifts with which, after the edits `fixed`, the rows agree.

        `starts` are the first shifts (k, expressions); None: zero.
        """
        equation = self.step.equation.name
        for first in range(0, len(choices), _CHOICES_AT_ONCE):
            if deadline.passed:
                return
            coarse_choices: list[Choice] = []
            for scalars in choices[first : first + _CHOICES_AT_ONCE]:
                start = None
                if starts is not None:
                    start = starts[scalars][self.coarse.poses]
                coarse_choices.append(Choice(scalars, self._binding(scalars, rows), start))
            # A few poses reject nearly all choices; only the others are evaluated at all poses.
            likely: list[Choice] = []
            for i, _ in self.coarse.solved(equation, fixed, coarse_choices, deadline):
                choice = coarse_choices[i]
                start = None
                if starts is not None:
                    start = starts[choice.scalars]
                likely.append(Choice(choice.scalars, choice.rows, start))
            for i, values in self.full.solved(equation, fixed, likely, deadline):
                shifts = self._at(fixed, likely[i], values)
                if shifts is None:
                    continue
                yield likely[i].scalars, shifts
                for values_of_one_sign in self._of_one_sign(shifts):
                    shifts_of_one_sign = self._at(fixed, likely[i], values_of_one_sign)
                    if shifts_of_one_sign is not None:
                        yield likely[i].scalars, shifts_of_one_sign

    def _of_one_sign(self, shifts: Sequence[Shift]) -> Iterator[Array]:
        """Yield shifts (k, expressions) after which an expression is positive at poses where it was negative.

        With a swivel, a radius may have either sign, because the angle may be half a turn further. The rows may
        disagree after the shifts.
        """
        if not self.step.swivel:
            return
        added = [shift.added for shift in shifts]
        values = np.hstack(added)
        for i, shift in enumerate(shifts):
            required = _required_values(shift)
            if (required[shift.valued_poses] < 0).any():
                values_of_one_sign = values.copy()
                values_of_one_sign[:, i] = np.abs(required) - shift.value[:, 0]
                yield values_of_one_sign

    def _at(self, fixed: Sequence[Edit], choice: Choice, values: Array) -> list[Shift] | None:
        """Return the shifts of expressions, with the names in their scope, for given values (k, expressions)."""
        shifts: list[Shift] = []
        for i in range(len(choice.scalars)):
            shift = Shift(len(values))
            shift.added = values[:, i : i + 1]
            shifts.append(shift)
        deviations = self._residuals(choice.scalars, shifts, fixed)
        if deviations is None or not deviations.keys() >= set(choice.rows):
            return None
        r = entries_of(deviations, choice.rows)
        has_value = np.asarray(np.isfinite(r).all(axis=1))
        if not (has_value.any() and np.abs(r[has_value]).max() <= 1):
            return None
        for shift in shifts:
            shift.valued_poses = has_value
        return shifts

    def _guesses(
        self, pairs: Sequence[_ScalarPair], rows: Sequence[RowKey], deadline: Deadline
    ) -> dict[tuple[LargestScalar, ...], Array]:
        """Return pairs of expressions with shifts (k, 2) near which the rows may agree.

        All combinations of some shifts are tried at few poses, for several pairs by one evaluation.
        """
        starts: dict[tuple[LargestScalar, ...], Array] = {}
        for part in _pairs_of_evaluations(pairs):
            if deadline.passed:
                break
            for (a, b), guess in zip(part, self._guess(part, rows), strict=True):
                if guess is not None:
                    i, j = divmod(guess, _SHIFT_CHOICES)
                    starts[a, b] = np.stack([self._shifts(a)[i], self._shifts(b)[j]], axis=1)
        return starts

    def _guess(self, pairs: Sequence[_ScalarPair], rows: Sequence[RowKey]) -> list[int | None]:
        """Return, for each pair, which combination of `_shifts` leaves least of the residuals; None if much is left.

        Combination i * _CHOICES + j has shift i of the first expression and shift j of the second one.
        """
        poses, grid = self._at_few
        before = by_row(grid.residuals)
        few = len(poses)
        samples_of_pair = _SHIFT_CHOICES**2 * few
        shifts: dict[LargestScalar, Shift] = {}
        for n, pair in enumerate(pairs):
            block = slice(n * samples_of_pair, (n + 1) * samples_of_pair)
            for axis, scalar in enumerate(pair):
                shift = shifts.setdefault(scalar, Shift(grid.reference.k))
                shape = (1, _SHIFT_CHOICES, few)
                if axis == 0:
                    shape = (_SHIFT_CHOICES, 1, few)
                along_axis = self._shifts(scalar)[:, poses].reshape(shape)
                combinations_of_shifts = np.broadcast_to(along_axis, (_SHIFT_CHOICES, _SHIFT_CHOICES, few))
                shift.added[block, 0] = combinations_of_shifts.ravel()
        after = self._residuals(list(shifts), list(shifts.values()), (), grid)
        guesses: list[int | None] = []
        for n, pair in enumerate(pairs):
            block = slice(n * samples_of_pair, (n + 1) * samples_of_pair)
            size = 0.0
            squares = np.zeros(samples_of_pair)  # of the residuals, for each combination of shifts and each pose
            for row in self._binding(pair, rows):
                size += float(np.sum(before[row][:few] ** 2))
                residual = before[row]
                if after is not None and row in after:
                    residual = after[row]
                squares = squares + np.sum(residual[block] ** 2, axis=1)
            remaining = squares.reshape(-1, few).sum(axis=1)
            remaining = np.where(np.isfinite(remaining), remaining, np.inf)
            best = int(np.argmin(remaining))
            # The first combination has no shift; Gauss-Newton starts there anyway.
            if best != 0 and remaining[best] <= _LARGEST_REMAINING_PART * size:
                guesses.append(best)
            else:
                guesses.append(None)
        return guesses

    def _shifts(self, scalar: LargestScalar) -> Array:
        """Return the shifts (choices, k) of an expression that are tried first; the first one is zero."""
        if scalar not in self._first_shifts:
            shifts = [multiple * scalar.value for multiple in _SHIFTS_IN_VALUES]
            for turn in _SHIFTS_IN_HALF_TURNS:
                shifts.append(np.full_like(scalar.value, turn * np.pi))
            for value in self._argument_values(scalar)[:_MOST_NAMES]:
                shifts.append(value - scalar.value)
            while len(shifts) < _SHIFT_CHOICES:
                shifts.append(np.zeros_like(scalar.value))
            self._first_shifts[scalar] = np.array(shifts)
        return self._first_shifts[scalar]

    def _argument_values(self, scalar: LargestScalar) -> list[Array]:
        """Return the values (k,) of the scalar arguments of an expression's function, those that vary first."""
        if scalar.function not in self._arguments:
            shift = Shift(self.judge.reference.k)
            self._residuals((scalar,), [shift])
            k = self.judge.reference.k
            varying: list[Array] = []
            constant: list[Array] = []
            for name in scalar.site.source.arguments:
                x = unwrapped(shift.scope.get(name))
                if not isinstance(x, int | float | np.ndarray) or np.shape(x) not in ((), (k,)):
                    continue
                values = np.broadcast_to(np.asarray(x, float), (k,))
                if np.ptp(values) > 0:
                    varying.append(values)
                else:
                    constant.append(values)
            self._arguments[scalar.function] = varying + constant
        return self._arguments[scalar.function]

    @cached_property
    def _at_few(self) -> tuple[NDArray[np.intp], Judge]:
        """Few poses, and a judge of all combinations of shifts there, for several pairs of expressions."""
        most_entries = 0
        for row, residual in self.full.residuals.items():
            if row in self.failing:
                most_entries = max(most_entries, residual.shape[1])
        few = _GUESS_POSES
        if most_entries >= _POSE_ENTRIES:
            few = 1
        spaced = np.linspace(0, self.judge.reference.k - 1, few + 2).astype(int)
        poses = spaced[1:-1]
        repeated = self.judge.reference.repeated(poses.tolist(), _SHIFT_CHOICES**2 * _PAIRS_AT_ONCE)
        with unguarded():
            judge = self.judge.on(repeated)
        return poses, judge

    def _texts(self, scalar: LargestScalar, shift: Shift, deadline: Deadline) -> Iterator[Edit]:
        """Yield single edits of an expression that shift its values."""
        expression = Expression(scalar.site, scalar.node, shift, deadline)
        return islice(expression.single_edits(_required_values(shift)), _MOST_EDITS)

    def _composed(self, scalar: LargestScalar, shift: Shift, deadline: Deadline) -> Iterator[Edit]:
        """Yield edits of an expression that shift its values by a term or factor."""
        expression = Expression(scalar.site, scalar.node, shift, deadline)
        return islice(expression.composed_edits(_required_values(shift)), _MOST_EDITS)

    def _residuals(
        self,
        scalars: Sequence[LargestScalar],
        shifts: Sequence[Shift],
        fixed: Sequence[Edit] = (),
        judge: Judge | None = None,
    ) -> dict[RowKey, Array] | None:
        """Return the residuals of the rows with shifted expressions, after the edits `fixed`."""
        change = list(fixed)
        extra: dict[str, Value] = {}
        for i, scalar in enumerate(scalars):
            name = f"_required_{i}_"
            change.append(shifted(scalar.site.source, scalar.site.statement, scalar.node, name))
            extra[name] = shifts[i]
            shifts[i].begin()
        with unguarded():
            return residuals_with(judge or self.judge, self.step.equation.name, change, extra)


@dataclass(frozen=True)
class _SolvedPair:
    """Two expressions with shifts after which rows agree, and the edits found so far that shift each of them."""

    scalars: _ScalarPair
    shifts: tuple[Shift, Shift]
    edits_of_a: list[Edit]
    edits_of_b: list[Edit]


def _required_values(shift: Shift) -> Array:
    """Return the values (k,) that a shifted scalar has."""
    return (shift.value + shift.added)[:, 0]


class _Probe(Shift):
    """A function that returns its argument, and stores whether it is one scalar at each pose."""

    def __init__(self, k: int) -> None:
        super().__init__(k)
        self.is_scalar = True
        self.called = False

    def __call__(self, value: Value, scope: dict[str, Value] | None = None) -> Value:
        self.called = True
        x = unwrapped(value)
        if not self._is_number(x):
            self.is_scalar = False
            return value
        super().__call__(value)
        return value

    def _is_number(self, x: Value) -> bool:
        """Return whether a value is one number for all poses, or one for each; a bool is none."""
        if not isinstance(x, int | float | np.ndarray | np.floating):
            return False
        numbers = np.asarray(x)
        return numbers.dtype.kind in "if" and numbers.shape in ((), (len(self.added),))


def _nodes_below(site: Site, node: ast.AST) -> list[tuple[Site, ast.AST]]:
    """Return the parts of a node that may be scalars of a row; the names in an index are none."""
    if isinstance(node, ast.Subscript):
        return []
    return [(site, child) for child in ast.iter_child_nodes(node)]


def _pairs_of_evaluations(pairs: Sequence[_ScalarPair]) -> Iterator[list[_ScalarPair]]:
    """Yield the pairs in parts of one function each, which one evaluation can have."""
    by_function: dict[tuple[Path, str], list[_ScalarPair]] = {}
    for pair in pairs:
        part = by_function.setdefault(pair[0].function, [])
        part.append(pair)
        if len(part) == _PAIRS_AT_ONCE:
            yield by_function.pop(pair[0].function)
    yield from by_function.values()


def _is_inside(site: Site, node: ast.expr, others: Sequence[tuple[Site, ast.expr]]) -> bool:
    """Return whether an expression is part of one of `others`."""
    start, end = site.source.span(node)
    for site_of_outer, outer in others:
        first, last = site_of_outer.source.span(outer)
        if site_of_outer.source.path == site.source.path and first <= start and end <= last:
            return True
    return False


def _may_be_scalar(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> bool:
    """Return whether a syntax node may be a scalar expression that an edit can change."""
    kinds = (ast.Name, ast.Call, ast.Subscript, ast.BinOp, ast.UnaryOp, ast.Constant)
    if not isinstance(node, kinds) or isinstance(getattr(node, "ctx", None), ast.Store):
        return False
    parent = parents.get(node)
    if isinstance(parent, ast.Call) and parent.func is node:
        return False
    if isinstance(node, ast.Constant):
        # a number in a sum or product is changed with the sum or product; one passed to a function is not
        return type(node.value) in (int, float) and isinstance(parent, ast.Call)
    return not isinstance(parent, ast.Attribute | ast.keyword | ast.Starred)
