"""Find the statements on which a row depends, and the symbols that are available to an equation."""

from __future__ import annotations

from collections.abc import Sequence

from twin.formula.contract import POSE_SYMBOL
from twin.validation.explain.equation_steps import RowPlace, Step
from twin.validation.explain.row_deviations import Judge


def suspects(judge: Judge, place: RowPlace) -> dict[str, set[int]]:
    """Return {equation: indices of the statements on which the value of a row depends}."""
    statements: dict[str, set[int]] = {}
    step = judge.step(place.equation)
    _trace(judge, step, place.statement, place.position, statements, set())
    if step.stuck:  # the return statement could not be reached, and may have another fault
        statements[place.equation].add(step.source.statements[-1].index)
    return statements


def unread(step: Step) -> set[int]:
    """Return the indices of statements whose results no later statement reads, and no row compares.

    A result that nobody reads is itself a hint: a later statement may have another name in its place.
    """
    indices: set[int] = set()
    read: set[str] = set()
    for statement in reversed(step.source.statements):
        if not (
            statement.returns
            or step.compared_variables.intersection(statement.writes)
            or read.intersection(statement.writes)
        ):
            indices.add(statement.index)
        read |= statement.reads
    return indices


def shared(judge: Judge, places: Sequence[RowPlace]) -> bool:
    """Return whether all given rows use a common statement or function, so that one fault could explain them all."""
    statements: list[set[tuple[str, int]]] = []
    called: list[set[str]] = []
    for place in places:
        indices_of = suspects(judge, place)
        used: set[tuple[str, int]] = set()
        functions: set[str] = set()
        for equation, indices in indices_of.items():
            used.update((equation, i) for i in indices)
            functions.update(h.source.name for h in judge.helpers(judge.step(equation)))
        statements.append(used)
        called.append(functions)
    if not places:
        return False
    return bool(set.intersection(*statements)) or bool(set.intersection(*called))


def passed(judge: Judge, rows: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the outputs (equation, symbol) of other equations that `rows` use, so that they are judged indirectly."""
    seen: set[str] = set()
    steps = {s.equation.name: s for s in judge.steps}
    for equation, symbol in sorted(rows):
        step = steps.get(equation)
        if step is None or symbol not in step.equation.outputs or not step.source.statements:
            continue
        for place in judge.residuals:
            if place.equation == equation and place.symbol == symbol:
                _trace(judge, step, place.statement, place.position, {}, seen)
        last = step.source.statements[-1]
        _trace(judge, step, last.index, step.equation.outputs.index(symbol), {}, seen)
    outputs: set[tuple[str, str]] = set()
    for step in judge.steps:
        for name in step.equation.outputs:
            if name in seen:
                outputs.add((step.equation.name, name))
    return outputs


def available(judge: Judge, step: Step) -> set[str]:
    """Return the symbols that are available when an equation is evaluated."""
    names = {p.name for p in judge.formula.parameters}
    if step.stage == "inverse":
        names |= {*judge.formula.coordinates.names, POSE_SYMBOL}
    elif step.stage == "forward":
        names |= {j.name for j in judge.formula.joints}
    else:  # all symbols of the mechanism, except outputs of this equation and of later equations
        symbols = set(judge.reference.symbols)
        for later in judge.steps[judge.steps.index(step) :]:
            symbols.difference_update(later.equation.outputs)
        names |= symbols
    return names | set(step.computed) | set(step.inputs)


def _trace(judge: Judge, step: Step, index: int, position: int, out: dict[str, set[int]], seen: set[str]) -> None:
    """Add to `out` the statements on which the value at a position of a statement depends; `seen`: symbols done."""
    indices = out.setdefault(step.equation.name, set())
    statements = step.source.statements
    statement = statements[index]
    indices.add(index)
    wanted = set(statement.reads)
    if statement.returns:
        wanted = statement.reads_at(position)
    for i in range(index - 1, -1, -1):
        written = wanted & set(statements[i].writes)
        if not written:
            continue
        if written <= step.compared_variables:  # compared there, and then replaced by the mechanism's values
            wanted -= written
            continue
        indices.add(i)
        wanted |= statements[i].reads
        if not statements[i].reads & written:  # a statement that also reads the variable keeps a part of its value
            wanted -= written
    for name in wanted:
        if name in judge.reference.kinds or name not in step.inputs:
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
        if name in other.output_values and (other.stage == step.stage or step.stage == "helper"):
            return other
    return None
