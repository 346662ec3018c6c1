"""Values of a formula's symbols according to the mechanism, at sampled poses of the independent model."""

from __future__ import annotations

import ast
import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from twin.core.errors import AssemblyError, TwinError
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL, Formula, arguments
from twin.formula.scalar import Value
from twin.model.joint import Joint
from twin.reference import Assembly, ReferenceModel, SolvedSamples
from twin.reference.conditioning import conditioning
from twin.reference.loops import LENGTH_SCALE
from twin.validation.explain.function_source import Source
from twin.validation.explain.rebuilt_functions import Matrix, Rebuilder

SAMPLES = 24
"""Number of poses at which a formula is judged."""

_SPREAD = 0.06
"""Half width of the box of joint values that is sampled around each posture, as a fraction of each joint's range."""

_POSTURES = 4
"""Maximum number of postures around which the mechanism is sampled: the first ones in the description."""

_FEWEST = 6
"""Minimum number of states with which a formula is judged, if the mechanism hardly moves."""

_REGULAR = 0.1
"""A posture is skipped as near a singularity if its conditioning is below this fraction of the best conditioning."""

Kind = Literal["length", "angle", "pose"]


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
        free: name of the free parameter (swivel) of a redundant mechanism, or "". The value of this parameter in each
            state is fitted to the rows that use the parameter.
    """

    symbols: Mapping[str, Value]
    kinds: Mapping[str, Kind]
    k: int
    Ts: Array
    run: SolvedSamples | None
    coordinates: tuple[tuple[str, str], ...]
    borrowed: Mapping[str, str]
    free: str = ""

    def with_parameters(self, values: Mapping[str, Value]) -> ReferenceValues:
        """Return a copy of this object with other parameter values in SI."""
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
                symbols[name] = Matrix(value.a * (1 + 0.01 * rng.standard_normal(value.a.shape)))
                continue
            x = np.broadcast_to(np.asarray(value, float), (self.k,))
            # A relative and an absolute change, so that also a zero is changed.
            symbols[name] = x * (1 + 0.01 * rng.standard_normal(self.k)) + 1e-3 * rng.standard_normal(self.k)
        return replace(self, symbols=symbols, run=None)

    def first(self) -> ReferenceValues:
        """Return the values at the first sample only, without its state `run`."""
        return self.repeated((0,), 1)

    def repeated(self, samples: Sequence[int], times: int) -> ReferenceValues:
        """Return the values at some samples, repeated several times, without their states `run`."""
        rows = np.tile(np.asarray(samples), times)
        symbols: dict[str, Value] = {}
        for name, value in self.symbols.items():
            if isinstance(value, Matrix):  # one matrix may stand for all samples
                symbols[name] = Matrix(np.broadcast_to(value.a, (self.k, *value.a.shape[1:]))[rows])
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


def sample_states(
    model: ReferenceModel,
    samples: int = SAMPLES,
    seed: int = 7,
    progress: Callable[[float], None] = lambda f: None,
    regular: bool = False,
) -> SolvedSamples:
    """Return states of the mechanism around its first `_POSTURES` postures (without postures: around the rest poses).

    With `regular`, postures near a singularity, where several assembly modes meet, are skipped. The result has fewer
    than `samples` states, but at least `_FEWEST`, if the mechanism can take few of the drawn ones.

    Raises:
        TwinError: the mechanism can take fewer than `_FEWEST` of the drawn states.
    """
    mechanism = model.mechanism
    rng = np.random.default_rng(seed)
    low, high, half = _box(mechanism.active)
    starts = _starts(model, regular)
    states: list[Array] = []
    for shrink in (1.0, 0.5, 0.2, 0.05):
        for i, start in enumerate(starts):
            # The starts that are left share the samples that are missing.
            wanted = (samples - len(states)) // (len(starts) - i)
            q = start.q + shrink * half * rng.uniform(-1, 1, (wanted, len(half)))
            states += _solved(model, np.clip(q, low, high), start)
            progress(len(states) / samples)
        if len(states) >= samples:
            break
    if len(states) < _FEWEST:
        raise TwinError(
            f"{mechanism.name}: the mechanism hardly moves near its postures, so there are no poses for the check"
        )
    return model.collect(np.array(states))


def _box(joints: Sequence[Joint]) -> tuple[Array, Array, Array]:
    """Return (lower limits, upper limits, half widths of the sampled box), each (n,), in m and rad.

    Limits may be infinite; the half widths are finite.
    """
    ranges: list[tuple[float, float]] = []
    most: list[float] = []  # half widths for joints with a long range
    for joint in joints:
        if joint.is_angle:
            ranges.append(joint.limits or (-0.5, 0.5))
            most.append(0.3)
        else:
            ranges.append(joint.limits or (-0.1, 0.1))
            most.append(0.02)
    limits = np.array(ranges)
    half = np.minimum(_SPREAD * np.ptp(limits, axis=1), most)
    return limits[:, 0], limits[:, 1], half


def _starts(model: ReferenceModel, regular: bool) -> list[Assembly]:
    """Return the states around which the mechanism is sampled."""
    mechanism = model.mechanism
    starts: list[Assembly] = []
    for name in list(mechanism.postures)[:_POSTURES]:
        with contextlib.suppress(AssemblyError):
            starts.append(model.solve(np.asarray(mechanism.posture(name), float)))
    if not starts:
        starts = [model.home()]
    if not regular:
        return starts
    values = conditioning(model, np.array([s.x for s in starts]), LENGTH_SCALE).stands
    return [s for s, value in zip(starts, values, strict=True) if value >= _REGULAR * values.max()]


def _solved(model: ReferenceModel, q: Array, start: Assembly) -> list[Array]:
    """Return the reachable states at joint values q (k, n), solved together or, if that fails, one by one."""
    if not len(q):
        return []
    try:
        return list(model.solve_many(q, start).x)
    except AssemblyError:
        states: list[Array] = []
        for one in q:
            with contextlib.suppress(AssemblyError):
                states.append(model.solve(one, start).x)
        return states


def symbol_values(
    formula: Formula, run: SolvedSamples, model: ReferenceModel, parameters: Mapping[str, float] | None = None
) -> ReferenceValues:
    """Return the values of the formula's symbols at states of the mechanism."""
    symbols: dict[str, Value] = {p.name: float(p.value) for p in formula.parameters}
    symbols |= dict(parameters or {})
    kinds: dict[str, Kind] = {POSE_SYMBOL: "pose"}
    symbols[POSE_SYMBOL] = Matrix(run.Ts_base_tool)
    with np.errstate(all="ignore"):
        coordinates = Rebuilder().function(formula.coordinates.from_pose)(symbols[POSE_SYMBOL])
    units = tuple(zip(formula.coordinates.names, formula.coordinates.units, strict=True))
    for (name, unit), value in zip(units, coordinates, strict=True):
        symbols[name] = value
        kinds[name] = "angle" if unit == "rad" else "length"
    order = [j.name for j in model.mechanism.active]
    for joint in formula.joints:
        symbols[joint.name] = run.q[:, order.index(joint.name)]
        kinds[joint.name] = "angle" if joint.kind == "revolute" else "length"
    angular = {j.name: j.is_angle for j in model.mechanism.joints}
    for name in formula.passive:
        if name in run.q_passive:
            symbols[name] = run.q_passive[name]
            kinds[name] = "angle" if angular[name] else "length"
    borrowed: dict[str, str] = {}
    sources_of = _passed_on(formula)
    for name, symbol in formula.points.items():
        if name not in run.points:
            continue
        p = run.points[name]
        if not isinstance(symbol, str):
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
    return ReferenceValues(symbols, kinds, len(run.x), run.Ts_base_tool, run, units, borrowed, _free(formula, model))


def _free(formula: Formula, model: ReferenceModel) -> str:
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
        if p.unit in ("deg", "rad") and p.name in read["inverse"] and p.name not in read["forward"]:
            angles.append(p.name)
    return angles[0] if len(angles) == 1 else ""


def _passed_on(formula: Formula) -> dict[str, list[tuple[str, int | None]]]:
    """Return {output: [(argument, index or None)]} for outputs of helpers that are unchanged arguments."""
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
            if isinstance(element, ast.Call) and getattr(element.func, "id", "") == "vertcat":
                names = [a.id for a in element.args if isinstance(a, ast.Name)]
                if len(element.args) == 3 and len(names) == 3 and set(names) <= set(source.arguments):
                    passed.setdefault(symbol, []).extend(zip(names, range(3), strict=True))
    return passed
