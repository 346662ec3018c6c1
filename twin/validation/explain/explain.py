"""Explain a disagreement: judge rows and margins, then find what is violated and what makes the rows agree."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from twin.cad.build import CadModel
from twin.core.errors import TwinError
from twin.core.findings import Verdict
from twin.core.progress import Progress, silent
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.formula.variant_choice import choose
from twin.reference import ReferenceModel
from twin.reference.margin_zeros import JudgedRow
from twin.validation.explain.cad_faults import CorrectedCad, correct, findings_on_joints
from twin.validation.explain.candidate import GroupResult
from twin.validation.explain.coverage import check_margins, coverage, findings_on_unvalued_symbols
from twin.validation.explain.equation_steps import Tolerance
from twin.validation.explain.explanation import Explanation
from twin.validation.explain.explanation_data import Repair, WrongRow
from twin.validation.explain.explanation_repairs import repair
from twin.validation.explain.explanation_rows import wrong_margin, wrong_row
from twin.validation.explain.invariants import invariants
from twin.validation.explain.judged_states import judge_over_range, noise_limits, sample_states, sampled_values
from twin.validation.explain.parameter_coincidences import coincidences, condition
from twin.validation.explain.possible_fixes import possible_fixes
from twin.validation.explain.proved_repairs import RepairProver, with_proofs
from twin.validation.explain.reference_values import ReferenceValues, symbol_values
from twin.validation.explain.row_deviations import Judge


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
    progress: Progress = silent,
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
    # With declared noise, gaps between parts are expected, and are no faults.
    if cad is not None and cad.noise is None:
        corrected = correct(formula, cad, task.judge_of, lambda fraction: progress("correct the CAD", fraction))
    task.laps.end("drawing")
    judge_as_drawn = _judge_as_drawn(task, model, reference, corrected)
    judge = judge_as_drawn
    if judge is None:
        assert corrected is not None
        judge = corrected.judge
    assert judge is not None
    make = partial(Explanation, robot, choose(formula, variants), seconds=task.laps.seconds)
    notes = [*_notes_on_points(judge), *judge.notes]
    answer = _Answer(task, make, _has_unjudged_equation(judge), notes)
    if corrected is not None:
        answer.make = partial(answer.make, drawing=corrected.findings, parts=corrected.parts)
        # Rows that agree even with the faulty CAD need no explanation by it, but its gaps are reported.
        if corrected.agrees or not judge.failing():
            if judge_as_drawn is None:
                answer.notes.append(
                    "the mechanism of the CAD cannot be moved; the rows were judged against the corrected CAD"
                )
            return answer.explained_by_cad(judge, "drawing")
        if corrected.judge is not None and corrected.model is not None:
            judge = corrected.judge
            model = corrected.model
            answer.notes.append("the corrected CAD does not explain every row; the rows below were judged against it")
    if cad is not None and cad.noise is not None and judge.reference.run is not None:
        answer.make = partial(answer.make, drawing=findings_on_joints(cad))
        judge = task.judge(judge.reference, noise_limits(cad.noise, cad, judge, parameters))
        task.laps.end("noise")
        if not judge.failing():
            return answer.explained_by_cad(judge, "noise")
        answer.notes.append(
            "noise of the CAD does not explain every row; the wrong rows differ by more than it can cause"
        )
    # Around the postures, a wrong branch or a wrong sign of a term that is zero there does not show.
    if not judge.failing():
        judge = _judge_elsewhere(task, model, judge, answer.notes)
    if not judge.failing():
        return answer.agreement(judge, model)
    return answer.disagreement(judge, model)


def _has_unjudged_equation(judge: Judge) -> bool:
    """Return whether an equation of the inverse or forward kinematics could not be judged."""
    for step in judge.steps:
        if step.stage == "helper":
            continue
        if step.missing or step.stuck:
            return True
    return False


def _notes_on_points(judge: Judge) -> list[str]:
    """Return a note on symbols that helpers define as named points, if there are any."""
    if not judge.reference.borrowed:
        return []
    symbols: list[str] = []
    for symbol, point in judge.reference.borrowed.items():
        symbols.append(f"{symbol} (point {point})")
    text = "a helper defines symbols as named points; their positions are taken from the CAD"
    return [f"{text}: {', '.join(symbols)}"]


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
        return self.judge(sampled_values(self.formula, model, self.parameters, variants=self.variants))


def _judge_as_drawn(
    task: _Task, model: ReferenceModel, reference: ReferenceValues | None, corrected: CorrectedCad | None
) -> Judge | None:
    """Return the judge of the equations at states of the mechanism as it is drawn, or at those of `reference`.

    Returns None if no row can be judged with the drawn mechanism, but can with the corrected one.

    Raises:
        TwinError: no row can be judged.
    """
    try:
        if reference is None:
            reference = sampled_values(task.formula, model, task.parameters, task.progress, task.variants)
        task.laps.end("sample")
        task.progress("judge rows", 0.0)
        judge = task.judge(reference)
        task.laps.end("judge")
    except TwinError:
        if corrected is None or corrected.judge is None:
            raise
        return None
    return judge


def _judge_elsewhere(task: _Task, model: ReferenceModel, judge: Judge, notes: list[str]) -> Judge:
    """Return a judge at states at which the rows are wrong, or `judge`, in which they agree; add notes to `notes`.

    The states are all over the joint range, or are those of another value of a redundancy angle.
    """
    task.progress("joint range", 0.0)
    wider = judge_over_range(task.formula, model, task.variants, task.parameters, task.options.tolerance)
    task.laps.end("range")
    if wider is not None:
        notes.append("the rows agree near the postures; they are wrong in another part of the joint range")
        return wider
    depends_on_swivel = False
    for group in coincidences(judge):
        notes.append(_note_on_coincidence(group))
        for parameter in group:
            depends_on_swivel |= parameter.name == judge.reference.free_parameter
    if depends_on_swivel:
        # At the values of the formula, the rows agree; at other states of the redundant mechanism they do not.
        run = sample_states(model, regular=True)
        regular_judge = task.judge(symbol_values(task.formula, run, model, task.parameters))
        if regular_judge.failing():
            return regular_judge
    return judge


def _note_on_coincidence(group: Sequence[Parameter]) -> str:
    """Return a note on equations that belong together only for the present values of parameters."""
    return f"inverse and forward equations belong together only {condition(group)}: with other values they differ"


@dataclass
class _Answer:
    """What is returned: everything that is known of it before its verdict.

    Attributes:
        task: what is explained, and how.
        make: makes the explanation from its remaining fields.
        skipped: whether an equation could not be judged, so that the verdict is not "agree".
        notes: remarks; later steps add theirs.
    """

    task: _Task
    make: partial[Explanation]
    skipped: bool
    notes: list[str]

    def explained_by_cad(self, judge: Judge, lead: str) -> Explanation:
        """Return the result if the CAD explains every row that is wrong in `judge`."""
        verdict: Verdict = "disagree"
        if self.skipped or not judge.residuals:
            verdict = "unchecked"
        rows: list[WrongRow] = []
        for place in judge.failing():
            rows.append(wrong_row(judge, place, [], self.task.options.root))
        return self.make(
            verdict,
            explained=True,
            samples=judge.reference.k,
            invariants=(),
            rows=tuple(rows),
            notes=tuple(self.notes),
            lead=lead,
        )

    def agreement(self, judge: Judge, model: ReferenceModel) -> Explanation:
        """Return the result if all rows that have a value agree: margins of reach and measures are judged as well."""
        task = self.task
        task.progress("reach and singularity measures", 0.0)
        margins: list[JudgedRow] = []
        if not self.skipped:
            margins = check_margins(judge, model, dict(task.parameters or {}))
        task.laps.end("margins")
        covered = coverage(judge, margins)
        wrong: list[WrongRow] = []
        for margin in margins:
            if margin.status == "disagrees":
                wrong.append(wrong_margin(judge, margin, task.options.root))
        verdict: Verdict = "agree"
        if self.skipped or not judge.residuals:
            verdict = "unchecked"
        elif wrong:
            verdict = "disagree"
        notes = list(self.notes)
        for text in covered.unjudged:
            notes.append(f"not judged: {text}")
        return self.make(
            verdict,
            explained=not wrong,
            samples=judge.reference.k,
            invariants=tuple(findings_on_unvalued_symbols(judge)),
            rows=tuple(wrong),
            notes=tuple(notes),
            judged=covered.rows - len(covered.unjudged),
            rows_of_formula=covered.rows,
        )

    def disagreement(self, judge: Judge, model: ReferenceModel) -> Explanation:
        """Return the result if rows are wrong: with the invariants that they violate, and possible fixes."""
        task = self.task
        options = task.options
        task.progress("invariants", 0.0)
        violated = (*findings_on_unvalued_symbols(judge), *invariants(judge, model))
        task.laps.end("invariants")
        fixes = possible_fixes(judge, model, options.budget, task.progress, task.laps.end)
        if options.prover is not None:
            task.progress("prove the repairs", 0.0)
        proved_results = with_proofs(judge.formula, fixes.results, options.prover)
        if options.prover is not None:
            task.laps.end("prove")
        results: list[GroupResult] = []
        repairs: list[Repair] = []
        for proved_result in proved_results:
            results.append(proved_result.result)
            repairs.append(repair(judge, fixes.search, proved_result, options.root))
        rows: list[WrongRow] = []
        for place in judge.failing():
            rows.append(wrong_row(judge, place, results, options.root))
        verdict: Verdict = "disagree"
        if self.skipped:
            verdict = "unchecked"
        return self.make(
            verdict,
            explained=fixes.lead != "",
            samples=judge.reference.k,
            invariants=violated,
            rows=tuple(rows),
            repairs=tuple(repairs),
            identified=fixes.identified,
            conventions=fixes.conventions,
            notes=(*self.notes, *fixes.notes),
            lead=fixes.lead,
        )
