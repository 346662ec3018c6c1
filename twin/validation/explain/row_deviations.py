"""Compare a formula with the mechanism row by row (a row is one assignment), with the mechanism's values as inputs.

If the mechanism also has a value of an intermediate symbol (a named point, a passive joint), the symbol is compared,
and then set to the mechanism's value. A wrong row therefore does not affect later rows. Later rows use all other
symbols as computed; if a row disagrees, all rows since the last compared symbol are suspected.
"""

from __future__ import annotations

import contextlib
import copy
import inspect
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import CodeType, FunctionType

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula.contract import Equation, Formula, Stage, arguments
from twin.formula.plain_function import PlainRows
from twin.formula.scalar import Value
from twin.formula.variant_choice import choose
from twin.validation.explain import plain_values, rebuilt_functions
from twin.validation.explain.equation_steps import Helper, RowKey, RowPlace, Step, Tolerance
from twin.validation.explain.expression_shifts import Shift
from twin.validation.explain.function_source import RETURN_NAME, Edit, Source, Statement
from twin.validation.explain.rebuilt_functions import Matrix, Rebuilder, to_array
from twin.validation.explain.reference_values import ReferenceValues
from twin.validation.explain.swivel import fitted_swivel

STAGES: tuple[Stage, ...] = ("inverse", "forward", "helper")

Residuals = dict[RowPlace, Array]
"""Residuals (k, entries) by row: differences from the mechanism in units of the tolerance.

With a noisy CAD, the unit is the largest difference that noise explains; see `Judge`.
"""


_NO_VALUE = object()
"""Placeholder for an element of a returned tuple that uses an unknown name or a wrong index."""


class Judge:
    """A formula in chosen variants, compared with the mechanism's values."""

    def __init__(
        self,
        formula: Formula,
        variants: Mapping[str, str] | str | None,
        reference: ReferenceValues,
        tolerance: Tolerance | None = None,
        limits: Mapping[str, Array] | None = None,
    ) -> None:
        """Compare a formula with the mechanism's values.

        `variants` are the chosen variants by equation; None for the defaults. `limits` are the largest differences
        of symbols (k, 1) that noise explains, in units of the tolerance; 1 for other symbols.
        """
        self.limits = dict(limits or {})
        self.formula = formula
        self.reference = reference
        self.tolerance = tolerance or Tolerance()
        self.variants = choose(formula, variants)
        self.rebuilder = Rebuilder()
        self.notes: list[str] = []
        self._helpers: dict[str, list[Helper]] = {}
        self._zeros: dict[str, Array] = {}
        self.steps: list[Step] = []
        for equation in formula.equations:
            step = self._step(equation)
            if step is not None:
                self.steps.append(step)
        self.residuals: Residuals = {}
        self._run()

    def _run(self) -> None:
        """Run all equations; helpers are last, because they may use the outputs of the others."""
        with np.errstate(all="ignore"):
            for stage in STAGES:
                self._run_stage(stage)

    def on(self, reference: ReferenceValues, only: Collection[str] | None = None) -> Judge:
        """Return a judge that compares the same formula with other values of the mechanism, given by `reference`.

        `only`: names of the equations to run; None for all.
        """
        judge = copy.copy(self)
        judge.reference = reference
        judge.residuals = {}
        judge.notes = []
        judge._zeros = {}
        judge.limits = {}
        for name, limit in self.limits.items():  # limits are of states; at other ones, the largest limit holds
            judge.limits[name] = limit.max(keepdims=True, initial=1.0, where=np.isfinite(limit))
        judge.steps = []
        for step in self.steps:
            if only is None or step.equation.name in only:
                fresh = Step(
                    equation=step.equation,
                    variant=step.variant,
                    source=step.source,
                    codes=step.codes,
                    scope=step.scope,
                    inputs=step.inputs,
                    required=step.required,
                    plain_function=step.plain_function,
                )
                judge.steps.append(fresh)
        judge._run()
        return judge

    def _step(self, equation: Equation) -> Step | None:
        """Return an equation prepared to be run; None, with a note, if its source cannot be split into rows."""
        variant = self.variants.get(equation.name, equation.default)
        function = equation.variants[variant]
        try:
            source = Source(function)
            scope = self.rebuilder.scope(inspect.unwrap(function))  # type: ignore[arg-type]
        except KinematicsError as error:
            self.notes.append(f"{equation.name} ({variant}) was not judged: {error}")
            return None
        if not source.can_be_split:
            self.notes.append(f"{equation.name} ({variant}) was not judged: {source.why_not_split}")
            return None
        codes: list[CodeType] = []
        for statement in source.statements:
            codes.append(source.compiled(statement))
        required, optional = arguments(function)
        plain_function = None
        if isinstance(function, PlainRows):
            plain_function = function
        return Step(
            equation,
            variant,
            source,
            codes,
            scope,
            (*required, *optional),
            tuple(required),
            plain_function=plain_function,
        )

    def step(self, equation: str) -> Step:
        """Return the `Step` of the equation with this name.

        Raises:
            KeyError: the equation is not judged, or not by this judge; see `on`.
        """
        for step in self.steps:
            if step.equation.name == equation:
                return step
        raise KeyError(equation)

    def source_of(self, step: Step, edit: Edit) -> Source:
        """Return the function of an edit for a row: the row's equation, or a function that it calls.

        Raises:
            LookupError: it is neither.
        """
        if edit.is_of(step.source):
            return step.source
        for helper in self.helpers(step):
            if edit.is_of(helper.source):
                return helper.source
        raise LookupError(edit.function)

    def helpers(self, step: Step) -> list[Helper]:
        """Return the plain functions, written in formula files, that a step calls."""
        if step.equation.name in self._helpers:
            return self._helpers[step.equation.name]
        helpers_by_identity: dict[int, Helper] = {}
        _add_helpers(step.source, step.scope, helpers_by_identity)
        helpers = list(helpers_by_identity.values())
        self._helpers[step.equation.name] = helpers
        return helpers

    # -- running ---------------------------------------------------------------------------------------

    def _run_stage(self, stage: Stage) -> None:
        """Run the equations of a stage in their order; each may use the outputs of the earlier ones."""
        computed: dict[str, Value] = {}
        if stage == "helper":
            for step in self.steps:
                computed = {**step.output_values, **computed}
        for step in self.steps:
            if step.stage != stage:
                continue
            self._prepare(step, computed)
            valued = self.reference.symbols.keys() | computed.keys()
            unknown = [name for name in step.required if name not in valued]
            if unknown:
                step.missing = ", ".join(unknown)
                self.notes.append(f"{step.equation.name} ({step.variant}) was not judged: {step.missing} is unknown")
                continue
            if self.reference.free_parameter in step.inputs:
                self._fit_swivel(step, [], {})
            if not self._run_step(step):
                continue
            for name, value in step.output_values.items():
                computed.setdefault(name, value)

    def _prepare(self, step: Step, computed: Mapping[str, Value]) -> None:
        """Set the attributes of a step that depend on the mechanism's values and on the earlier equations."""
        names = step.equation.outputs
        step.computed = dict(computed)
        step.known_outputs = frozenset(names).intersection(self.reference.kinds)
        step.compared_variables = step.known_outputs
        if step.plain_function is not None:
            step.compared_variables = step.known_outputs & plain_values.compared_variables(step.source, names)
        last = step.source.statements[-1]
        returned = getattr(last.node, "value", None)
        # A tuple or a list has `elts`, a dictionary has `values`.
        elements = getattr(returned, "elts", getattr(returned, "values", []))
        step.lines = (last.line,) * len(names)
        if len(elements) == len(names):
            lines = [element.lineno for element in elements]
            step.lines = tuple(lines)

    def _run_step(self, step: Step) -> bool:
        """Run an equation and store its residuals and outputs; return whether it could be run on arrays."""
        scope = self._environment(step, step.computed)
        residuals: Residuals = {}
        statement = step.source.statements[0]
        label = f"{step.equation.name} ({step.variant})"
        try:
            for statement, code in zip(step.source.statements, step.codes, strict=True):
                step.before.append(plain_values.with_copied_values(scope))
                try:
                    exec(code, scope)
                except (NameError, IndexError) as error:
                    # A misspelt name or a wrong index is a fault of the formula, so the rows count as wrong.
                    step.without_value |= self._without_value(step, statement, (), scope, residuals, error)
                    step.stuck = True
                    self.notes.append(f"{label} fails in line {statement.line}: {error}")
                self._compare(step, statement, statement.writes, scope, residuals)
            step.output_values = self._outputs(step, scope, residuals)
        except (NameError, IndexError) as error:
            step.without_value |= {(statement.index, -1)}
            step.stuck = True
            self._count_as_wrong(step, statement, residuals)
            step.output_values = {name: self.reference.symbols[name] for name in step.known_outputs}
            self.notes.append(f"{label} fails in line {statement.line}: {error}")
        except Exception as error:
            step.missing = str(error)
            self.notes.append(f"{label} fails on arrays: {error}")
            return False
        self.residuals |= residuals
        return True

    def _without_value(
        self,
        step: Step,
        statement: Statement,
        edits: Iterable[Edit],
        scope: dict[str, Value],
        residuals: Residuals,
        error: Exception,
    ) -> frozenset[tuple[int, int]]:
        """Go on after a statement without a value, as far as its rows can be told apart; return the places without one.

        An assignment gets the mechanism's values, like one with a wrong value. `error` is that of the statement.

        Raises:
            NameError, IndexError: later statements need what has no value.
        """
        if statement.returns:
            return self._run_elements(step, statement, edits, scope, error)
        if not statement.writes or not step.compared_variables.issuperset(statement.writes):
            raise error
        for i, name in enumerate(statement.writes):
            self._store_without_value(step.place(statement.index, i, name, statement.line), residuals)
            scope[name] = plain_values.to_function_form(step.plain_function, self.reference.symbols[name])
        return frozenset({(statement.index, -1)})

    def _run_elements(
        self, step: Step, statement: Statement, edits: Iterable[Edit], scope: dict[str, Value], error: Exception
    ) -> frozenset[tuple[int, int]]:
        """Evaluate each element of a returned tuple alone; return the places of those that have no value.

        `error` is that of the whole statement.

        Raises:
            NameError, IndexError: no element has a value, or one has none that no row compares.
        """
        outputs = step.equation.outputs
        codes = step.source.elements(statement, edits)
        if len(codes) != len(outputs) or step.plain_function is not None:
            raise error
        values: list[Value] = []
        places: set[tuple[int, int]] = set()
        for i, code in enumerate(codes):
            try:
                exec(code, scope)
            except (NameError, IndexError):
                if outputs[i] not in step.known_outputs:
                    raise
                places.add((statement.index, i))
                scope[RETURN_NAME] = _NO_VALUE
            values.append(scope[RETURN_NAME])
        if len(places) == len(codes):
            raise error
        scope[RETURN_NAME] = tuple(values)
        return frozenset(places)

    def _count_as_wrong(self, step: Step, statement: Statement, residuals: Residuals) -> None:
        """Count all outputs from `statement` on as wrong, because `statement` uses an unknown name."""
        symbols_with_residual = {place.symbol for place in residuals}
        for later in step.source.statements[statement.index :]:
            for i, name in enumerate(later.writes):
                # The last statement returns; it writes an output only by its position.
                compared = step.compared_variables
                line = later.line
                if later.returns:
                    compared = step.known_outputs
                    line = step.lines[i]
                if name in compared and name not in symbols_with_residual:
                    symbols_with_residual.add(name)
                    self._store_without_value(step.place(later.index, i, name, line), residuals)
        last = step.source.statements[-1]
        for i, name in enumerate(step.equation.outputs):
            if name in step.known_outputs and name not in symbols_with_residual:
                symbols_with_residual.add(name)
                self._store_without_value(step.place(last.index, i, name, step.lines[i]), residuals)

    def _store_without_value(self, place: RowPlace, residuals: Residuals) -> None:
        value = to_array(self.reference.symbols[place.symbol], self.reference.k)
        residuals[place] = np.full(value.shape, np.nan)

    def _fit_swivel(self, step: Step, edits: list[Edit], extra: Mapping[str, Value]) -> None:
        """Set the swivel angle of each state so that the residuals of the rows that use this angle are minimal."""

        def rows(angle: Array) -> Residuals:
            step.swivel = {self.reference.free_parameter: angle}
            return self._rerun(step, edits, extra, True, with_later=False)

        with contextlib.suppress(Exception):  # the same errors are raised and handled when the rows are run
            step.swivel = {self.reference.free_parameter: fitted_swivel(rows, self.reference.k)}

    def _environment(self, step: Step, computed: Mapping[str, Value]) -> dict[str, Value]:
        """Return the variables with which an equation starts: its globals and its arguments."""
        values = {**computed, **self.reference.symbols, **step.swivel}
        if step.plain_function is not None:
            return {**step.scope, **plain_values.arguments(step.plain_function, values)}
        scope = dict(step.scope)
        for name in step.inputs:
            if name in values:
                scope[name] = values[name]
        return scope

    def _compare(
        self, step: Step, statement: Statement, names: Iterable[str], scope: dict[str, Value], residuals: Residuals
    ) -> None:
        """Store the residuals of a statement's outputs, then replace the outputs by the mechanism's values."""
        for i, name in enumerate(names):
            if name not in step.compared_variables:
                continue
            place = step.place(statement.index, i, name, statement.line)
            if place in residuals:  # the statement has no value
                continue
            value = plain_values.from_function_form(step.plain_function, scope[name])
            residuals[place] = self.difference(name, value)
            scope[name] = plain_values.to_function_form(step.plain_function, self.reference.symbols[name])

    def _outputs(self, step: Step, scope: Mapping[str, Value], residuals: Residuals) -> dict[str, Value]:
        """Return the outputs of an equation that was run, and store the residuals of the known ones."""
        values = returned_values(step, scope[RETURN_NAME])
        names = step.equation.outputs
        if len(values) != len(names):
            raise ValueError(f"{len(values)} values for {len(names)} outputs")
        last = len(step.source.statements) - 1
        outputs: dict[str, Value] = {}
        for i, name in enumerate(names):
            if name not in step.known_outputs:
                outputs[name] = values[i]
                continue
            place = step.place(last, i, name, step.lines[i])
            if values[i] is _NO_VALUE:
                self._store_without_value(place, residuals)
            else:
                residuals[place] = self.difference(name, values[i])
            outputs[name] = self.reference.symbols[name]
        return outputs

    def difference(self, name: str, value: Value) -> Array:
        """Return the difference of a value and the mechanism's value of the symbol `name`, as in `Residuals`."""
        difference = self._difference(name, value)
        if name in self.limits:
            return difference / self.limits[name]
        return difference

    def _difference(self, name: str, value: Value) -> Array:
        """Return a value minus the mechanism's value of the symbol `name`, (k, entries) in units of the tolerance."""
        true = self.reference.symbols[name]
        kind = self.reference.kinds[name]
        if value is true:  # a row that passes the mechanism's value on agrees exactly
            return self._zeros.setdefault(name, np.zeros_like(to_array(true, self.reference.k)))
        if isinstance(true, Matrix) and (not isinstance(value, Matrix) or value.shape != true.shape):
            raise ValueError(f"{name} does not have the shape of its value in the mechanism")
        if not isinstance(true, Matrix) and isinstance(value, Matrix):
            raise ValueError(f"{name} is a matrix; in the mechanism it is a number or a vector")
        difference = to_array(value, self.reference.k) - to_array(true, self.reference.k)
        if kind == "angle":  # full turns do not count
            return np.arctan2(np.sin(difference), np.cos(difference)) / self.tolerance.angle
        if kind == "pose":  # entries of the rotation have the tolerance of an angle, those of the position of a length
            difference = difference / self.tolerance.angle
            difference[:, [3, 7, 11]] *= self.tolerance.angle / self.tolerance.length
            return difference
        return difference / self.tolerance.length

    # -- trials of edits ----------------------------------------------------------------------------------------

    def trial(
        self, step: Step, edits: list[Edit], extra: Mapping[str, Value] | None = None, angle: Array | None = None
    ) -> Residuals:
        """Return the residuals of the rows that the edits change; call this method with NumPy's warnings disabled.

        The edits change statements of the step or of one helper function. `extra` contains the values of the names that
        the edits define. `angle` are the values (k,) of a free swivel angle; None: it is fitted to the edited rows.

        Raises:
            Exception: any exception of the edited code, including SyntaxError.
        """
        extra = extra or {}
        own_edits: list[Edit] = []
        foreign: list[Edit] = []
        for edit in edits:
            in_step = edit.function == step.source.name and edit.path == step.source.path
            if in_step:
                own_edits.append(edit)
            else:
                foreign.append(edit)
        replaced: list[tuple[dict[str, Value], str, Value]] = []
        if foreign:
            replaced = self._install_helper(step, foreign)
        free = step.swivel
        try:
            if free and angle is not None:
                step.swivel = {self.reference.free_parameter: angle}
            elif free:
                self._fit_swivel(step, own_edits, extra)
                for value in extra.values():
                    if isinstance(value, Shift):  # the values while the swivel was fitted are not those of the row
                        value.begin()
            residuals = self._rerun(step, own_edits, extra, bool(foreign) or bool(free))
            if foreign:
                residuals |= self._from_before(step, foreign)
            return residuals
        finally:
            step.swivel = free
            for scope, name, original in replaced:
                scope[name] = original

    def _from_before(self, step: Step, edits: list[Edit]) -> Residuals:
        """Return the residuals that change in a step because edits of a helper change the output of an earlier step.

        The earlier step calls the helper, and this step uses the output.
        """
        for earlier in self.steps[: self.steps.index(step)]:
            if earlier.stage != step.stage or earlier.missing:
                continue
            passes = set(earlier.equation.outputs) - set(self.reference.kinds)
            if not passes or not self._calls(earlier, edits[0].function):
                continue
            rerun = self._rerun(earlier, [], {}, True)
            changed: Residuals = {}
            for place, residual in rerun.items():
                if place.equation == step.equation.name:
                    changed[place] = residual
            if changed:
                return changed
        return {}

    def _calls(self, step: Step, function: str) -> bool:
        """Return whether a step calls a function of a formula file, directly or through others."""
        names = [helper.source.name for helper in self.helpers(step)]
        return function in names

    def _install_helper(self, step: Step, edits: list[Edit]) -> list[tuple[dict[str, Value], str, Value]]:
        """Install an edited helper; return (globals, name, original function) of each use, to restore the original."""
        helpers = self.helpers(step)
        helpers_by_name = {helper.source.name: helper for helper in reversed(helpers)}  # of several, the first one
        helper = helpers_by_name[edits[0].function]
        own_globals = helper.function.__globals__
        scope: dict[str, Value] = dict(own_globals)
        exec(helper.source.whole(edits), scope)
        original = scope[helper.source.name]
        # The edited text ran in a copy of the globals; the function must see the real ones, where searches put names.
        defaults = inspect.unwrap(helper.function).__defaults__  # type: ignore[attr-defined]
        edited = FunctionType(original.__code__, own_globals, original.__name__, defaults)
        scopes = [own_globals]
        for step_with_scope in self.steps:
            scopes.append(step_with_scope.scope)
        for step_with_scope in helpers:
            scopes.append(step_with_scope.function.__globals__)
        replaced: list[tuple[dict[str, Value], str, Value]] = []
        for scope in scopes:
            for name, value in list(scope.items()):
                if value is helper.function:
                    replaced.append((scope, name, value))
                    scope[name] = edited
        return replaced

    def _rerun(
        self, step: Step, edits: list[Edit], extra: Mapping[str, Value], from_start: bool, with_later: bool = True
    ) -> Residuals:
        """Run an equation after edits, from the first edited statement on; return the residuals that may change.

        `from_start`: run the equation from its first statement. `with_later`: also run the later equations that use its
        outputs.
        """
        statements = step.source.statements
        codes = list(step.codes)
        writes: dict[int, tuple[str, ...]] = {}  # other left sides, by index of the edited statement
        edited = _by_statement(edits)
        for i, own_edits in edited.items():
            codes[i] = step.source.compiled(statements[i], own_edits)
            writes[i] = _renamed(statements[i].writes, own_edits)
        if from_start:
            first = 0
            scope = self._environment(step, step.computed)
        else:
            first = min(edited)
            scope = plain_values.with_copied_values(step.before[first])
        from_start |= step.stuck  # there is no earlier result to reuse
        self._define_arguments(step, edits, scope)
        for name, value in extra.items():
            scope.setdefault(name, value)
        residuals: Residuals = {}
        changed_variables: set[str] = set()  # variables whose values differ from those of the unedited equation
        for statement in statements[first:]:
            i = statement.index
            names = writes.get(i, statement.writes)
            if from_start or i in edited or changed_variables & statement.reads:
                if not self.run_statement(step, statement, codes[i], edits, scope, residuals):
                    self._count_as_wrong(step, statement, residuals)
                    return residuals
                self._compare(step, statement, names, scope, residuals)
                changed_variables |= set(names) - step.compared_variables
                continue
            if statement.returns:
                return residuals
            # What the statement writes does not change, because its inputs do not change.
            after = step.before[i + 1]
            for name in names:
                scope[name] = plain_values.with_copied_values({name: after[name]})[name]
                changed_variables.discard(name)
        outputs = self._outputs(step, scope, residuals)
        changed = set(outputs).difference(self.reference.kinds)
        if changed and with_later:
            self._downstream(step, outputs, changed, residuals)
        return residuals

    def run_statement(
        self,
        step: Step,
        statement: Statement,
        code: CodeType,
        edits: Sequence[Edit],
        scope: dict[str, Value],
        residuals: Residuals,
    ) -> bool:
        """Run a statement in an edited equation; return whether the next one can be run.

        A statement, or elements of the returned tuple, may have no value if they had none before the edits, which are
        elsewhere: they may repair other rows. The rows of an assignment without a value are stored in `residuals`.

        Raises:
            Exception: any exception of the statement that it did not raise before the edits.
        """
        try:
            exec(code, scope)
        except (NameError, IndexError) as error:
            own_edits = _by_statement(edits).get(statement.index, [])
            as_before = (statement.index, -1) in step.without_value and not own_edits
            try:
                places = self._without_value(step, statement, own_edits, scope, residuals, error)
            except (NameError, IndexError):
                if as_before:
                    return False
                raise
            if not (as_before or places <= step.without_value):
                raise
        return True

    def _define_arguments(self, step: Step, edits: list[Edit], scope: dict[str, Value]) -> None:
        """Set the values of symbols that edits add to the arguments of the function."""
        for edit in edits:
            if not edit.define or edit.define[1]:  # a definition with an expression is an alias
                continue
            name = edit.define[0]
            for values in (step.computed, self.reference.symbols):
                if name in values:
                    scope.setdefault(name, plain_values.to_function_form(step.plain_function, values[name]))

    def _downstream(self, step: Step, outputs: dict[str, Value], changed: set[str], residuals: Residuals) -> None:
        """Run the later equations that use changed outputs, and store their residuals."""
        computed = {**step.computed, **outputs}
        for later in self.steps[self.steps.index(step) + 1 :]:
            if later.stage != step.stage or later.missing:
                continue
            if not changed & set(later.inputs):
                computed = {**later.output_values, **computed}
                continue
            # Do not reuse earlier results: a helper that this equation calls may be edited.
            scope = {**plain_values.with_copied_values(later.before[0]), **later.scope}
            if later.plain_function is not None:
                scope |= plain_values.arguments(later.plain_function, {**self.reference.symbols, **computed})
            else:
                for name in later.inputs:
                    if name in changed:
                        scope[name] = computed[name]
            for statement, code in zip(later.source.statements, later.codes, strict=True):
                exec(code, scope)
                self._compare(later, statement, statement.writes, scope, residuals)
            outputs_of_later = self._outputs(later, scope, residuals)
            changed |= set(outputs_of_later).difference(self.reference.kinds)
            for name, value in outputs_of_later.items():
                if name in changed or name not in computed:
                    computed[name] = value

    # -- many edits at one pose ----------------------------------------------------------------------------------------

    def of_size(self, size: int) -> Judge:
        """Return this judge of one pose for `size` values of each symbol; it has no residuals of its own.

        The mechanism's values stay single numbers: NumPy repeats them.
        """
        judge = copy.copy(self)
        judge.reference = replace(self.reference, k=size)
        judge.residuals = {}
        judge._zeros = {}
        return judge

    def initial_variables(self, step: Step) -> dict[str, Value]:
        """Return the variables with which an equation starts, and all symbols that edits may add as arguments."""
        variables: dict[str, Value] = {}
        for name, value in {**step.computed, **self.reference.symbols}.items():
            variables[name] = plain_values.to_function_form(step.plain_function, value)
        return plain_values.with_copied_values(variables | self._environment(step, step.computed))

    def residuals_after(self, step: Step, statement: Statement, scope: dict[str, Value]) -> Residuals:
        """Return the residuals after `statement` was run in `scope`: of its rows, of later ones, of later equations.

        Raises:
            Exception: any exception of the statements and equations.
        """
        residuals: Residuals = {}
        self._compare(step, statement, statement.writes, scope, residuals)
        for later in step.source.statements[statement.index + 1 :]:
            if not self.run_statement(step, later, step.codes[later.index], (), scope, residuals):
                return residuals
            self._compare(step, later, later.writes, scope, residuals)
        outputs = self._outputs(step, scope, residuals)
        changed = set(outputs).difference(self.reference.kinds)
        if changed:
            self._downstream(step, outputs, changed, residuals)
        return residuals

    # -- failing rows -----------------------------------------------------------------------------------

    def failing(self) -> list[RowPlace]:
        """Return the rows whose residual exceeds the tolerance or is NaN."""
        return [place for place, residual in self.residuals.items() if worst(residual) > 1]

    def failing_rows(self) -> set[RowKey]:
        """Return the keys of the rows of `failing`."""
        return {place.key for place in self.failing()}


def _add_helpers(source: Source, scope: Mapping[str, Value], helpers_by_identity: dict[int, Helper]) -> None:
    """Add the functions of formula files that a function calls, directly or through others, by their identity."""
    names: set[str] = set()
    for statement in source.statements:
        names |= statement.reads
    for name in sorted(names):
        function = scope.get(name)
        if not isinstance(function, FunctionType) or id(function) in helpers_by_identity:
            continue
        if not rebuilt_functions.is_of_formula(function):  # functions of the library are right
            continue
        try:
            called = Source(function)
        except KinematicsError:  # its source cannot be edited
            continue
        helpers_by_identity[id(function)] = Helper(called, function)
        _add_helpers(called, function.__globals__, helpers_by_identity)


def _by_statement(edits: Iterable[Edit]) -> dict[int, list[Edit]]:
    """Return the edits of each edited statement of one function, by the statement's index."""
    edits_of_statement: dict[int, list[Edit]] = {}
    for edit in edits:
        edits_of_statement.setdefault(edit.statement, []).append(edit)
    return edits_of_statement


def _renamed(names: tuple[str, ...], edits: Iterable[Edit]) -> tuple[str, ...]:
    """Return the names on the left side of a statement after edits of the left side."""
    left_side = list(names)
    for edit in edits:
        if edit.kind != "left side":
            continue
        for i, name in enumerate(names):
            if name == edit.old:
                left_side[i] = edit.new
    return tuple(left_side)


def returned_values(step: Step, value: Value) -> list[Value]:
    """Split what the function of a step returned into one value for each output."""
    if step.plain_function is not None:
        value = plain_values.output_values(step.plain_function, value)
    if isinstance(value, tuple | list):
        return list(value)
    return [value]


def by_row(residuals: Residuals) -> dict[RowKey, Array]:
    """Return residuals by the keys of their rows, which do not depend on the symbols that edits assign."""
    return {place.key: residual for place, residual in residuals.items()}


def entries_of(residuals: Mapping[RowKey, Array], rows: Iterable[RowKey]) -> Array:
    """Return the residuals of some rows beside each other, (k, entries of all rows)."""
    columns = [residuals[row] for row in rows]
    return np.hstack(columns)


def worst(residual: Array) -> float:
    """Return the largest absolute residual; infinity if one is NaN."""
    largest = float(np.abs(residual).max(initial=0.0))
    if math.isnan(largest):
        return float("inf")
    return largest


def trial_residuals(
    judge: Judge,
    step: Step,
    edits: list[Edit],
    extra: Mapping[str, Value] | None = None,
    angle: Array | None = None,
) -> Residuals | None:
    """Return the residuals of `Judge.trial`, or None if the edited text cannot be run."""
    try:
        return judge.trial(step, edits, extra, angle)
    except Exception:
        return None
