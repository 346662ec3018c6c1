"""Try all pairs of edits in two statements of an equation at one pose, by few evaluations.

Each edit of the first statement is evaluated alone. The values of all these edits then go through the statements
between as one array, each edit of the second statement is evaluated on this array, and the values of all pairs go
through the rest of the equation, and through the equations that use it, at once. So N and M edits need about N + M
short evaluations, not N M long ones. One pose excludes nearly all pairs; the others are tried at all poses.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, product
from types import CodeType

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.candidate import TOKEN_KINDS
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.expression import Site
from twin.validation.explain.function_source import RETURN_NAME, ByteRange, Edit, Statement, TextPlace
from twin.validation.explain.operand_pairs import EvaluatedPairs, operand_pairs, stacked, tiled, value_form
from twin.validation.explain.plain_values import with_copied_values
from twin.validation.explain.rebuilt_functions import unguarded
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.swivel import LINEARITY_ANGLE, SWIVEL_ANGLES, at_best_swivel, is_linear_in_swivel
from twin.validation.explain.tokens import is_sum, names_in

_MOST_PAIRS_AT_ONCE = 100_000
"""Maximum number of pairs in one evaluation."""

_VECTOR_ENTRIES = 3
"""Number of entries of a vector."""

_LONGEST_TEXT = 60
"""Maximum length of an expression of the file that is added as a term or factor."""

_MOST_TEXTS = 24
"""Maximum number of such expressions of each form."""

_MOST_PRODUCTS = 60
"""Maximum number of products of a scalar and a vector that are added as terms."""

_MOST_YIELDED_PAIRS = 60
"""Maximum number of pairs that are yielded of two statements, or of one."""

_MOST_RANKED_PAIRS = 2000
"""Maximum number of pairs in one statement of which those with the likeliest kinds are chosen."""

_Scope = dict[str, Value]
"""Values of variables and globals by name, at one pose."""

_Residuals = tuple[list[tuple[Edit, ...]], dict[RowKey, Array]]
"""Edits of a statement, and the residuals (edits, entries) of rows after each."""


@dataclass
class _WrittenValues:
    """Edits (or pairs of edits) of a statement, with the values that it then writes, as one array for all edits."""

    edits: list[tuple[Edit, ...]] = field(default_factory=list)
    written: list[list[Value]] = field(default_factory=list)


class StatementPairs:
    """Search for two edits in the statements of one equation."""

    def __init__(self, judge: Judge, equation: str, sites: Sequence[Site], rows: Sequence[RowKey]) -> None:
        """Set up the search for the wrong rows `rows`; `sites` are statements of the equation on which they depend."""
        pose = [judge.reference.k // 2]
        with unguarded():
            self.judge = judge.on(judge.reference.repeated(pose, 1))
        self.step = self.judge.step(equation)
        self.rows = list(rows)
        self.sites = sorted(sites, key=lambda site: site.statement.index)
        self._codes: dict[tuple[Edit, ...], CodeType | None] = {}
        self._first_values_of: dict[tuple[int, tuple[tuple[Edit, ...], ...], float | None], list[_WrittenValues]] = {}
        """Values after edits of a statement, by its index, the edits and the swivel angle."""

    def in_two_statements(self, deadline: Deadline, scalars: Sequence[TextPlace] = ()) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits in different statements after which a row agrees at one pose, of one token first.

        Pairs of other kinds are left out if both are in the expressions at the places `scalars`, because
        `RequiredPairs` finds these.
        """
        statements = [site.statement for site in self.sites]
        places = list(combinations(statements, 2))
        places.sort(key=lambda pair: pair[1].index - pair[0].index)  # two misprints are often near each other
        for edits in (self._tokens, self._all):
            for first, second in places:
                if deadline.passed:
                    return
                result_is_used = not self.step.compared_variables.issuperset(first.writes)
                if not (result_is_used or first.index in self._undefined):
                    continue
                # a name without a value elsewhere would still have none
                if not self._undefined.keys() <= {first.index, second.index}:
                    continue
                firsts = self._defining(first, edits[first.index])
                seconds = self._defining(second, edits[second.index])
                if edits is self._tokens:
                    yield from self._pairs(first, second, firsts, seconds, deadline)
                    continue
                firsts_outside, firsts_inside = _outside_and_inside(firsts, scalars)
                seconds_outside, _ = _outside_and_inside(seconds, scalars)
                yield from self._pairs(first, second, firsts_outside, seconds, deadline)
                yield from self._pairs(first, second, firsts_inside, seconds_outside, deadline)

    def in_one_statement(self, deadline: Deadline) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits in one statement after which a row agrees at one pose."""
        for site in self.sites:
            if deadline.passed:
                return
            if not self._undefined.keys() <= {site.statement.index}:  # names elsewhere would have no value
                continue
            edits = self._all[site.statement.index]
            runs: list[list[EvaluatedPairs]] = []
            with unguarded(), np.errstate(all="ignore"):
                for angle in self._angles:
                    scope = self._before(site.statement, angle)
                    if scope is None:
                        break
                    runs.append(list(operand_pairs(site, edits, scope, self._residuals_after, deadline)))
            if len(runs) < len(self._angles):
                continue
            pairs: list[tuple[Edit, Edit]] = []
            for edits_of_second, edits_of_first in self._agreeing_pairs(runs, _MOST_RANKED_PAIRS):
                (first,) = edits_of_first
                (second,) = edits_of_second
                pairs.append((first, second))
            pairs.sort(key=_edits_of_other_kinds)  # misprints of one token are likeliest
            yield from pairs[:_MOST_YIELDED_PAIRS]

    def likely_edits(self, statement: Statement, edits: Sequence[Edit], deadline: Deadline) -> set[Edit] | None:
        """Return the edits of a statement that may be repairs: a row agrees at one pose, or the edit was not evaluated.

        Return None if this is not known, because rows are not linear in sine and cosine of the swivel.
        """
        # An edit that needs a new name with an expression is evaluated elsewhere.
        usable = [edit for edit in edits if not (edit.define and edit.define[1])]
        if not self._linear or deadline.passed:
            return None
        runs: list[list[_Residuals]] = []
        with unguarded(), np.errstate(all="ignore"):
            for angle in self._angles:
                scope = self._before(statement, angle)
                if scope is None:
                    return None
                runs.append(list(self._residuals_of_each(statement, usable, scope, deadline)))
        if deadline.passed:
            return None
        possible = set(edits).difference(usable)
        for at_angles in zip(*runs, strict=False):
            trials, _ = at_angles[0]
            residuals_at_angles = [residuals for _, residuals in at_angles]
            for n in _agreeing_trials(residuals_at_angles, self.rows):
                possible.update(trials[n])
        return possible

    def _residuals_of_each(
        self, statement: Statement, edits: Sequence[Edit], scope: _Scope, deadline: Deadline
    ) -> Iterator[_Residuals]:
        """Yield edits of a statement after which its values have one form, with the residuals of rows after each."""
        for values in self._each(statement, _single_trials(edits), scope, 1, deadline):
            entered = self._entered(statement, values, scope, 1)
            residuals = self._residuals_after(statement, entered, len(values.edits))
            yield values.edits, residuals or {}

    @cached_property
    def _angles(self) -> tuple[float | None, ...]:
        """The swivel angles in rad at which rows are evaluated; one None without a swivel."""
        if self.step.swivel:
            return SWIVEL_ANGLES
        return (None,)

    @cached_property
    def _linear(self) -> bool:
        """Whether the rows are linear in sine and cosine of the swivel; see `at_best_swivel`."""
        if not self.step.swivel:
            return True
        last = self.step.source.statements[-1]
        at_angles: list[dict[RowKey, Array]] = []
        with unguarded(), np.errstate(all="ignore"):
            for angle in (*SWIVEL_ANGLES, LINEARITY_ANGLE):
                scope = self._before(last, angle)
                if scope is None or not self._between([last], scope):
                    return False
                at_angles.append(self._residuals_after(last, scope, 1) or {})
        for row in self.rows:
            of_row = [residuals[row] for residuals in at_angles if row in residuals]
            if len(of_row) < len(at_angles):
                continue
            if not is_linear_in_swivel(*of_row):
                return False
        return True

    @cached_property
    def _all(self) -> dict[int, list[Edit]]:
        """All edits of each statement, by its index: those that are tried alone as well, and terms of inner sums."""
        edits = {}
        for site in self.sites:
            edits[site.statement.index] = [*site.edits, *inner_terms(site), *self._elsewhere(site)]
        return edits

    def _elsewhere(self, site: Site) -> Iterator[Edit]:
        """Yield edits that add a term, or a factor of a term, that stands in another function of the same file."""
        with unguarded(), np.errstate(all="ignore"):
            scope = self._before(site.statement, None)
        if scope is None:
            return
        vectors, scalars = self._known_texts(site, scope)
        vectors = [*vectors, *self._scaled(site, scope)]
        for node, parent in site.parents.items():
            if not isinstance(node, ast.expr) or isinstance(node, ast.Tuple):
                continue
            if isinstance(parent, ast.Assign) and node in parent.targets:
                continue
            is_whole = _gives_result(parent)
            if isinstance(parent, ast.Tuple):
                is_whole = _gives_result(site.parents.get(parent))
            start, end = site.source.span(node)
            if is_whole:
                for text in vectors:
                    yield site.insertion(end, f" + {text}")
                    yield site.insertion(end, f" - {text}")
            # a factor before a sum would belong to its first term, which is a node of its own
            if (is_whole or is_sum(parent)) and not is_sum(node):
                for text in scalars:
                    yield site.insertion(start, f"{text} * ")

    def _scaled(self, site: Site, scope: _Scope) -> list[str]:
        """Return the products of a scalar and a vector that the function's names stand for."""
        scalars: list[str] = []
        vectors: list[str] = []
        names = set(site.source.arguments)
        for statement in site.source.statements:
            names.update(statement.writes)
        for name in sorted(names & site.pool.names & site.pool.arguments):
            kind = value_form(scope.get(name), 1)
            if kind == "scalar":
                scalars.append(name)
            elif kind == (_VECTOR_ENTRIES, 1):
                vectors.append(name)
        if len(vectors) * len(scalars) > _MOST_PRODUCTS:
            return []
        return [f"{scalar} * {vector}" for vector, scalar in product(vectors, scalars)]

    def _known_texts(self, site: Site, scope: _Scope) -> tuple[list[str], list[str]]:
        """Return the (vectors, calls that are scalars) of the file, with names that a statement can use."""
        names = site.pool.names & site.pool.arguments
        usable = names | self.step.scope.keys()
        is_call: dict[str, bool] = {}  # by text; a call needs no parentheses
        for node in ast.walk(ast.parse(site.source.data)):
            if not isinstance(node, ast.Call | ast.BinOp | ast.Subscript):
                continue
            read = names_in(node)
            if read & names and read <= usable:
                is_call[ast.unparse(node)] = isinstance(node, ast.Call)
        vectors: list[str] = []
        scalars: list[str] = []
        with unguarded(), np.errstate(all="ignore"):
            for text in sorted(is_call, key=len):
                if len(text) > _LONGEST_TEXT:
                    break
                try:
                    text_form = value_form(eval(text, dict(scope)), 1)
                except Exception:  # values of other forms than in the function from which the text is
                    continue
                if text_form == (_VECTOR_ENTRIES, 1):
                    if not is_call[text]:
                        text = f"({text})"
                    vectors.append(text)
                elif text_form == "scalar" and is_call[text]:
                    scalars.append(text)
        return vectors[:_MOST_TEXTS], scalars[:_MOST_TEXTS]

    @cached_property
    def _undefined(self) -> dict[int, list[ByteRange]]:
        """The names without a value in each statement that has some, by its index: the edits must replace all."""
        ranges: dict[int, list[ByteRange]] = {}
        for site in self.sites:
            if site.undefined:
                ranges[site.statement.index] = site.undefined
        return ranges

    def _defining(self, statement: Statement, edits: Sequence[Edit]) -> list[Edit]:
        """Return the edits of a statement after which all its names have a value."""
        parts = self._undefined.get(statement.index, ())
        defining: list[Edit] = []
        for edit in edits:
            if all(edit.replaces(part) for part in parts):
                defining.append(edit)
        return defining

    @cached_property
    def _tokens(self) -> dict[int, list[Edit]]:
        """The edits of one token of each statement, by its index."""
        edits_of_tokens: dict[int, list[Edit]] = {}
        for site in self.sites:
            edits_of_tokens[site.statement.index] = [edit for edit in site.edits if edit.kind in TOKEN_KINDS]
        return edits_of_tokens

    def _pairs(
        self,
        first: Statement,
        second: Statement,
        firsts: Sequence[Edit],
        seconds: Sequence[Edit],
        deadline: Deadline,
    ) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of an edit of `first` and one of `second`."""
        if not firsts or not seconds:
            return
        trials = _single_trials(firsts)
        runs: list[list[EvaluatedPairs]] = []
        with unguarded(), np.errstate(all="ignore"):
            for angle in self._angles:
                runs.append(list(self._run(first, second, trials, seconds, angle, deadline)))
        for edits_of_second, edits_of_first in self._agreeing_pairs(runs, _MOST_YIELDED_PAIRS):
            (first_edit,) = edits_of_first
            (second_edit,) = edits_of_second
            yield first_edit, second_edit

    def _agreeing_pairs(
        self, runs: Sequence[Sequence[EvaluatedPairs]], most: int
    ) -> Iterator[tuple[tuple[Edit, ...], tuple[Edit, ...]]]:
        """Yield (edits of the second place, edits of the first one) after which a row agrees, for each swivel angle.

        `runs` are the results of `_run` or `operand_pairs`, for each angle; `most` is the maximum number of pairs.
        """
        count = 0
        for at_angles in zip(*runs, strict=False):
            seconds, firsts, _ = at_angles[0]
            has_same_pairs = True
            residuals: list[dict[RowKey, Array]] = []
            for seconds_at_angle, firsts_at_angle, residuals_at_angle in at_angles:
                # At an angle where an edit has no value, the pairs are others.
                has_same_pairs &= (seconds_at_angle, firsts_at_angle) == (seconds, firsts)
                residuals.append(residuals_at_angle)
            if not has_same_pairs:
                continue
            for pair in _agreeing_trials(residuals, self.rows):
                count += 1
                if count > most:
                    return
                i, j = divmod(pair, len(firsts))
                yield seconds[i], firsts[j]

    def _run(
        self,
        first: Statement,
        second: Statement,
        trials: Sequence[tuple[Edit, ...]],
        seconds: Sequence[Edit],
        angle: float | None,
        deadline: Deadline,
    ) -> Iterator[EvaluatedPairs]:
        """Yield edits of the second statement, edits of the first, and the residuals (pairs, entries) of rows.

        All edits of the first statement come with the first edit of the second one, then with the next one.
        """
        scope = self._before(first, angle)
        if scope is None:
            return
        for values in self._first_values(first, trials, scope, angle, deadline):
            size = len(values.edits)
            changed = self._entered(first, values, scope, 1)
            between = self.step.source.statements[first.index + 1 : second.index]
            if not self._between(between, changed):
                continue
            most = max(_MOST_PAIRS_AT_ONCE // size, 1)
            for start in range(0, len(seconds), most):
                part = _single_trials(seconds[start : start + most])
                for second_values in self._each(second, part, changed, size, deadline):
                    entered = self._entered(second, second_values, changed, size)
                    residuals = self._residuals_after(second, entered, size * len(second_values.edits))
                    if residuals is not None:
                        yield second_values.edits, values.edits, residuals

    def _before(self, statement: Statement, angle: float | None) -> _Scope | None:
        """Return the values before a statement at the pose; None if an earlier statement has no value."""
        free = self.step.swivel
        if free and angle is not None:
            self.step.swivel = dict.fromkeys(free, np.array([angle]))
        try:
            scope = self.judge.initial_variables(self.step)
        finally:
            self.step.swivel = free
        earlier = self.step.source.statements[: statement.index]
        if not self._between(earlier, scope):
            return None
        return scope

    def _between(self, statements: Sequence[Statement], scope: _Scope) -> bool:
        """Run statements without edits; return whether they have values."""
        try:
            for statement in statements:
                if not self.judge.run_statement(self.step, statement, self.step.codes[statement.index], (), scope, {}):
                    return False
                for name in self.step.compared_variables.intersection(statement.writes):
                    scope[name] = self.judge.reference.symbols[name]
        except Exception:  # an edit of an earlier statement may make any text invalid
            return False
        return True

    def _each(
        self, statement: Statement, trials: Sequence[tuple[Edit, ...]], scope: _Scope, size: int, deadline: Deadline
    ) -> Iterator[_WrittenValues]:
        """Yield the values that a statement writes after each of some edits, those of the same form together."""
        names = (RETURN_NAME,) if statement.returns else statement.writes
        by_form: dict[Value, _WrittenValues] = {}
        filled: _Scope = {}  # a statement may change these in place
        for name, value in scope.items():
            if isinstance(value, list | dict):
                filled[name] = value
        for edits in trials:
            if deadline.passed:
                break
            code = self._compiled(statement, edits)
            if code is None:
                continue
            own_scope = {**scope, **with_copied_values(filled)}
            try:
                exec(code, own_scope)
                written = [own_scope[name] for name in names]
            except Exception:  # an edit may be any invalid text: a name without value, vectors of other lengths
                continue
            forms = [value_form(value, size) for value in written]
            if None in forms:
                continue
            values = by_form.setdefault(tuple(forms), _WrittenValues())
            values.edits.append(edits)
            values.written.append(written)
        yield from by_form.values()

    def _first_values(
        self,
        statement: Statement,
        trials: Sequence[tuple[Edit, ...]],
        scope: _Scope,
        angle: float | None,
        end: Deadline,
    ) -> list[_WrittenValues]:
        """Return what `_each` yields for the first edited statement; it is kept, because many statements may follow."""
        key = (statement.index, tuple(trials), angle)
        if key not in self._first_values_of:
            values = list(self._each(statement, trials, scope, 1, end))
            if end.passed:  # the values are not those of all edits
                return values
            self._first_values_of[key] = values
        return self._first_values_of[key]

    def _compiled(self, statement: Statement, edits: tuple[Edit, ...]) -> CodeType | None:
        """Return a statement compiled after edits; None if the text is not valid."""
        if edits not in self._codes:
            try:
                self._codes[edits] = self.step.source.compiled(statement, edits)
            except (SyntaxError, ValueError):
                self._codes[edits] = None
        return self._codes[edits]

    def _entered(self, statement: Statement, values: _WrittenValues, scope: _Scope, size: int) -> _Scope:
        """Return a scope with the values of all edits, each of which has `size` values, as one array."""
        count = len(values.edits)
        entered: _Scope = {}
        for name, value in scope.items():
            entered[name] = tiled(value, size, count)
        names = (RETURN_NAME,) if statement.returns else statement.writes
        for n, name in enumerate(names):
            values_of_name = [written[n] for written in values.written]
            entered[name] = stacked(values_of_name, size)
        return entered

    def _residuals_after(self, statement: Statement, scope: _Scope, size: int) -> dict[RowKey, Array] | None:
        """Return the residuals of the rows of a statement and of those after it; None without a value."""
        try:
            deviations = self.judge.of_size(size).residuals_after(self.step, statement, scope)
        except Exception:  # an edit may give values with which a later statement cannot be evaluated
            return None
        residuals: dict[RowKey, Array] = {}
        for place, residual in deviations.items():
            if place.key in self.rows:
                residuals[place.key] = residual
        return residuals


def _single_trials(edits: Sequence[Edit]) -> list[tuple[Edit, ...]]:
    """Return edits each of which is tried alone."""
    return [(edit,) for edit in edits]


def _outside_and_inside(edits: Sequence[Edit], places: Sequence[TextPlace]) -> tuple[list[Edit], list[Edit]]:
    """Return (edits in none of some parts of files, edits in one of them)."""
    outside: list[Edit] = []
    inside: list[Edit] = []
    for edit in edits:
        is_inside = False
        for path, start, end in places:
            is_inside |= path == edit.path and edit.is_within((start, end))
        if is_inside:
            inside.append(edit)
        else:
            outside.append(edit)
    return outside, inside


def _edits_of_other_kinds(pair: tuple[Edit, Edit]) -> int:
    """Return how many of two edits change more than one token."""
    first, second = pair
    return (first.kind not in TOKEN_KINDS) + (second.kind not in TOKEN_KINDS)


def _gives_result(node: ast.AST | None) -> bool:
    """Return whether a statement assigns or returns a value."""
    return isinstance(node, ast.Assign | ast.Return)


def inner_terms(site: Site) -> Iterator[Edit]:
    """Yield edits that add a name or its square to a sum inside another expression of a statement."""
    names = sorted(site.pool.names & site.pool.arguments)
    for node, parent in site.parents.items():
        if not is_sum(node):
            continue
        if not isinstance(parent, ast.BinOp) or is_sum(parent):
            continue
        _, end = site.source.span(node)
        for name in names:
            for new in (f" + {name}", f" - {name}", f" + {name}**2", f" - {name}**2"):
                yield site.insertion(end, new)


def _agreeing_trials(at_angles: Sequence[Mapping[RowKey, Array]], rows: Sequence[RowKey]) -> list[int]:
    """Return the indices of the pairs after which a row agrees, those first after which most rows do.

    `at_angles`: residuals (pairs, entries) by row, for each value of the swivel.
    """
    counts: Counter[int] = Counter()  # number of rows that agree, by pair
    for row in rows:
        residuals = [at_angle[row] for at_angle in at_angles if row in at_angle]
        if len(residuals) < len(at_angles):
            continue
        with np.errstate(all="ignore"):
            best = residuals[0]
            if len(residuals) > 1:
                best = at_best_swivel(*residuals)
            largest = np.abs(best).max(axis=1)
        counts.update(np.flatnonzero(largest <= 1.0).tolist())
    return sorted(counts, key=lambda n: (-counts[n], n))
