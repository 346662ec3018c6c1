"""Seed faults into the equations: each fault is one edit of the source, of a kind that occurs in misprints."""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import inspect
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from twin.analysis.mutation.fault import Fault
from twin.api.robot import Robot
from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.formula.contract import Formula
from twin.robots import load_formula
from twin.validation.explain.edits import edits, pool
from twin.validation.explain.source import Edit, Source, patched

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

_TRIES = 40


def functions(formula: Formula) -> list[FunctionType]:
    """Return the functions that compute the published equations of a formula, and the helpers that they call.

    Functions of other files are omitted.
    """
    todo: list[Any] = [inspect.unwrap(e.variants[e.default]) for e in formula.equations if e.stage != "helper"]
    found: list[FunctionType] = []
    home = todo[0].__globals__
    while todo:
        f = todo.pop(0)
        if f in found or f.__globals__ is not home:
            continue
        found.append(f)
        todo += [home[n] for n in f.__code__.co_names if inspect.isfunction(home.get(n))]
    return found


def faults(robot: Robot, rng: np.random.Generator, count: int) -> Iterator[Fault]:
    """Yield different faults of the equations of a robot."""
    assert robot.files is not None
    formula = robot.formula
    sources = []
    made_of = functions(formula)
    for f in made_of:
        try:
            sources.append(Source(f))
        except TwinError:  # a wrapper has no source text
            continue
    parameters = {p.name for p in formula.parameters}
    seen: set[str] = set()
    for i in range(count):
        kind = list(KINDS)[i % len(KINDS)]
        for _ in range(_TRIES):
            edit = _draw(sources, parameters, made_of[0].__globals__, KINDS[kind], rng)
            if edit is None or (text := patched([edit])) in seen:
                continue
            seen.add(text)
            if not _compiles(text, robot):
                continue
            what = f"{edit.function}, line {edit.line}: {edit.text}"
            yield Fault("formula", kind, what, robot=_maker(robot, edit))
            break


def _draw(
    sources: list[Source],
    parameters: set[str],
    scope: dict[str, Any],
    kinds: tuple[str, ...],
    rng: np.random.Generator,
) -> Edit | None:
    source = sources[rng.integers(len(sources))]
    statements = [s for s in source.statements if not isinstance(s.node, ast.FunctionDef)]
    if not statements:
        return None
    statement = statements[rng.integers(len(statements))]
    around = pool(source, statement, set(source.arguments), parameters & set(source.arguments), scope)
    some = [e for e in edits(source, statement, around, kinds) if e.define is None]
    return some[rng.integers(len(some))] if some else None


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


def _maker(robot: Robot, edit: Edit):
    def make(folder: Path) -> Robot:
        assert robot.files is not None
        text = patched([edit])
        # a file name for each text, because modules are cached by path
        path = folder / f"formula_{hashlib.sha256(text.encode()).hexdigest()[:8]}.py"
        path.write_text(text, encoding="utf-8")
        return with_formula(robot, path)

    return make


def with_formula(robot: Robot, path: Path) -> Robot:
    """Return the same robot with equations from another file."""
    assert robot.files is not None
    formula = load_formula(path, robot.name, lambda: robot.mechanism.driven, trial=True)
    return dataclasses.replace(robot, files=dataclasses.replace(robot.files, formula=path), equations=formula)
