"""Compare a formula with the mechanism row by row (a row is one assignment), with the mechanism's values as inputs.

If the mechanism also has a value of an intermediate symbol (a named point, a passive joint), the symbol is compared,
and then set to the mechanism's value. A wrong row therefore does not affect later rows. Later rows use all other
symbols as computed; if a row disagrees, all rows since the last compared symbol are suspected.
"""

from __future__ import annotations

import contextlib
import copy
import inspect
from collections.abc import Collection, Iterable, Mapping
from types import FunctionType
from typing import Any

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula.contract import Equation, Formula, Stage, arguments
from twin.formula.flow import choose
from twin.formula.rows import PlainRows
from twin.validation.explain import numeric, plain
from twin.validation.explain.numeric import Matrix, Rebuilder, to_array
from twin.validation.explain.rows import Helper, Place, Step, Tolerance
from twin.validation.explain.source import OUT, Edit, Source, Statement
from twin.validation.explain.swivel import fitted
from twin.validation.explain.truth import Truth

STAGES: tuple[Stage, ...] = ("inverse", "forward", "helper")

Residuals = dict[Place, Array]
"""Residuals (k, entries) by row: differences from the mechanism in units of the tolerance.

With a noisy CAD, the unit is the largest difference that noise explains; see `Judge`.
"""


class Judge:
    """A formula in chosen variants, compared with the mechanism's values."""

    def __init__(
        self,
        formula: Formula,
        variants: Mapping[str, str] | str | None,
        truth: Truth,
        tolerance: Tolerance | None = None,
        limits: Mapping[str, Array] | None = None,
    ) -> None:
        """Compare a formula with the mechanism's values.

        `variants` are the chosen variants by equation; None for the defaults. `limits` are the largest differences
        of symbols (k, 1) that noise explains, in units of the tolerance; 1 for other symbols.
        """
        self.limits = dict(limits or {})
        self.formula, self.truth, self.tolerance = formula, truth, tolerance or Tolerance()
        self.variants = choose(formula, variants)
        self.rebuild = Rebuilder()
        self.notes: list[str] = []
        self._helpers: dict[str, list[Helper]] = {}
        self._zeros: dict[str, Array] = {}
        self.steps = [s for e in formula.equations if (s := self._step(e)) is not None]
        self.residuals: Residuals = {}
        self._run()

    def _run(self) -> None:
        with np.errstate(all="ignore"):
            for stage in STAGES:
                self._run_stage(stage)

    def on(self, truth: Truth, only: Collection[str] | None = None) -> Judge:
        """Return a judge that compares the same formula with other values of the mechanism, given by `truth`.

        `only`: names of the equations to run; None for all.
        """
        other = copy.copy(self)
        other.truth, other.residuals, other.notes, other._zeros, other.limits = truth, {}, [], {}, {}
        for name, limit in self.limits.items():  # at other states, the largest limit holds
            other.limits[name] = limit.max(keepdims=True, initial=1.0, where=np.isfinite(limit))
        other.steps = [
            Step(s.equation, s.variant, s.source, s.codes, s.scope, s.inputs, s.required, plain=s.plain)
            for s in self.steps
            if only is None or s.equation.name in only
        ]
        other._run()
        return other

    def _step(self, equation: Equation) -> Step | None:
        variant = self.variants.get(equation.name, equation.default)
        function = equation.variants[variant]
        try:
            source = Source(function)
            scope = self.rebuild.scope(inspect.unwrap(function))  # type: ignore[arg-type]
        except KinematicsError as error:
            self.notes.append(f"{equation.name} ({variant}) was not judged: {error}")
            return None
        if not source.plain:
            self.notes.append(f"{equation.name} ({variant}) was not judged: {source.why}")
            return None
        codes = [source.compiled(s) for s in source.statements]
        required, optional = arguments(function)
        row = function if isinstance(function, PlainRows) else None
        return Step(equation, variant, source, codes, scope, (*required, *optional), tuple(required), plain=row)

    def step(self, equation: str) -> Step:
        """Return the `Step` of the equation with this name."""
        return next(s for s in self.steps if s.equation.name == equation)

    def helpers(self, step: Step) -> list[Helper]:
        """Return the plain functions, written in formula files, that a step calls."""
        if step.equation.name in self._helpers:
            return self._helpers[step.equation.name]
        seen: dict[int, Helper] = {}

        def visit(names: Iterable[str], scope: Mapping[str, Any]) -> None:
            for name in sorted(names):
                f = scope.get(name)
                if not isinstance(f, FunctionType) or id(f) in seen or not numeric.of_formula(f):
                    continue
                try:
                    source = Source(f)
                except KinematicsError:
                    continue
                seen[id(f)] = Helper(source, f)
                visit({n for s in source.statements for n in s.reads}, f.__globals__)

        visit({n for s in step.source.statements for n in s.reads}, step.scope)
        return self._helpers.setdefault(step.equation.name, list(seen.values()))

    # -- running ---------------------------------------------------------------------------------------

    def _run_stage(self, stage: Stage) -> None:
        computed: dict[str, Any] = {}
        if stage == "helper":
            for s in self.steps:
                computed = {**s.gave, **computed}
        for step in self.steps:
            if step.stage != stage:
                continue
            step.computed = dict(computed)
            step.known = frozenset(n for n in step.equation.outputs if n in self.truth.kinds)
            step.held = step.known
            if step.plain is not None:
                step.held = step.known & plain.held(step.source, step.equation.outputs)
            last = step.source.statements[-1]
            returned = getattr(last.node, "value", None)
            elements = getattr(returned, "elts", getattr(returned, "values", []))
            names = step.equation.outputs
            step.lines = tuple(e.lineno for e in elements) if len(elements) == len(names) else (last.line,) * len(names)
            lost = [n for n in step.required if not self._has(n, computed)]
            if lost:
                step.missing = ", ".join(lost)
                self.notes.append(f"{step.equation.name} ({step.variant}) was not judged: {step.missing} is unknown")
                continue
            if self.truth.free in step.inputs:
                self._place(step)
            env = self._environment(step, computed)
            found: Residuals = {}
            s = step.source.statements[0]
            try:
                for s, code in zip(step.source.statements, step.codes, strict=True):
                    step.before.append(plain.copied(env))
                    exec(code, env)
                    self._check(step, s, s.writes, env, found)
                step.gave = self._outputs(step, env, found)
            except (NameError, IndexError) as error:
                self._stuck(step, s, found)
                self.notes.append(f"{step.equation.name} ({step.variant}) fails in line {s.line}: {error}")
            except Exception as error:
                step.missing = str(error)
                self.notes.append(f"{step.equation.name} ({step.variant}) fails on arrays: {error}")
                continue
            self.residuals |= found
            for name, value in step.gave.items():
                computed.setdefault(name, value)

    def _stuck(self, step: Step, s: Statement, found: Residuals) -> None:
        """Count all outputs from statement `s` on as wrong, because statement `s` uses an unknown name."""
        step.stuck = True
        late = [(t, i, name) for t in step.source.statements[s.index :] for i, name in enumerate(t.writes)]
        last = step.source.statements[-1]
        late += [(last, i, name) for i, name in enumerate(step.equation.outputs)]
        seen = {p.symbol for p in found}
        for t, i, name in late:
            if name in (step.known if t is last else step.held) and name not in seen:
                seen.add(name)
                size = to_array(self.truth.symbols[name], self.truth.k).shape
                found[step.place(t.index, i, name, step.lines[i] if t is last else t.line)] = np.full(size, np.nan)
        step.gave = {name: self.truth.symbols[name] for name in step.known}

    def _has(self, name: str, computed: Mapping[str, Any]) -> bool:
        return name in self.truth.symbols or name in computed

    def _place(self, step: Step, edits: list[Edit] | None = None, extra: Mapping[str, Any] | None = None) -> None:
        """Set the swivel angle of each state so that the residuals of the rows that use this angle are minimal."""

        def rows(angle: Array) -> Residuals:
            step.free = {self.truth.free: angle}
            return self._retry(step, edits or [], extra or {}, True, onwards=False)

        with contextlib.suppress(Exception):  # the same errors are raised and handled when the rows are run
            step.free = {self.truth.free: fitted(rows, self.truth.k)}

    def _environment(self, step: Step, computed: Mapping[str, Any]) -> dict[str, Any]:
        known = {**computed, **self.truth.symbols, **step.free}
        if step.plain is not None:
            return {**step.scope, **plain.arguments(step.plain, known)}
        return {**step.scope, **{n: known[n] for n in step.inputs if n in known}}

    def _check(self, step: Step, s: Statement, names: Iterable[str], env: dict[str, Any], found: Residuals) -> None:
        """Store the residuals of a statement's outputs, then replace the outputs by the mechanism's values."""
        for i, name in enumerate(names):
            if name in step.held:
                said = plain.outside(step.plain, env[name])
                found[step.place(s.index, i, name, s.line)] = self.difference(name, said)
                env[name] = plain.inside(step.plain, self.truth.symbols[name])

    def _outputs(self, step: Step, env: dict[str, Any], found: Residuals) -> dict[str, Any]:
        values = env[OUT]
        if step.plain is not None:
            values = plain.parts(step.plain, values)
        values = list(values) if isinstance(values, tuple | list) else [values]
        names = step.equation.outputs
        if len(values) != len(names):
            raise ValueError(f"{len(values)} values for {len(names)} outputs")
        last = len(step.source.statements) - 1
        out: dict[str, Any] = {}
        for i, (name, value) in enumerate(zip(names, values, strict=True)):
            if name not in step.known:
                out[name] = value
                continue
            found[step.place(last, i, name, step.lines[i])] = self.difference(name, value)
            out[name] = self.truth.symbols[name]
        return out

    def difference(self, name: str, value: Any) -> Array:
        """Return the difference of a value and the mechanism's value of the symbol `name`, as in `Residuals`."""
        d = self._difference(name, value)
        return d / self.limits[name] if name in self.limits else d

    def _difference(self, name: str, value: Any) -> Array:
        """Return a value minus the mechanism's value of the symbol `name`, (k, entries) in units of the tolerance."""
        true, kind = self.truth.symbols[name], self.truth.kinds[name]
        if value is true:
            return self._zeros.setdefault(name, np.zeros_like(to_array(true, self.truth.k)))
        if isinstance(true, Matrix) and (not isinstance(value, Matrix) or value.shape != true.shape):
            raise ValueError(f"{name} does not have the shape of its value in the mechanism")
        if not isinstance(true, Matrix) and isinstance(value, Matrix):
            raise ValueError(f"{name} is a matrix; in the mechanism it is a number or a vector")
        d = to_array(value, self.truth.k) - to_array(true, self.truth.k)
        if kind == "angle":
            return np.arctan2(np.sin(d), np.cos(d)) / self.tolerance.angle
        if kind == "pose":
            d = d / self.tolerance.angle
            d[:, [3, 7, 11]] *= self.tolerance.angle / self.tolerance.length
            return d
        return d / self.tolerance.length

    # -- trials of edits ----------------------------------------------------------------------------------------

    def trial(self, step: Step, edits: list[Edit], extra: Mapping[str, Any] | None = None) -> Residuals:
        """Return the residuals of the rows that the edits change; call this method with NumPy's warnings disabled.

        The edits change statements of the step or of one helper function. `extra` contains the values of the names that
        the edits define.

        Raises:
            Exception: any exception of the edited code, including SyntaxError.
        """
        own = [e for e in edits if e.function == step.source.name and e.path == step.source.path]
        foreign = [e for e in edits if e not in own]
        undo = self._patch(step, foreign) if foreign else []
        free = step.free
        try:
            if free:
                self._place(step, own, extra)
            found = self._retry(step, own, extra or {}, bool(foreign) or bool(free))
            if foreign:
                found |= self._from_before(step, foreign)
            return found
        finally:
            step.free = free
            for scope, name, old in undo:
                scope[name] = old

    def _from_before(self, step: Step, edits: list[Edit]) -> Residuals:
        """Return the residuals that change in a step because edits of a helper change the output of an earlier step.

        The earlier step calls the helper, and this step uses the output.
        """
        for earlier in self.steps[: self.steps.index(step)]:
            passes = set(earlier.equation.outputs) - set(self.truth.kinds)
            calls = any(h.source.name == edits[0].function for h in self.helpers(earlier))
            if earlier.stage == step.stage and not earlier.missing and calls and passes:
                found = self._retry(earlier, [], {}, True)
                mine = {p: r for p, r in found.items() if p.equation == step.equation.name}
                if mine:
                    return mine
        return {}

    def _patch(self, step: Step, edits: list[Edit]) -> list[tuple[dict[str, Any], str, Any]]:
        """Install an edited helper; return (globals, name, original function) of each use, to restore the original."""
        helper = next(h for h in self.helpers(step) if h.source.name == edits[0].function)
        scope: dict[str, Any] = dict(helper.function.__globals__)
        exec(helper.source.whole(edits), scope)
        made = scope[helper.source.name]
        new = FunctionType(made.__code__, helper.function.__globals__, made.__name__, helper.function.__defaults__)
        undo = []
        scopes = (*(s.scope for s in self.steps), *(h.function.__globals__ for h in self.helpers(step)))
        for other in (helper.function.__globals__, *scopes):
            for name, value in list(other.items()):
                if value is helper.function:
                    undo.append((other, name, value))
                    other[name] = new
        return undo

    def _retry(
        self, step: Step, edits: list[Edit], extra: Mapping[str, Any], anew: bool, onwards: bool = True
    ) -> Residuals:
        source = step.source
        first = 0 if anew else min(e.statement for e in edits)
        codes = list(step.codes)
        writes = {s.index: s.writes for s in source.statements}
        for i in {e.statement for e in edits}:
            s = source.statements[i]
            mine = [e for e in edits if e.statement == i]
            codes[i] = source.compiled(s, mine)
            for e in mine:
                if e.kind == "left side":
                    writes[i] = tuple(e.new if w == e.old else w for w in s.writes)
        env = self._environment(step, step.computed) if anew else plain.copied(step.before[first])
        anew |= step.stuck  # there is no earlier result to reuse
        for name in {e.define[0] for e in edits if e.define and not e.define[1]}:  # new arguments of the function
            for known in (k for k in (step.computed, self.truth.symbols) if name in k):
                env.setdefault(name, plain.inside(step.plain, known[name]))
        for name, value in extra.items():
            env.setdefault(name, value)
        found: Residuals = {}
        edited = {e.statement for e in edits}
        dirty: set[str] = set()
        for s in source.statements[first:]:
            mine = writes[s.index]
            if not anew and s.index not in edited and not dirty & s.reads:
                if s.returns:
                    return found
                after = step.before[s.index + 1]
                for name in mine:  # these outputs do not change, because their inputs do not change
                    env[name] = plain.copied({name: after[name]})[name]
                    dirty.discard(name)
                continue
            exec(codes[s.index], env)
            self._check(step, s, mine, env, found)
            dirty |= {n for n in mine if n not in step.held}
        gave = self._outputs(step, env, found)
        changed = {n for n in gave if n not in self.truth.kinds}
        if changed and onwards:
            self._downstream(step, gave, changed, found)
        return found

    def _downstream(self, step: Step, gave: dict[str, Any], changed: set[str], found: Residuals) -> None:
        computed = {**step.computed, **gave}
        for later in self.steps[self.steps.index(step) + 1 :]:
            if later.stage != step.stage or later.missing:
                continue
            if not changed & set(later.inputs):
                computed = {**later.gave, **computed}
                continue
            # Do not reuse earlier results: a helper that this equation calls may be edited.
            env = {**plain.copied(later.before[0]), **later.scope}
            if later.plain is not None:
                env |= plain.arguments(later.plain, {**self.truth.symbols, **computed})
            else:
                env.update((n, computed[n]) for n in later.inputs if n in changed)
            for s, code in zip(later.source.statements, later.codes, strict=True):
                exec(code, env)
                self._check(later, s, s.writes, env, found)
            new = self._outputs(later, env, found)
            changed |= {n for n in new if n not in self.truth.kinds}
            computed |= {n: v for n, v in new.items() if n in changed or n not in computed}

    # -- failing rows -----------------------------------------------------------------------------------

    def failing(self) -> list[Place]:
        """Return the rows whose residual exceeds the tolerance or is NaN."""
        return [p for p, r in self.residuals.items() if not worst(r) <= 1]


def worst(r: Array) -> float:
    """Return the largest absolute residual; infinity if one is NaN."""
    top = float(np.abs(r).max(initial=0.0))
    return top if top == top else float("inf")


def evaluate(judge: Judge, step: Step, edits: list[Edit], extra: Mapping[str, Any] | None = None) -> Residuals | None:
    """Return the residuals of `Judge.trial`, or None if the edited text cannot be run."""
    try:
        return judge.trial(step, edits, extra)
    except Exception:
        return None
