"""Explain a disagreement: check rows and invariants, then search repairs, wrong parameters and conventions."""

from __future__ import annotations

import ast
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from twin.cad.build import CadModel
from twin.core.errors import TwinError
from twin.core.findings import Verdict
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import display_unit
from twin.formula.contract import Formula
from twin.formula.variant_choice import choose
from twin.kinematics import compile_formula
from twin.reference import ReferenceModel
from twin.reference.boundary import Judged
from twin.validation.explain.candidate import TOKENS, Candidate, GroupResult
from twin.validation.explain.conventions import conventions, general
from twin.validation.explain.coverage import coverage
from twin.validation.explain.deadline import Deadline, LateError
from twin.validation.explain.drawing import Corrected, correct, drawing
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.explanation import (
    Change,
    Convention,
    Explanation,
    Identified,
    Reading,
    Repair,
    Row,
)
from twin.validation.explain.function_source import Edit, diff, patched
from twin.validation.explain.held_out_states import held_out
from twin.validation.explain.invariants import invariants
from twin.validation.explain.noise_limits import limits
from twin.validation.explain.parameter_coincidences import coincidences, condition
from twin.validation.explain.proved_repairs import ProvedResult, RepairProver, proved
from twin.validation.explain.reference_values import ReferenceValues, sample_states, symbol_values
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge, RowPlace, Tolerance
from twin.validation.explain.simplest_explanation import simplest_explanation
from twin.validation.explain.suspects import shared
from twin.validation.explain.unvalued_symbols import unvalued
from twin.validation.explain.wrong_parameters import identify
from twin.validation.explain.zero_margins import check_margins
from twin.validation.joint_range import range_errors
from twin.validation.rows import Tolerances

Progress = Callable[[str, float], None]

_OF_EACH = 12
"""Number of right and of wrong states at which equations are judged that are wrong in a part of the joint range."""

_NUMBERS, _LEAST_NUMBERS, _LEAST_EDITS = 0.3, 2.5, 4.0
"""Time limits: each of the two fits of numbers has 0.3 of the time, but at least 2.5 s; single edits at least 4 s."""

_FLOOR = 1e-6
"""Minimum divisor of a ratio of residuals, in units of the tolerance; it prevents a division by zero."""


def known(
    formula: Formula,
    model: ReferenceModel,
    parameters: Mapping[str, float] | None = None,
    progress: Progress = lambda label, fraction: None,
    variants: Mapping[str, str] | str | None = None,
) -> ReferenceValues:
    """Return the mechanism's values of the formula's symbols at sampled poses.

    A redundant mechanism has many solutions for a pose. The formula is judged with two of them: the sampled solution,
    and the solution nearest to the formula's joint values. The solution with fewer wrong rows is returned.
    """
    run = sample_states(model, progress=lambda f: progress("sample the mechanism", f))
    if not (model.redundant and formula.has("inverse")):
        return symbol_values(formula, run, model, parameters)
    sampled = symbol_values(formula, sample_states(model, regular=True), model, parameters)
    try:
        extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
        q = compile_formula(formula, variants, parameters, extra_joints).inverse_many(run.Ts_base_tool)
        near = model.run_poses(run.Ts_base_tool, near=np.where(np.isfinite(q), q, run.q))
    except TwinError:  # equations without a solution are reported row by row
        return sampled
    gathered = symbol_values(formula, near, model, parameters)
    off = len(Judge(formula, variants, gathered).failing())
    if not off:
        return gathered
    return gathered if off < len(Judge(formula, variants, sampled).failing()) else sampled


class _Laps:
    """Durations of the steps of an explanation."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._began = time.perf_counter()

    def end(self, step: str) -> None:
        """Add the time since the previous call to the duration of a step."""
        now = time.perf_counter()
        self.seconds[step] = self.seconds.get(step, 0.0) + round(now - self._began, 3)
        self._began = now


@dataclass(frozen=True)
class ExplainOptions:
    """How equations are explained.

    Attributes:
        tolerance: largest deviation that counts as agreement; None for the default.
        budget: time limit in s of the search for edits, numbers and conventions.
        root: folder to which file names in messages are relative; None: absolute names.
        prover: proves the repairs that are found; None: they are not proved.
    """

    tolerance: Tolerance | None = None
    budget: float = 8.0
    root: Path | None = None
    prover: RepairProver | None = None


def explain(
    robot: str,
    formula: Formula,
    model: ReferenceModel,
    variants: Mapping[str, str] | str | None = None,
    parameters: Mapping[str, float] | None = None,
    *,
    options: ExplainOptions | None = None,
    reference: ReferenceValues | None = None,
    cad: CadModel | None = None,
    progress: Progress = lambda label, fraction: None,
) -> Explanation:
    """Explain where and why a formula disagrees with a mechanism, and find edits after which they agree.

    Args:
        robot: name of the robot.
        formula: the equations.
        model: the independent model of the mechanism.
        variants: the variants to judge, by equation; None: the default variant of each equation.
        parameters: values in SI that replace published ones.
        options: tolerance, time limit, names of files and proofs; None for the defaults.
        reference: the mechanism's values of the symbols; None: they are computed.
        cad: the CAD of the model; joints whose parts do not meet are analysed first. None: not analysed.
        progress: called with a description of the current step and the fraction done.

    Raises:
        TwinError: no row could be judged.
    """
    task = _Task(formula, variants, parameters, options or ExplainOptions(), progress, _Laps())
    corrected = None
    if cad is not None and cad.noise is None:
        corrected = correct(formula, cad, task.judge_of, lambda f: progress("correct the CAD", f))
    task.laps.end("drawing")
    drawn = _judge_of_drawing(task, model, reference, corrected)
    judge = drawn or (corrected.judge if corrected is not None else None)
    assert judge is not None
    skipped = any((s.missing or s.stuck) and s.stage != "helper" for s in judge.steps)
    made = partial(Explanation, robot, choose(formula, variants), seconds=task.laps.seconds)
    notes = [*_notes(judge), *judge.notes]
    if corrected is not None:
        made = partial(made, drawing=corrected.findings, parts=corrected.parts)
        if corrected.agrees or not judge.failing():
            if not drawn:
                notes.append("the mechanism of the CAD cannot be moved; the rows were judged against the corrected CAD")
            rows = tuple(_row(judge, p, [], task.options.root) for p in judge.failing())
            return _explained_by_cad(made, judge, skipped, rows, notes, "drawing")
        if corrected.judge is not None and corrected.model is not None:
            judge = corrected.judge
            model = corrected.model
            notes.append("the corrected CAD does not explain every row; the rows below were judged against it")
    if cad is not None and cad.noise is not None and judge.reference.run is not None:
        made = partial(made, drawing=drawing(cad))
        judge = task.judge(judge.reference, limits(cad.noise, cad, judge, parameters))
        task.laps.end("noise")
        if not judge.failing():
            return _explained_by_cad(made, judge, skipped, (), notes, "noise")
        notes.append("noise of the CAD does not explain every row; the wrong rows differ by more than it can cause")
    if not judge.failing():
        judge = _elsewhere(task, model, judge, notes)
    if not judge.failing():
        return _agreement(task, made, judge, skipped, model, notes)
    return _disagreement(task, made, judge, skipped, model, notes)


@dataclass(frozen=True)
class _Task:
    """What is explained, and how; for the fields, see the arguments of `explain`."""

    formula: Formula
    variants: Mapping[str, str] | str | None
    parameters: Mapping[str, float] | None
    options: ExplainOptions
    progress: Progress
    laps: _Laps

    def judge(self, reference: ReferenceValues, limits: Mapping[str, Array] | None = None) -> Judge:
        """Return the judge of the equations at given states; for `limits`, see `Judge`."""
        return Judge(self.formula, self.variants, reference, self.options.tolerance, limits)

    def judge_of(self, model: ReferenceModel) -> Judge:
        """Return the judge of the equations at sampled states of a model."""
        return self.judge(known(self.formula, model, self.parameters, variants=self.variants))


def _judge_of_drawing(
    task: _Task, model: ReferenceModel, reference: ReferenceValues | None, corrected: Corrected | None
) -> Judge | None:
    """Return the judge of the equations at states of the mechanism as it is drawn, or at those of `reference`.

    Returns None if no row can be judged with the drawn mechanism, but can with the corrected one.

    Raises:
        TwinError: no row can be judged.
    """
    try:
        if reference is None:
            reference = known(task.formula, model, task.parameters, task.progress, task.variants)
        task.laps.end("sample")
        task.progress("judge rows", 0.0)
        judge = task.judge(reference)
        task.laps.end("judge")
    except TwinError:
        if corrected is None or corrected.judge is None:
            raise
        return None
    return judge


def _explained_by_cad(
    made: partial[Explanation], judge: Judge, skipped: bool, rows: tuple[Row, ...], notes: Sequence[str], lead: str
) -> Explanation:
    """Return the result if the CAD explains every wrong row."""
    return made(
        "unchecked" if skipped or not judge.residuals else "disagree",
        explained=True,
        samples=judge.reference.k,
        invariants=(),
        rows=rows,
        notes=tuple(notes),
        lead=lead,
    )


def _elsewhere(task: _Task, model: ReferenceModel, judge: Judge, notes: list[str]) -> Judge:
    """Return a judge at states at which the rows are wrong, or `judge`, in which they agree; add notes to `notes`.

    The states are all over the joint range, or are those of another value of a redundancy angle.
    """
    task.progress("joint range", 0.0)
    wider = _over_range(task.formula, model, task.variants, task.parameters, task.options.tolerance)
    task.laps.end("range")
    if wider is not None:
        notes.append("the rows agree near the postures; they are wrong in another part of the joint range")
        return wider
    by_chance = coincidences(judge)
    notes += [_by_chance(group) for group in by_chance]
    if any(p.name == judge.reference.free for group in by_chance for p in group):
        # At the values of the formula, the rows agree; at other states of the redundant mechanism they do not.
        other = task.judge(symbol_values(task.formula, sample_states(model, regular=True), model, task.parameters))
        if other.failing():
            return other
    return judge


def _agreement(
    task: _Task,
    made: partial[Explanation],
    judge: Judge,
    skipped: bool,
    model: ReferenceModel,
    notes: Sequence[str],
) -> Explanation:
    """Return the result if all rows that have a value agree: margins of reach and measures are judged as well."""
    task.progress("reach and singularity measures", 0.0)
    measured: list[Judged] = []
    if not skipped:
        measured = check_margins(judge, model, dict(task.parameters or {}))
    task.laps.end("margins")
    covered = coverage(judge, measured)
    off = tuple(_margin(judge, m, task.options.root) for m in measured if m.status == "disagrees")
    verdict: Verdict = "agree"
    if skipped or not judge.residuals:
        verdict = "unchecked"
    elif off:
        verdict = "disagree"
    left = [f"not judged: {text}" for text in covered.unjudged]
    return made(
        verdict,
        explained=not off,
        samples=judge.reference.k,
        invariants=tuple(unvalued(judge)),
        rows=off,
        notes=(*notes, *left),
        judged=covered.rows - len(covered.unjudged),
        rows_of_formula=covered.rows,
    )


def _disagreement(
    task: _Task,
    made: partial[Explanation],
    judge: Judge,
    skipped: bool,
    model: ReferenceModel,
    notes: Sequence[str],
) -> Explanation:
    """Return the result if rows are wrong: with the invariants that they violate, and possible fixes."""
    options = task.options
    task.progress("invariants", 0.0)
    violated = (*unvalued(judge), *invariants(judge, model))
    task.laps.end("invariants")
    cures = _cures(judge, model, options.budget, task.progress, task.laps)
    if options.prover is not None:
        task.progress("prove the repairs", 0.0)
    judged = proved(judge.formula, cures.found, options.prover)
    if options.prover is not None:
        task.laps.end("prove")
    found = [result.found for result in judged]
    return made(
        "unchecked" if skipped else "disagree",
        explained=cures.lead != "",
        samples=judge.reference.k,
        invariants=violated,
        rows=tuple(_row(judge, p, found, options.root) for p in judge.failing()),
        repairs=tuple(_repair(judge, cures.search, result, options.root) for result in judged),
        identified=cures.identified,
        conventions=cures.conventions,
        notes=(*notes, *cures.notes),
        lead=cures.lead,
    )


def _by_chance(group: Sequence[Parameter]) -> str:
    """Return a note on equations that belong together only for the present values of parameters."""
    return f"inverse and forward equations belong together only {condition(group)}: with other values they differ"


def _over_range(
    formula: Formula,
    model: ReferenceModel,
    variants: Mapping[str, str] | str | None,
    parameters: Mapping[str, float] | None,
    tolerance: Tolerance | None,
) -> Judge | None:
    """Return a judge at states all over the joint range, if the equations are wrong at some of them; else None.

    States at which the inverse gives another solution of the same pose are left out: its rows differ, but are right.
    """
    extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
    try:
        kin = compile_formula(formula, variants, parameters, extra_joints)
    except TwinError:  # a symbol without a value, which is explained row by row
        return None
    used = Tolerances() if tolerance is None else Tolerances(tolerance.length, tolerance.angle)
    found = range_errors(kin, model, used, free_angles=False)
    wrong = np.flatnonzero(found.wrong(used))
    right = np.flatnonzero(found.inside & found.own & ~found.wrong(used))
    if not len(wrong):
        return None
    # As many right states as wrong ones, so that an edit must keep what is right.
    rows = np.concatenate([wrong[:: max(1, len(wrong) // _OF_EACH)][:_OF_EACH], right[:_OF_EACH]])
    reference = symbol_values(formula, model.collect(found.drawn.run.x[rows]), model, parameters)
    judge = Judge(formula, variants, reference, tolerance)
    return judge if judge.failing() else None


@dataclass(frozen=True)
class _Cures:
    """Possible fixes of the wrong rows.

    Attributes:
        search, found: the search for edits, and the results of this search.
        identified: the changed numbers; None if no change of numbers fits, or if edits are simpler.
        conventions: conventions under which rows agree; searched only after edits and numbers have failed.
        lead: see `Explanation`.
        notes: remarks.
    """

    search: RepairSearch
    found: list[GroupResult]
    identified: Identified | None
    conventions: tuple[Convention, ...]
    lead: str
    notes: tuple[str, ...] = ()


def _cures(judge: Judge, model: ReferenceModel, budget: float, progress: Progress, laps: _Laps) -> _Cures:
    """Search edits, parameter values and conventions with which the wrong rows agree.

    `budget` is the time limit in s; see `_LEAST_NUMBERS` and `_LEAST_EDITS` for short ones.
    """
    remarks: list[str] = []

    def numbers(alone: bool = False) -> Identified | None:
        progress("identify parameters", 0.0)
        until = Deadline(max(_NUMBERS * budget, _LEAST_NUMBERS))
        try:
            return identify(judge, lambda f: progress("identify parameters", f), alone=alone, deadline=until)
        except LateError:
            remarks.append("the time ended before every number was fitted; a larger --seconds gives more time")
            return None
        finally:
            laps.end("identify")

    identified = numbers(alone=True)
    conventional: tuple[Convention, ...] | None = None
    search = RepairSearch(judge, lambda f: progress("try edits", f), Deadline(max(budget, _LEAST_EDITS)))
    if identified is None:
        edited = search.run(0.0)
        laps.end("repair")
        if edited[1]:
            progress("conventions", 0.0)
            conventional = tuple(general(judge))
            laps.end("conventions")
            if _all_cured(judge, conventional, search.failing):
                return _Cures(search, [], None, conventional, "conventions", tuple(remarks))
            edited = search.pairs(*edited, budget)
    else:  # one changed number explains everything: only a single edit would be equally simple
        edited = search.run(0.0) if shared(judge, search.targets) else ([], search.failing)
    for candidate, reason in search.by_chance:
        texts = "; ".join(_phrase(e) for e in candidate.edits)
        remarks.append(f"`{texts}` makes rows agree only {reason}; it is no fix")
    found, lost = held_out(judge, model, *edited)
    laps.end("repair")
    if identified is None and (lost or not found):
        identified = numbers()
    lead = simplest_explanation(found, lost, identified)
    if lead == "edits":
        return _Cures(search, found, None, (), lead, tuple(remarks))
    if lead == "numbers":
        needed = sum(len(f.cures[0][0].edits) for f in found if f.cures)
        if needed and not lost:
            remarks.append(f"{needed} edits together would also make the rows agree; one changed number is simpler")
        return _Cures(search, [], identified, (), lead, tuple(remarks))
    if lead:
        return _Cures(search, found, identified, (), lead, tuple(remarks))
    progress("conventions", 0.0)
    conventional = tuple(conventions(judge, conventional))
    laps.end("conventions")
    lead = "conventions" if _all_cured(judge, conventional, lost) else ""
    return _Cures(search, found, identified, conventional, lead, tuple(remarks))


def _all_cured(judge: Judge, found: Sequence[Convention], rows: Sequence[RowKey]) -> bool:
    """Return whether conventions fix all the given rows."""
    cured = {r for c in found for r in c.rows}
    return bool(found) and all(f"{k[0]}.{_symbol(judge, k)}" in cured for k in rows)


def _notes(judge: Judge) -> list[str]:
    if not judge.reference.borrowed:
        return []
    pairs = ", ".join(f"{s} (point {p})" for s, p in judge.reference.borrowed.items())
    return [f"a helper defines symbols as named points; their positions are taken from the CAD: {pairs}"]


def _symbol(judge: Judge, k: RowKey) -> str:
    return next(p.symbol for p in judge.residuals if p.key == k)


def _shown(path: Path, root: Path | None) -> str:
    return str(path.relative_to(root)) if root is not None and path.is_relative_to(root) else str(path)


def _row(judge: Judge, place: RowPlace, found: list[GroupResult], root: Path | None) -> Row:
    step, reference = judge.step(place.equation), judge.reference
    size = np.abs(judge.residuals[place]).max(axis=1)
    limit = judge.limits[place.symbol][:, 0] if place.symbol in judge.limits else 1.0
    name, scale = _unit(judge, place.symbol)
    statement = step.source.statements[place.statement]
    text = step.source.text(statement.start, statement.end)
    known = np.isfinite(size)
    best = next((f.cures[0][0] for f in found if place.key in f.rows and f.cures), None)
    return Row(
        place.equation,
        place.variant,
        place.symbol,
        _shown(step.source.path, root),
        place.line,
        _short(text if not statement.returns else text.splitlines()[0], 400),
        _means(judge, place.symbol),
        float((size * limit)[known].max()) * scale if (size[known] > 1).any() else float("nan"),
        name,
        float((~(size <= 1)).mean()),
        reference.pose_text(int(np.argmax(np.where(known, size, np.inf)))),
        reference.pose_text(int(np.argmin(np.where(known, size, np.inf)))),
        _term(best) if best is not None and best.edits[0].statement == place.statement else "",
    )


def _unit(judge: Judge, symbol: str) -> tuple[str, float]:
    """Return the display unit of a symbol's residuals, and the tolerance of the symbol in this unit."""
    kind = judge.reference.kinds[symbol]
    name, scale = display_unit(kind == "angle")
    return name, (judge.tolerance.angle if kind == "angle" else judge.tolerance.length) / scale


def _margin(judge: Judge, m: Judged, root: Path | None) -> Row:
    """Return the report's `Row` for a reach, singularity measure or aspect that contradicts the mechanism."""
    kind = {"reach": f"margin of reach '{m.name}'", "aspect": "aspect"}.get(m.kind, f"singularity measure '{m.name}'")
    size = m.size if m.size is not None and m.unit else float("nan")
    variant, file, line, text = "", "", 0, ""
    step = next((s for s in judge.steps if s.equation.name == m.equation), None)
    if step is not None:
        source, last = step.source, step.source.statements[-1]
        writing = [s for s in source.statements if m.symbol in s.writes] or [last]
        line = step.lines[step.equation.outputs.index(m.symbol)] if writing == [last] else writing[-1].line
        text = _short(source.text(writing[-1].start, writing[-1].end), 400)
        variant, file = step.variant, _shown(source.path, root)
    return Row(m.equation, variant, m.symbol, file, line, text, kind, size, m.unit, 0.0, m.at, "", why=m.why)


def _means(judge: Judge, symbol: str) -> str:
    """Return the meaning of a symbol: a named point, a joint or the tool pose."""
    f = judge.formula
    for name, s in f.points.items():
        if symbol == s:
            return f"point {name}"
        if not isinstance(s, str) and symbol in s:
            return f"{'xyz'[s.index(symbol)]} of point {name}"
    if symbol in judge.reference.borrowed:
        return f"point {judge.reference.borrowed[symbol]}"
    if symbol in {j.name for j in f.joints}:
        return f"joint {symbol}"
    if symbol in f.passive:
        return f"passive joint {symbol}"
    return "tool pose" if judge.reference.kinds[symbol] == "pose" else symbol


def _term(c: Candidate) -> str:
    """Return the summand that an edit changes in a row, with sign; "" if the edit changes no summand."""
    source, e = c.step.source, c.edits[0]
    if e.function != source.name:
        return ""
    for n in ast.walk(source.statements[e.statement].node):
        if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Add | ast.Sub):
            for side, sign in ((n.left, "+"), (n.right, "+" if isinstance(n.op, ast.Add) else "-")):
                a, b = source.span(side)
                whole = isinstance(side, ast.BinOp) and isinstance(side.op, ast.Add | ast.Sub)
                if a <= e.start and e.end <= b and not whole:
                    return f"{sign} {source.text(a, b)}"
    return ""


def _in_changed_rows(c: Candidate) -> bool:
    """Return whether all edits are in the variant's own function, not in rows shared with the default variant."""
    source = c.step.source
    return all(e.function == source.name and source.statements[e.statement].home is source.node for e in c.edits)


def _short(text: str, n: int = 90) -> str:
    text = " ".join(text.split())
    return text if len(text) <= n else f"{text[: n - 1]}…"


def _repair(judge: Judge, search: RepairSearch, judged: ProvedResult, root: Path | None) -> Repair:
    f = judged.found
    cures = [tuple(_reading(c, root) for c in _told(way)) for way in f.cures]
    tie = ""
    if len(cures) > 1:
        tie = (
            f"{len(cures)} different functions agree with the mechanism at every pose judged: the dimensions of "
            "the mechanism do not distinguish them"
        )
    elif cures and any(judged.merged):
        tie = (
            f"{len(cures[0])} edits give the same function with the dimensions of this mechanism, proved for all "
            "poses: the paper does not show which was intended"
        )
    elif cures and len(cures[0]) > 1:
        tie = (
            f"{len(cures[0])} edits give the same function: no pose distinguishes them, and the paper does not show "
            "which was intended"
        )
    runner = ""
    if f.runner_up is not None:
        phrases = " and ".join(_phrase(e) for e in f.runner_up.edits)
        runner = f"with {phrases}, the largest difference is {_size(judge, f.rows, f.next)}"
    note = ""
    if not f.cures:
        nearest = f"; the best one: {runner}" if runner else ""
        note = f"no edit and no pair of edits among those tried makes the rows agree{nearest}"
    return Repair(
        tuple(f"{k[0]}.{_symbol(judge, k)}" for k in f.rows),
        before=max(search.base[k] for k in f.rows),
        after=f.after,
        margin=f.next / max(f.after, _FLOOR) if f.cures else 0.0,
        runner_up=runner,
        cures=tuple(cures),
        tie=tie,
        tried=search.tried,
        complete=f.complete,
        note=note,
        seconds=round(f.seconds, 2),
        proofs=judged.proofs,
    )


def _told(way: list[Candidate]) -> list[Candidate]:
    """Return the candidates to report from `way`, a list of candidates that result in the same function.

    Edits in the equation's own rows are preferred to edits in helpers, and edits of single tokens to other edits.
    """
    own = [c for c in way if c.edits[0].function == c.step.source.name] or way
    own = [c for c in own if _in_changed_rows(c)] or own  # an edit of a shared row would also change the default
    return [c for c in own if all(e.kind in TOKENS for e in c.edits)] or own[:1]


def _size(judge: Judge, rows: list[RowKey], score: float) -> str:
    if not np.isfinite(score):
        return "not a number"
    symbol = _symbol(judge, rows[0])
    if symbol in judge.limits:
        return f"{score:.3g} times as large as noise of the CAD explains"
    name, scale = _unit(judge, symbol)
    return f"{score * scale:.3g} {name}"


def _phrase(e: Edit) -> str:
    return _short(e.text, 70)


def _reading(c: Candidate, root: Path | None) -> Reading:
    note = ""
    for e in c.edits:
        if e.kind == "left side":
            note = (
                f"the row then determines {e.new}; in Python, keep {e.old} on the left side: "
                f"{e.old} = {e.old} - {e.new} + ..."
            )
    diffs, lines = [], {}
    for path in sorted({e.path for e in c.edits}):
        mine = [e for e in c.edits if e.path == path]
        diffs.append(diff(mine, _shown(path, root)))
        lines[path] = path.read_text(encoding="utf-8").splitlines(), patched(mine).splitlines()
    changes = []
    for e in c.edits:
        before, after = lines[e.path]
        last = e.line + e.old.count("\n")
        old = "\n".join(before[e.line - 1 : last]).strip()
        new = "\n".join(after[e.line - 1 : last + len(after) - len(before)]).strip()
        changes.append(Change(_shown(e.path, root), e.line, _phrase(e), e.kind, old, new))
    return Reading(tuple(changes), "\n".join(diffs), note, c.dropped)
