"""Reference values: what the symbols of a formula are according to the mechanism, at states of the reference model."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL, Formula, arguments
from twin.formula.scalar import Value
from twin.reference import ReferenceModel, SolvedSamples
from twin.validation.explain.function_source import Source
from twin.validation.explain.rebuilt_functions import Matrix, Rebuilder

SymbolKind = Literal["length", "angle", "pose"]
"""What a value of the mechanism is: its unit and its tolerance follow from it."""

_PERTURBATION_PART = 0.01
"""Standard deviation of perturbed values, as a part of the value."""

_PERTURBATION_ADDED = 1e-3
"""Standard deviation in SI of what is added to a perturbed value, so that also a zero is changed."""


@dataclass(frozen=True)
class ReferenceValues:
    """Values of the symbols according to the mechanism.

    Attributes:
        symbols: values in SI: floats (parameters), arrays (k,) or matrices.
        kinds: kind ("length", "angle" or "pose") of each symbol with a value in the mechanism, except parameters.
        k: number of samples.
        Ts: (k, 4, 4) tool poses in base.
        run: states of the mechanism, one for each sample; None if the values are not those of such states.
        coordinates: names and units of the pose coordinates, for messages.
        borrowed: {symbol: named point} for each symbol to which a helper assigns an unchanged named point.
        free_parameter: name of the free parameter (swivel) of a redundant mechanism, or "". The value of this parameter
            in each state is fitted to the rows that use the parameter.
    """

    symbols: Mapping[str, Value]
    kinds: Mapping[str, SymbolKind]
    k: int
    Ts: Array
    run: SolvedSamples | None
    coordinates: tuple[tuple[str, str], ...]
    borrowed: Mapping[str, str]
    free_parameter: str = ""

    def with_values(self, values: Mapping[str, Value]) -> ReferenceValues:
        """Return a copy of this object with other values of some symbols, in SI."""
        return replace(self, symbols={**self.symbols, **values})

    def perturbed(self, seed: int = 1) -> ReferenceValues:
        """Return randomly perturbed values, which no mechanism can have, to detect rows that agree by coincidence.

        All symbols are perturbed at each sample by itself, also floats (parameters), which become arrays (k,). A matrix
        that stands for all samples is perturbed once.
        """
        rng = np.random.default_rng(seed)
        symbols: dict[str, Value] = {}
        for name, value in self.symbols.items():
            if isinstance(value, Matrix):
                factor = 1 + _PERTURBATION_PART * rng.standard_normal(value.a.shape)
                symbols[name] = Matrix(value.a * factor)
                continue
            x = np.broadcast_to(np.asarray(value, float), (self.k,))
            factor = 1 + _PERTURBATION_PART * rng.standard_normal(self.k)
            added = _PERTURBATION_ADDED * rng.standard_normal(self.k)
            symbols[name] = x * factor + added
        return replace(self, symbols=symbols, run=None)

    def first(self) -> ReferenceValues:
        """Return the values at the first sample only, without its state `run`."""
        return self.repeated((0,), 1)

    def repeated(self, samples: Sequence[int], times: int) -> ReferenceValues:
        """Return the values at some samples, repeated several times, without their states `run`."""
        rows = np.tile(np.asarray(samples), times)
        symbols: dict[str, Value] = {}
        for name, value in self.symbols.items():
            if isinstance(value, Matrix):
                # One matrix may stand for all samples.
                of_samples = np.broadcast_to(value.a, (self.k, *value.a.shape[1:]))
                symbols[name] = Matrix(of_samples[rows])
            elif np.ndim(value):
                symbols[name] = np.asarray(value)[rows]
            else:
                symbols[name] = value
        return replace(self, symbols=symbols, k=len(rows), Ts=self.Ts[rows], run=None)

    def pose_text(self, i: int) -> str:
        """Return the pose coordinates of sample i as text, in mm and degrees."""
        parts = []
        for name, unit in self.coordinates:
            value = float(np.broadcast_to(self.symbols[name], (self.k,))[i])
            if unit == "m":
                parts.append(f"{name} {value * 1e3:.1f} mm")
            else:
                parts.append(f"{name} {np.degrees(value):.1f}°")
        return ", ".join(parts)


def symbol_values(
    formula: Formula, run: SolvedSamples, model: ReferenceModel, parameters: Mapping[str, float] | None = None
) -> ReferenceValues:
    """Return the values of the formula's symbols at states `run` of the mechanism.

    `parameters` are values in SI by name, which replace those of the formula.
    """
    symbols: dict[str, Value] = {}
    for parameter in formula.parameters:
        symbols[parameter.name] = float(parameter.value)
    symbols |= dict(parameters or {})
    kinds: dict[str, SymbolKind] = {POSE_SYMBOL: "pose"}
    pose = Matrix(run.Ts_base_tool)
    symbols[POSE_SYMBOL] = pose
    with np.errstate(all="ignore"):
        coordinates = Rebuilder().function(formula.coordinates.from_pose)(pose)
    units = tuple(zip(formula.coordinates.names, formula.coordinates.units, strict=True))
    for (name, unit), value in zip(units, coordinates, strict=True):
        symbols[name] = value
        kinds[name] = "angle" if unit == "rad" else "length"
    _add_joints(formula, run, model, symbols, kinds)
    borrowed = _add_points(formula, run, symbols, kinds)
    return ReferenceValues(
        symbols=symbols,
        kinds=kinds,
        k=len(run.x),
        Ts=run.Ts_base_tool,
        run=run,
        coordinates=units,
        borrowed=borrowed,
        free_parameter=_free_parameter(formula, model),
    )


def _add_joints(
    formula: Formula, run: SolvedSamples, model: ReferenceModel, symbols: dict[str, Value], kinds: dict[str, SymbolKind]
) -> None:
    """Add the values of active and passive joints to `symbols`, and their kinds to `kinds`."""
    order = [joint.name for joint in model.mechanism.active]
    for joint in formula.joints:
        symbols[joint.name] = run.q[:, order.index(joint.name)]
        kinds[joint.name] = "angle" if joint.kind == "revolute" else "length"
    is_angle = {joint.name: joint.is_angle for joint in model.mechanism.joints}
    for name in formula.passive:
        if name in run.q_passive:
            symbols[name] = run.q_passive[name]
            kinds[name] = "angle" if is_angle[name] else "length"


def _add_points(
    formula: Formula, run: SolvedSamples, symbols: dict[str, Value], kinds: dict[str, SymbolKind]
) -> dict[str, str]:
    """Add the positions of named points to `symbols`, and their kinds to `kinds`; return `borrowed`.

    For `borrowed`, see `ReferenceValues`: a helper may only give another name to a point.
    """
    borrowed: dict[str, str] = {}
    sources_of = _passed_on(formula)
    for name, symbol in formula.points.items():
        if name not in run.points:
            continue
        p = run.points[name]
        if not isinstance(symbol, str):  # the point has one symbol for each of its coordinates
            for i, coordinate in enumerate(symbol):
                symbols[coordinate] = p[:, i]
                kinds[coordinate] = "length"
            continue
        symbols[symbol] = Matrix(p[:, :, None])
        kinds[symbol] = "length"
        for source, component in sources_of.get(symbol, ()):
            if source in kinds or source in symbols:
                continue
            if component is None:
                symbols[source] = Matrix(p[:, :, None])
            else:
                symbols[source] = p[:, component]
            kinds[source] = "length"
            borrowed[source] = name
    return borrowed


def _free_parameter(formula: Formula, model: ReferenceModel) -> str:
    """Return the angle that only inverse rows use, if the mechanism is redundant; "" without exactly one such angle."""
    if not (model.redundant and formula.has("inverse") and formula.has("forward")):
        return ""
    read: dict[str, set[str]] = {"inverse": set(), "forward": set()}
    for equation in formula.equations:
        if equation.stage != "helper":
            required, optional = arguments(equation.variants[equation.default])
            read[equation.stage] |= {*required, *optional}
    angles: list[str] = []
    for p in formula.parameters:
        only_inverse = p.name in read["inverse"] and p.name not in read["forward"]
        if only_inverse and p.unit in ("deg", "rad"):
            angles.append(p.name)
    if len(angles) != 1:
        return ""
    return angles[0]


def _passed_on(formula: Formula) -> dict[str, list[tuple[str, int | None]]]:
    """Return {output: [(argument, index or None)]} for outputs of helpers that are unchanged arguments.

    The index is that of an argument which is one coordinate of a vector, as in `return vertcat(x, y, z)`.
    """
    passed: dict[str, list[tuple[str, int | None]]] = {}
    for equation in formula.equations:
        if equation.stage != "helper":
            continue
        try:
            source = Source(equation.variants[equation.default])
        except TwinError:
            continue
        last = source.statements[-1].node if source.statements else None
        if not isinstance(last, ast.Return):
            continue
        elements: Sequence[ast.expr | None] = [last.value]
        if isinstance(last.value, ast.Tuple):
            elements = last.value.elts
        for symbol, element in zip(equation.outputs, elements, strict=False):
            if isinstance(element, ast.Name) and element.id in source.arguments:
                passed.setdefault(symbol, []).append((element.id, None))
            for index, name in enumerate(_vector_of(element, source.arguments)):
                passed.setdefault(symbol, []).append((name, index))
    return passed


def _vector_of(element: ast.expr | None, arguments: Sequence[str]) -> list[str]:
    """Return the three arguments of which an expression makes a vector, such as `vertcat(x, y, z)`; else none."""
    if not isinstance(element, ast.Call) or getattr(element.func, "id", "") != "vertcat":
        return []
    names: list[str] = []
    for part in element.args:
        if not isinstance(part, ast.Name) or part.id not in arguments:
            return []
        names.append(part.id)
    if len(names) != 3:
        return []
    return names
