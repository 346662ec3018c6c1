"""Values of a formula's symbols according to the mechanism, at sampled poses of the independent model."""

from __future__ import annotations

import ast
import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from twin.core.errors import AssemblyError, TwinError
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL, Formula, arguments
from twin.reference import Assembly, ReferenceModel, SolvedSamples
from twin.reference.conditioning import conditioning
from twin.reference.loops import LENGTH_SCALE
from twin.validation.explain.numeric import Matrix, Rebuilder
from twin.validation.explain.source import Source

SAMPLES = 24
"""Number of poses at which a formula is judged."""

_SPREAD = 0.06
"""Half width of the box of joint values that is sampled around each posture, as a fraction of each joint's range."""

_REGULAR = 0.1
"""A posture is skipped as near a singularity if its conditioning is below this fraction of the best conditioning."""

Kind = Literal["length", "angle", "pose"]


@dataclass(frozen=True)
class Truth:
    """Values of the symbols according to the mechanism.

    Attributes:
        symbols: values in SI: floats (parameters), arrays (k,) or matrices.
        kinds: kind ("length", "angle" or "pose") of each symbol with a value in the mechanism, except parameters.
        k: number of samples.
        Ts: (k, 4, 4) tool poses in base.
        run: states of the mechanism; None if there are none.
        coordinates: names and units of the pose coordinates, for messages.
        borrowed: {symbol: named point} for each symbol to which a helper assigns an unchanged named point.
        free: name of the free parameter (swivel) of a redundant mechanism, or "". The value of this parameter in each
            state is fitted to the rows that use the parameter.
    """

    symbols: Mapping[str, Any]
    kinds: Mapping[str, Kind]
    k: int
    Ts: Array
    run: SolvedSamples | None
    coordinates: tuple[tuple[str, str], ...]
    borrowed: Mapping[str, str]
    free: str = ""

    def with_parameters(self, values: Mapping[str, Any]) -> Truth:
        """Return a copy of this object with other parameter values in SI."""
        return replace(self, symbols={**self.symbols, **values})

    def perturbed(self, seed: int = 1) -> Truth:
        """Return randomly perturbed values, which no mechanism can have, to detect rows that agree by coincidence."""
        rng = np.random.default_rng(seed)

        def shake(x: Any) -> Any:
            if isinstance(x, Matrix):
                return Matrix(x.a * (1 + 0.01 * rng.standard_normal(x.a.shape)))
            x = np.broadcast_to(np.asarray(x, float), (self.k,))
            return x * (1 + 0.01 * rng.standard_normal(self.k)) + 1e-3 * rng.standard_normal(self.k)

        return replace(self, symbols={n: shake(v) for n, v in self.symbols.items()})

    def first(self) -> Truth:
        """Return the values at the first sample only."""

        def cut(x: Any) -> Any:
            if isinstance(x, Matrix):
                return Matrix(x.a[:1])
            return x[:1] if np.ndim(x) else x

        return replace(self, symbols={n: cut(v) for n, v in self.symbols.items()}, k=1, Ts=self.Ts[:1])

    def repeated(self, samples: Sequence[int], times: int) -> Truth:
        """Return the values at some samples, repeated several times."""
        rows = np.tile(np.asarray(samples), times)

        def chosen(x: Any) -> Any:
            if isinstance(x, Matrix):
                return Matrix(np.broadcast_to(x.a, (self.k, *x.a.shape[1:]))[rows])
            return np.asarray(x)[rows] if np.ndim(x) else x

        symbols = {name: chosen(value) for name, value in self.symbols.items()}
        return replace(self, symbols=symbols, k=len(rows), Ts=self.Ts[rows], run=None)

    def pose_text(self, i: int) -> str:
        """Return the pose coordinates of sample i as text, in mm and degrees."""
        parts = []
        for name, unit in self.coordinates:
            value = float(np.broadcast_to(self.symbols[name], (self.k,))[i])
            parts.append(f"{name} {value * 1e3:.1f} mm" if unit == "m" else f"{name} {np.degrees(value):.1f}°")
        return ", ".join(parts)


def sample(
    model: ReferenceModel,
    samples: int = SAMPLES,
    seed: int = 7,
    progress: Callable[[float], None] = lambda f: None,
    regular: bool = False,
) -> SolvedSamples:
    """Return states of the mechanism around its postures (without postures: around the rest poses).

    With `regular`, postures near a singularity, where several assembly modes meet, are skipped.

    Raises:
        TwinError: the mechanism cannot be moved.
    """
    m = model.mechanism
    rng = np.random.default_rng(seed)
    ranges = np.array([(j.limits or ((-0.5, 0.5) if j.is_angle else (-0.1, 0.1))) for j in m.active])
    ranges = np.where(np.isfinite(ranges), ranges, np.sign(ranges) * np.pi)
    half = np.minimum(_SPREAD * np.ptp(ranges, axis=1), [0.3 if j.is_angle else 0.02 for j in m.active])
    starts = []
    for name in list(m.postures)[:4]:
        try:
            starts.append(model.solve(np.asarray(m.posture(name), float)))
        except AssemblyError:
            continue
    starts = starts or [model.home()]
    if regular:
        stands = conditioning(model, np.array([s.x for s in starts]), LENGTH_SCALE).stands
        starts = [s for s, value in zip(starts, stands, strict=True) if value >= _REGULAR * stands.max()]
    states: list[Array] = []
    for shrink in (1.0, 0.5, 0.2, 0.05):
        for i, start in enumerate(starts):
            wanted = (samples - len(states)) // (len(starts) - i)
            q = start.q + shrink * half * rng.uniform(-1, 1, (wanted, len(half)))
            q = np.clip(q, ranges[:, 0], ranges[:, 1])
            states += _solved(model, q, start)
            progress(len(states) / samples)
        if len(states) >= samples:
            break
    if len(states) < 6:
        raise TwinError(f"{m.name}: the mechanism hardly moves near its postures, so there are no poses for the check")
    return model.collect(np.array(states))


def _solved(model: ReferenceModel, q: Array, start: Assembly) -> list[Array]:
    """Return the reachable states at joint values q (k, n), solved together or, if that fails, one by one."""
    try:
        return list(model.solve_many(q, start).x) if len(q) else []
    except AssemblyError:
        out = []
        for one in q:
            with contextlib.suppress(AssemblyError):
                out.append(model.solve(one, start).x)
        return out


def gather(
    formula: Formula, run: SolvedSamples, model: ReferenceModel, parameters: Mapping[str, float] | None = None
) -> Truth:
    """Return the values of the formula's symbols at states of the mechanism."""
    rebuild = Rebuilder()
    k = len(run.x)
    symbols: dict[str, Any] = {p.name: float(p.value) for p in formula.parameters} | dict(parameters or {})
    kinds: dict[str, Kind] = {POSE_SYMBOL: "pose"}
    symbols[POSE_SYMBOL] = Matrix(run.Ts_base_tool)
    with np.errstate(all="ignore"):
        values = rebuild.function(formula.coordinates.from_pose)(symbols[POSE_SYMBOL])
    for name, unit, value in zip(formula.coordinates.names, formula.coordinates.units, values, strict=True):
        symbols[name], kinds[name] = value, "angle" if unit == "rad" else "length"
    order = [j.name for j in model.mechanism.active]
    for joint in formula.joints:
        symbols[joint.name] = run.q[:, order.index(joint.name)]
        kinds[joint.name] = "angle" if joint.kind == "revolute" else "length"
    angular = {j.name: j.is_angle for j in model.mechanism.joints}
    for name in formula.passive:
        if name in run.q_passive:
            symbols[name], kinds[name] = run.q_passive[name], "angle" if angular[name] else "length"
    borrowed: dict[str, str] = {}
    parts = _passed_on(formula)
    for name, symbol in formula.points.items():
        if name not in run.points:
            continue
        p = run.points[name]
        if not isinstance(symbol, str):
            for i, s in enumerate(symbol):
                symbols[s], kinds[s] = p[:, i], "length"
            continue
        symbols[symbol], kinds[symbol] = Matrix(p[:, :, None]), "length"
        for source, component in parts.get(symbol, ()):
            if source not in kinds and source not in symbols:
                symbols[source] = Matrix(p[:, :, None]) if component is None else p[:, component]
                kinds[source], borrowed[source] = "length", name
    coordinates = tuple(zip(formula.coordinates.names, formula.coordinates.units, strict=True))
    return Truth(symbols, kinds, k, run.Ts_base_tool, run, coordinates, borrowed, _free(formula, model))


def _free(formula: Formula, model: ReferenceModel) -> str:
    """Return the angle that only inverse rows use, if the mechanism is redundant; "" without exactly one such angle."""
    if not (model.redundant and formula.has("inverse") and formula.has("forward")):
        return ""
    read: dict[str, set[str]] = {"inverse": set(), "forward": set()}
    for equation in formula.equations:
        if equation.stage != "helper":
            required, optional = arguments(equation.variants[equation.default])
            read[equation.stage] |= {*required, *optional}
    names = [p.name for p in formula.parameters if p.unit in ("deg", "rad")]
    found = [n for n in names if n in read["inverse"] and n not in read["forward"]]
    return found[0] if len(found) == 1 else ""


def _passed_on(formula: Formula) -> dict[str, list[tuple[str, int | None]]]:
    """Return {output: [(argument, index or None)]} for outputs of helpers that are unchanged arguments."""
    out: dict[str, list[tuple[str, int | None]]] = {}
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
        returned = last.value
        elements = returned.elts if isinstance(returned, ast.Tuple) else [returned]
        for symbol, element in zip(equation.outputs, elements, strict=False):
            if isinstance(element, ast.Name) and element.id in source.arguments:
                out.setdefault(symbol, []).append((element.id, None))
            if isinstance(element, ast.Call) and getattr(element.func, "id", "") == "vertcat":
                names = [a.id if isinstance(a, ast.Name) else "" for a in element.args]
                if len(names) == 3 and all(n in source.arguments for n in names):
                    out.setdefault(symbol, []).extend((n, i) for i, n in enumerate(names))
    return out
