"""Find the statements on which a row depends, and the symbols that are available to an equation."""

from __future__ import annotations

from collections.abc import Sequence

from twin.formula.contract import POSE_SYMBOL
from twin.validation.explain.judge import Judge
from twin.validation.explain.rows import Place, Step


def suspects(judge: Judge, place: Place) -> dict[str, set[int]]:
    """Return {equation: indices of the statements on which the value of a row depends}."""
    out: dict[str, set[int]] = {}
    _trace(judge, judge.step(place.equation), place.statement, place.position, out, set())
    return out


def shared(judge: Judge, places: Sequence[Place]) -> bool:
    """Return whether all given rows use a common statement or function, so that one fault could explain them all."""
    every = [suspects(judge, place) for place in places]
    statements = [{(equation, i) for equation, indices in s.items() for i in indices} for s in every]
    called = [{h.source.name for equation in s for h in judge.helpers(judge.step(equation))} for s in every]
    return bool(set.intersection(*statements) or set.intersection(*called)) if every else False


def passed(judge: Judge, rows: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the outputs (equation, symbol) of other equations that `rows` use, so that they are judged indirectly."""
    seen: set[str] = set()
    for equation, symbol in sorted(rows):
        step = next((s for s in judge.steps if s.equation.name == equation), None)
        if step is None or symbol not in step.equation.outputs or not step.source.statements:
            continue
        for place in [p for p in judge.residuals if (p.equation, p.symbol) == (equation, symbol)]:
            _trace(judge, step, place.statement, place.position, {}, seen)
        last = step.source.statements[-1]
        _trace(judge, step, last.index, step.equation.outputs.index(symbol), {}, seen)
    return {(s.equation.name, n) for s in judge.steps for n in s.equation.outputs if n in seen}


def available(judge: Judge, step: Step) -> set[str]:
    """Return the symbols that are available when an equation is evaluated."""
    names = {p.name for p in judge.formula.parameters}
    if step.stage == "inverse":
        names |= {*judge.formula.coordinates.names, POSE_SYMBOL}
    elif step.stage == "forward":
        names |= {j.name for j in judge.formula.joints}
    else:  # all symbols of the mechanism, except outputs of this equation and of later equations
        later = judge.steps[judge.steps.index(step) :]
        names |= set(judge.truth.symbols) - {n for s in later for n in s.equation.outputs}
    return names | set(step.computed) | set(step.inputs)


def _trace(judge: Judge, step: Step, index: int, position: int, out: dict[str, set[int]], seen: set[str]) -> None:
    mine = out.setdefault(step.equation.name, set())
    statements = step.source.statements
    s = statements[index]
    mine.add(index)
    wanted = s.reads_at(position) if s.returns else set(s.reads)
    for i in range(index - 1, -1, -1):
        if wanted & set(statements[i].writes):
            hit = wanted & set(statements[i].writes)
            if hit <= step.held:
                wanted -= hit
                continue
            mine.add(i)
            wanted |= statements[i].reads
            if not set(statements[i].reads) & hit:
                wanted -= hit
    for name in wanted:
        if name in judge.truth.kinds or name not in step.inputs:
            continue
        maker = _maker(judge, step, name)
        if maker is not None and name not in seen:
            seen.add(name)
            last = maker.source.statements[-1]
            _trace(judge, maker, last.index, maker.equation.outputs.index(name), out, seen)


def _maker(judge: Judge, step: Step, name: str) -> Step | None:
    for other in judge.steps:
        if other is step:
            break
        if name in other.gave and (other.stage == step.stage or step.stage == "helper"):
            return other
    return None
