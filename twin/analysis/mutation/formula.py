"""Seed faults into the equations: each fault is one edit of the source, of a kind that occurs in misprints."""

from __future__ import annotations

import ast
import copy
import dataclasses
import hashlib
import inspect
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FunctionType
from typing import cast

import numpy as np

from twin.analysis.mutation.fault import SeededFault, random_item
from twin.api.robot import Robot
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.formula.contract import Formula
from twin.robots import load_formula
from twin.validation.explain.function_source import Edit, Source, patched
from twin.validation.explain.name_pool import name_pool
from twin.validation.explain.statement_edits import statement_edits

KINDS: dict[str, tuple[str, ...]] = {
    "sign": ("sign",),
    "sin for cos": ("trig", "function"),
    "index": ("index",),
    "coefficient": ("number", "exponent"),
    "dropped term": ("surplus",),
    "another symbol": ("name", "parameter"),
    "operator": ("operator", "order", "transpose"),
    "added term": ("missing",),
}
"""{kind of fault: kinds of edits that produce this fault}; every kind of fault is seeded equally often."""

_MOST_DRAWS = 40
"""Maximum number of draws for each fault: some edits repeat others, or do not run."""


def functions(formula: Formula) -> list[FunctionType]:
    """Return the functions that compute the published equations of a formula, and the helpers that they call.

    Functions of other files are omitted.
    """
    queue: list[FunctionType] = []
    for equation in formula.equations:
        if equation.stage != "helper":
            queue.append(cast("FunctionType", inspect.unwrap(equation.variants[equation.default])))
    functions_found: list[FunctionType] = []
    home = queue[0].__globals__
    while queue:
        function = queue.pop(0)
        if function in functions_found or function.__globals__ is not home:
            continue
        functions_found.append(function)
        for name in function.__code__.co_names:
            if inspect.isfunction(home.get(name)):
                queue.append(home[name])
    return functions_found


def faults(robot: Robot, rng: np.random.Generator, count: int) -> Iterator[SeededFault]:
    """Yield different faults of the equations of a robot."""
    assert robot.files is not None
    formula = robot.formula
    equations = functions(formula)
    sources = []
    for function in equations:
        try:
            sources.append(Source(function))
        except TwinError:  # a wrapper has no source text
            continue
    parameter_names = {parameter.name for parameter in formula.parameters}
    scope = equations[0].__globals__
    kinds = list(KINDS)
    texts: set[str] = set()
    for i in range(count):
        kind = kinds[i % len(kinds)]
        for _ in range(_MOST_DRAWS):
            edit = _random_edit(sources, parameter_names, scope, KINDS[kind], rng)
            if edit is None:
                continue
            text = patched([edit])
            if text in texts:
                continue
            texts.add(text)
            if not _compiles(text, robot):
                continue
            what = f"{edit.function}, line {edit.line}: {edit.text}"
            yield SeededFault("formula", kind, what, robot=_robot_maker(robot, text))
            break


def _random_edit(
    sources: list[Source],
    parameter_names: set[str],
    scope: dict[str, object],
    kinds: tuple[str, ...],
    rng: np.random.Generator,
) -> Edit | None:
    """Return an edit of one of these kinds in a statement drawn from all functions; None if it has none."""
    source = random_item(sources, rng)
    statements = []
    for statement in source.statements:
        if not isinstance(statement.node, ast.FunctionDef):
            statements.append(statement)
    if not statements:
        return None
    statement = random_item(statements, rng)
    arguments = set(source.arguments)
    names_in_scope = name_pool(source, statement, arguments, parameter_names & arguments, scope)
    # A misprint changes one place; an edit that needs a definition elsewhere is none.
    misprints = []
    for edit in statement_edits(source, statement, names_in_scope, kinds):
        if edit.define is None:
            misprints.append(edit)
    if not misprints:
        return None
    return random_item(misprints, rng)


def _compiles(text: str, robot: Robot) -> bool:
    """Return whether the edited equations run without an error; otherwise the fault is not used."""
    with Scratch() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / "formula.py"
        path.write_text(text, encoding="utf-8")
        try:
            with_formula(robot, path).kinematics(parameters={})
        except TwinError:
            return False
    return True


def _robot_maker(robot: Robot, text: str) -> Callable[[Path], Robot]:
    """Return the function that writes a formula with this text to a folder, and returns the robot with it."""

    def make(folder: Path) -> Robot:
        # a file name for each text, because modules are cached by path
        digest = hashlib.sha256(text.encode()).hexdigest()
        path = folder / f"formula_{digest[:8]}.py"
        path.write_text(text, encoding="utf-8")
        return with_formula(robot, path)

    return make


def with_formula(robot: Robot, path: Path) -> Robot:
    """Return the same robot with equations from another file."""
    assert robot.files is not None
    formula = load_formula(path, robot.name, lambda: robot.mechanism.driven, trial=True)
    files = dataclasses.replace(robot.files, formula=path)
    # A copy keeps the CAD that was read: only the equations are others.
    source = copy.copy(robot.source)
    source.files = files
    return dataclasses.replace(robot, source=source, given_formula=formula)
