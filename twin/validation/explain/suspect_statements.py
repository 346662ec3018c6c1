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


def unread_statements(step: Step) -> set[int]:
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


def have_common_source(judge: Judge, places: Sequence[RowPlace]) -> bool:
    """Return whether all given rows use a common statement or function, so that one fault could explain them all."""
    if not places:
        return False
    statements_of_rows: list[set[tuple[str, int]]] = []
    functions_of_rows: list[set[str]] = []
    for place in places:
        statements: set[tuple[str, int]] = set()
        functions: set[str] = set()
        for equation, indices in suspects(judge, place).items():
            for i in indices:
                statements.add((equation, i))
            for helper in judge.helpers(judge.step(equation)):
                functions.add(helper.source.name)
        statements_of_rows.append(statements)
        functions_of_rows.append(functions)
    return bool(set.intersection(*statements_of_rows)) or bool(set.intersection(*functions_of_rows))


def indirectly_judged(judge: Judge, rows: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the outputs (equation, symbol) of other equations that `rows` use, so that they are judged indirectly."""
    used_symbols: set[str] = set()
    steps = {step.equation.name: step for step in judge.steps}
    for equation, symbol in sorted(rows):
        step = steps.get(equation)
        if step is None or symbol not in step.equation.outputs or not step.source.statements:
            continue
        for place in judge.residuals:
            if place.equation == equation and place.symbol == symbol:
                _trace(judge, step, place.statement, place.position, {}, used_symbols)
        last = step.source.statements[-1]
        _trace(judge, step, last.index, step.equation.outputs.index(symbol), {}, used_symbols)
    outputs: set[tuple[str, str]] = set()
    for step in judge.steps:
        for name in step.equation.outputs:
            if name in used_symbols:
                outputs.add((step.equation.name, name))
    return outputs


def available_symbols(judge: Judge, step: Step) -> set[str]:
    """Return the symbols that are available when an equation is evaluated."""
    names = {parameter.name for parameter in judge.formula.parameters}
    if step.stage == "inverse":
        names |= {*judge.formula.coordinates.names, POSE_SYMBOL}
    elif step.stage == "forward":
        names |= {joint.name for joint in judge.formula.joints}
    else:  # all symbols of the mechanism, except outputs of this equation and of later equations
        symbols = set(judge.reference.symbols)
        for later in judge.steps[judge.steps.index(step) :]:
            symbols.difference_update(later.equation.outputs)
        names |= symbols
    return names | set(step.computed) | set(step.inputs)


def _trace(
    judge: Judge,
    step: Step,
    index: int,
    position: int,
    suspected: dict[str, set[int]],
    traced_symbols: set[str],
) -> None:
    """Add to `suspected` the statements on which the value at a position of a statement depends.

    Outputs of earlier equations are traced in these; `traced_symbols` are those outputs that were traced already.
    """
    indices = suspected.setdefault(step.equation.name, set())
    statements = step.source.statements
    statement = statements[index]
    indices.add(index)
    needed = set(statement.reads)
    if statement.returns:
        needed = statement.reads_at(position)
    for i in range(index - 1, -1, -1):
        written = needed & set(statements[i].writes)
        if not written:
            continue
        if written <= step.compared_variables:  # compared there, and then replaced by the mechanism's values
            needed -= written
            continue
        indices.add(i)
        needed |= statements[i].reads
        if not statements[i].reads & written:  # a statement that also reads the variable keeps a part of its value
            needed -= written
    for name in needed:
        if name in judge.reference.kinds or name not in step.inputs:
            continue
        source_step = _step_of_output(judge, step, name)
        if source_step is not None and name not in traced_symbols:
            traced_symbols.add(name)
            last = source_step.source.statements[-1]
            output_position = source_step.equation.outputs.index(name)
            _trace(judge, source_step, last.index, output_position, suspected, traced_symbols)


def _step_of_output(judge: Judge, step: Step, name: str) -> Step | None:
    """Return the earlier equation whose output an equation uses; None if no equation computes it."""
    for earlier in judge.steps:
        if earlier is step:
            break
        is_usable = earlier.stage == step.stage or step.stage == "helper"
        if name in earlier.output_values and is_usable:
            return earlier
    return None
