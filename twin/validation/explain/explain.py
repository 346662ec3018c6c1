"""Explain a disagreement: check rows and invariants, then search repairs, wrong parameters and conventions."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from twin.cad.build import CadModel
from twin.core.errors import TwinError
from twin.core.findings import Verdict
from twin.formula.contract import Formula
from twin.formula.flow import choose
from twin.kinematics import compile_formula
from twin.reference import ReferenceModel
from twin.reference.boundary import Judged
from twin.validation.explain.candidate import TOKENS, Candidate, Found, Key, key
from twin.validation.explain.conventions import conventions
from twin.validation.explain.coverage import coverage, margins
from twin.validation.explain.drawing import correct
from twin.validation.explain.heldout import held_out
from twin.validation.explain.identify import identify
from twin.validation.explain.invariants import invariants, unit
from twin.validation.explain.judge import Judge, Place, Tolerance, worst
from twin.validation.explain.repair import Search
from twin.validation.explain.result import Change, Explanation, Reading, Repair, Row
from twin.validation.explain.source import Edit, diff, patched
from twin.validation.explain.suspects import shared
from twin.validation.explain.truth import Truth, gather, sample
from twin.validation.explain.unvalued import unvalued
from twin.validation.explain.weigh import weigh

Progress = Callable[[str, float], None]

_FLOOR = 1e-6
"""Smallest divisor, in units of the tolerance, of a ratio of residuals."""


def known(
    formula: Formula,
    model: ReferenceModel,
    parameters: Mapping[str, float] | None = None,
    progress: Progress = lambda label, fraction: None,
    variants: Mapping[str, str] | str | None = None,
) -> Truth:
    """Return the mechanism's values of the formula's symbols at sampled poses.

    A redundant mechanism has many solutions for a pose. Two are compared: the sampled one, and the one nearest to the
    formula's own joint values. The second is used if fewer rows are wrong with it, or none.
    """
    run = sample(model, progress=lambda f: progress("sample the mechanism", f))
    if not (model.redundant and formula.has("inverse")):
        return gather(formula, run, model, parameters)
    sampled = gather(formula, sample(model, regular=True), model, parameters)
    try:
        extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
        q = compile_formula(formula, variants, parameters, extra_joints).inverse_many(run.Ts_base_tool)
        near = model.run_poses(run.Ts_base_tool, near=np.where(np.isfinite(q), q, run.q))
    except TwinError:  # equations without a solution are reported row by row
        return sampled
    gathered = gather(formula, near, model, parameters)
    off = len(Judge(formula, variants, gathered).failing())
    if not off:
        return gathered
    return gathered if off < len(Judge(formula, variants, sampled).failing()) else sampled


def explain(
    robot: str,
    formula: Formula,
    model: ReferenceModel,
    variants: Mapping[str, str] | str | None = None,
    parameters: Mapping[str, float] | None = None,
    tolerance: Tolerance | None = None,
    truth: Truth | None = None,
    progress: Progress = lambda label, fraction: None,
    budget: float = 8.0,
    root: Path | None = None,
    cad: CadModel | None = None,
) -> Explanation:
    """Explain where and why a formula disagrees with a mechanism, and find edits after which they agree.

    Args:
        robot: name of the robot.
        formula: the equations.
        model: the independent model of the mechanism.
        variants: the variants to judge, by equation; None: the default variant of each equation.
        parameters: values in SI that replace published ones.
        tolerance: largest deviation that counts as agreement; None for the default.
        truth: the mechanism's values, if already computed.
        progress: called with a description of the current step and the fraction done.
        budget: time limit in s of the search for two edits.
        root: folder to which file names in messages are relative; None: absolute names.
        cad: the CAD of the model; joints whose parts do not meet are analysed first. None: not analysed.

    Raises:
        TwinError: no row could be judged.
    """
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[name], clock = round(now - clock, 3), now

    def judged(model: ReferenceModel) -> Judge:
        return Judge(formula, variants, known(formula, model, parameters, variants=variants), tolerance)

    chosen = choose(formula, variants)
    corrected = correct(formula, cad, judged, lambda f: progress("correct the drawing", f)) if cad is not None else None
    lap("drawing")
    drawn: Judge | None = None
    try:
        truth = truth or known(formula, model, parameters, progress, variants)
        lap("sample")
        progress("judge rows", 0.0)
        drawn = Judge(formula, variants, truth, tolerance)
        lap("judge")
    except TwinError:
        if corrected is None or corrected.judge is None:  # otherwise the corrected CAD is used below
            raise
    judge = drawn or (corrected.judge if corrected is not None else None)
    assert judge is not None
    skipped = [s for s in judge.steps if s.missing and s.stage != "helper"]
    notes = [*_notes(judge), *judge.notes]
    if corrected is not None and (corrected.agrees or not judge.failing()):
        rows = tuple(_row(judge, p, [], root) for p in judge.failing())
        if not drawn:
            notes.append("the mechanism of the CAD cannot be moved; the rows were judged against the corrected CAD")
        verdict: Verdict = "unchecked" if skipped or not judge.residuals else "disagree"
        return Explanation(
            robot, chosen, verdict, True, judge.truth.k, (), rows, notes=tuple(notes), seconds=seconds, lead="drawing",
            drawing=corrected.findings, parts=corrected.parts,
        )  # fmt: skip
    if corrected is not None and corrected.judge is not None and corrected.model is not None:
        judge, model = corrected.judge, corrected.model
        notes.append("the corrected CAD does not explain every row; the rows below were judged against it")
    if not judge.failing():
        progress("reach and singularity measures", 0.0)
        measured = [] if skipped else margins(judge, model, dict(parameters or {}))
        lap("margins")
        covered = coverage(judge, measured)
        off = tuple(_margin(judge, m, root) for m in measured if m.status == "disagrees")
        verdict = "unchecked" if skipped or not judge.residuals else "disagree" if off else "agree"
        notes += [f"not judged: {text}" for text in covered.left]
        done = covered.rows - len(covered.left)
        return Explanation(
            robot, chosen, verdict, not off, judge.truth.k, tuple(unvalued(judge)), off, notes=tuple(notes),
            seconds=seconds, judged=done, rows_of_formula=covered.rows,
        )  # fmt: skip
    progress("invariants", 0.0)
    found_invariants = (*unvalued(judge), *invariants(judge, model))
    lap("invariants")
    progress("identify parameters", 0.0)
    identified = identify(judge, lambda f: progress("identify parameters", f), alone=True)
    lap("identify")
    search = Search(judge, lambda f: progress("try edits", f))
    if identified is None:
        found, lost = held_out(judge, model, *search.run(budget))
    else:  # one changed number explains everything: only a single edit would be equally simple
        single = search.run(0.0) if shared(judge, search.targets) else ([], search.failing)
        found, lost = held_out(judge, model, *single)
    lap("repair")
    if identified is None and (lost or not found):
        identified = identify(judge, lambda f: progress("identify parameters", f))
        seconds["identify"] += round(time.perf_counter() - clock, 3)
        clock = time.perf_counter()
    lead = weigh(found, lost, identified)
    if lead == "numbers":
        needed = sum(len(f.cures[0][0].edits) for f in found if f.cures)
        if needed and not lost:
            notes.append(f"{needed} edits together would also make the rows agree; one changed number is simpler")
        found = []
    if lead == "edits":
        identified = None
    conventional = ()
    if lead == "":
        progress("conventions", 0.0)
        conventional = tuple(conventions(judge))
        lap("conventions")
        cured = {r for c in conventional for r in c.rows}
        lead = "conventions" if conventional and all(f"{k[0]}.{_symbol(judge, k)}" in cured for k in lost) else ""
    repairs = tuple(_repair(judge, search, f, root) for f in found)
    rows = tuple(_row(judge, p, found, root) for p in judge.failing())
    return Explanation(
        robot,
        chosen,
        "unchecked" if skipped else "disagree",
        lead != "",
        judge.truth.k,
        found_invariants,
        rows,
        repairs,
        identified,
        conventional,
        tuple(notes),
        seconds,
        lead,
        corrected.findings if corrected is not None else (),
        corrected.parts if corrected is not None else (),
    )


def _notes(judge: Judge) -> list[str]:
    out = []
    if judge.truth.borrowed:
        pairs = ", ".join(f"{s} (point {p})" for s, p in judge.truth.borrowed.items())
        out.append(f"a helper defines symbols as named points; their positions are taken from the CAD: {pairs}")
    return out


def _symbol(judge: Judge, k: Key) -> str:
    return next(p.symbol for p in judge.residuals if key(p) == k)


def _shown(path: Path, root: Path | None) -> str:
    try:
        return str(path.relative_to(root)) if root is not None else str(path)
    except ValueError:
        return str(path)


def _row(judge: Judge, place: Place, found: list[Found], root: Path | None) -> Row:
    step, truth = judge.step(place.equation), judge.truth
    r = judge.residuals[place]
    size = np.abs(r).max(axis=1)
    kind = truth.kinds[place.symbol]
    name, scale = unit(kind)
    tolerance = judge.tolerance.angle if kind == "angle" else judge.tolerance.length
    statement = step.source.statements[place.statement]
    text = step.source.text(statement.start, statement.end)
    bad = ~(size <= 1)
    finite = np.where(np.isfinite(size), size, -1.0)
    top = int(np.argmax(np.where(np.isfinite(size), size, np.inf)))
    best = next((f.cures[0][0] for f in found if key(place) in f.rows and f.cures), None)
    return Row(
        place.equation,
        place.variant,
        place.symbol,
        _shown(step.source.path, root),
        place.line,
        _short(text if not statement.returns else text.splitlines()[0], 400),
        _means(judge, place.symbol),
        float(finite.max()) * tolerance / scale if finite.max() >= 0 else float("nan"),
        name,
        float(bad.mean()),
        truth.pose_text(top),
        truth.pose_text(int(np.argmin(np.where(np.isfinite(size), size, np.inf)))),
        _term(best) if best is not None and best.edits[0].statement == place.statement else "",
    )


def _margin(judge: Judge, m: Judged, root: Path | None) -> Row:
    """Return the report's `Row` for a reach, singularity measure or aspect that contradicts the mechanism."""
    kind = {"reach": f"margin of reach '{m.name}'", "aspect": "aspect"}.get(m.kind, f"singularity measure '{m.name}'")
    size = m.size if m.size is not None and m.unit else float("nan")
    step = next((s for s in judge.steps if s.equation.name == m.equation), None)
    if step is None:
        return Row(m.equation, "", m.symbol, "", 0, "", kind, size, m.unit, 0.0, m.at, "", why=m.why)
    source, last = step.source, step.source.statements[-1]
    writing = [s for s in source.statements if m.symbol in s.writes] or [last]
    line = step.lines[step.equation.outputs.index(m.symbol)] if writing == [last] else writing[-1].line
    text = source.text(writing[-1].start, writing[-1].end)
    return Row(
        m.equation,
        step.variant,
        m.symbol,
        _shown(source.path, root),
        line,
        _short(text, 400),
        kind,
        size,
        m.unit,
        0.0,
        m.at,
        "",
        why=m.why,
    )


def _means(judge: Judge, symbol: str) -> str:
    f = judge.formula
    for name, s in f.points.items():
        if symbol == s:
            return f"point {name}"
        if not isinstance(s, str) and symbol in s:
            return f"{'xyz'[s.index(symbol)]} of point {name}"
    if symbol in judge.truth.borrowed:
        return f"point {judge.truth.borrowed[symbol]}"
    if symbol in {j.name for j in f.joints}:
        return f"joint {symbol}"
    if symbol in f.passive:
        return f"passive joint {symbol}"
    return "tool pose" if judge.truth.kinds[symbol] == "pose" else symbol


def _term(c: Candidate) -> str:
    """Return the summand, with its sign, in which an edit changes a row; "" if there is none."""
    import ast

    source, e = c.step.source, c.edits[0]
    if e.function != source.name:
        return ""
    node = source.statements[e.statement].node
    best = ""
    for n in ast.walk(node):
        if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Add | ast.Sub):
            for side, sign in ((n.left, "+"), (n.right, "+" if isinstance(n.op, ast.Add) else "-")):
                a, b = source.span(side)
                whole = isinstance(side, ast.BinOp) and isinstance(side.op, ast.Add | ast.Sub)
                if a <= e.start and e.end <= b and not whole and not best:
                    best = f"{sign} {source.text(a, b)}"
    return best


def _in_changed_rows(c: Candidate) -> bool:
    """Return whether all edits are in the variant's own function, not in the rows that it shares with the default."""
    source = c.step.source
    return all(e.function == source.name and source.statements[e.statement].home is source.node for e in c.edits)


def _short(text: str, n: int = 90) -> str:
    text = " ".join(text.split())
    return text if len(text) <= n else f"{text[: n - 1]}…"


def _repair(judge: Judge, search: Search, f: Found, root: Path | None) -> Repair:
    before = max(search.base[k] for k in f.rows)
    names = tuple(f"{k[0]}.{_symbol(judge, k)}" for k in f.rows)
    cures = []
    for way in f.cures:
        own = [c for c in way if c.edits[0].function == c.step.source.name] or way
        own = [c for c in own if _in_changed_rows(c)] or own  # an edit of a shared row would also change the default
        plain = [c for c in own if all(e.kind in TOKENS for e in c.edits)] or own[:1]
        cures.append(tuple(_reading(search, c, root) for c in plain))
    tie = ""
    if len(cures) > 1:
        tie = (
            f"{len(cures)} different functions agree with the mechanism at every pose judged: the dimensions of "
            "the mechanism do not distinguish them"
        )
    elif cures and len(cures[0]) > 1:
        tie = (
            f"{len(cures[0])} edits give the same function: no pose distinguishes them, and the paper does not show "
            "which was intended"
        )
    nearest = f.runner_up
    runner = ""
    if nearest is not None:
        runner = f"{' and '.join(_phrase(e) for e in nearest.edits)} leaves {_size(judge, f.rows, f.next)}"
    note = ""
    if not f.cures:
        note = (
            "neither one edit nor a pair of edits"
            + ("" if f.complete else " among those tried")
            + (f" makes the rows agree; the nearest: {runner}" if runner else " makes the rows agree")
        )
    return Repair(
        names,
        before,
        f.after,
        f.next / max(f.after, _FLOOR) if f.cures else 0.0,
        runner,
        tuple(cures),
        tie,
        search.tried,
        f.complete,
        note,
        round(f.seconds, 2),
    )


def _size(judge: Judge, rows: list[Key], score: float) -> str:
    if not np.isfinite(score):
        return "no value"
    kind = judge.truth.kinds[_symbol(judge, rows[0])]
    name, scale = unit(kind)
    tolerance = judge.tolerance.angle if kind == "angle" else judge.tolerance.length
    return f"{score * tolerance / scale:.3g} {name}"


def _phrase(e: Edit) -> str:
    return _short(e.text, 70)


def _reading(search: Search, c: Candidate, root: Path | None) -> Reading:
    shown = _shown(c.edits[0].path, root)
    files = {e.path for e in c.edits}
    note = ""
    for e in c.edits:
        if e.kind == "left side":
            note = (
                f"the row then determines {e.new}; in Python, keep {e.old} on the left side: "
                f"{e.old} = {e.old} - {e.new} + ..."
            )
    diffs, lines = [], {}
    for path in sorted(files):
        mine = [e for e in c.edits if e.path == path]
        diffs.append(diff(mine, shown if path == c.edits[0].path else _shown(path, root)))
        lines[path] = path.read_text(encoding="utf-8").splitlines(), patched(mine).splitlines()
    changes = []
    for e in c.edits:
        before, after = lines[e.path]
        last = e.line + e.old.count("\n")
        grown = len(after) - len(before)
        changes.append(
            Change(
                _shown(e.path, root),
                e.line,
                _phrase(e),
                e.kind,
                "\n".join(before[e.line - 1 : last]).strip(),
                "\n".join(after[e.line - 1 : last + grown]).strip(),
            )
        )
    return Reading(tuple(changes), "\n".join(diffs), note, c.dropped)


__all__ = ["explain", "known", "worst"]
