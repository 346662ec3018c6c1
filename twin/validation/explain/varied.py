"""Vary parameters that are equal or assumed, and check that inverse and forward equations still belong together.

The mechanism has one value of each parameter. Equations that are right only for this value, such as for two equal
lengths or a redundancy angle of zero, agree with it at every pose. Their errors show if forward and inverse equations
are evaluated one after the other with other values: forward, inverse, and forward again must give the same pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core.errors import TwinError
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL, Formula
from twin.validation.explain.judge import Judge
from twin.validation.explain.numeric import Matrix, Rebuilder
from twin.validation.explain.truth import Truth

_SAME = 1e-9
"""Relative difference up to which two parameters are equal."""

_CLOSED = 1e-7
"""Largest difference of two equal poses, in m or as an entry of a rotation."""

_ANGLES = ("deg", "rad")


def groups(formula: Formula) -> list[tuple[Parameter, ...]]:
    """Return the groups of equal parameters, and each assumed parameter; without values derived from others."""
    own = [p for p in formula.parameters if p.provenance != "DERIVED"]
    out: list[tuple[Parameter, ...]] = []
    for i, p in enumerate(own):
        alike = tuple(o for o in own[i:] if o.unit == p.unit and abs(o.value - p.value) <= _SAME * abs(p.value))
        if len(alike) > 1 and p.value and not any(set(alike) <= set(g) for g in out):
            out.append(alike)
    return [*out, *((p,) for p in own if p.provenance == "ASSUMED")]


def changed(parameters: Sequence[Parameter], values: Mapping[str, float]) -> dict[str, float]:
    """Return other values in SI of the given parameters, each changed by another amount."""
    out = {}
    for i, p in enumerate(parameters):
        amount = 0.03 + 0.017 * i
        value = values[p.name]
        out[p.name] = value + 4 * amount if p.unit in _ANGLES else value * (1 + amount)
    return out


def closes(judge: Judge, formula: Formula, values: Mapping[str, float]) -> bool | None:
    """Return whether forward, inverse and forward equations give one pose; None if they cannot be evaluated.

    Args:
        judge: gives the joint values at which the equations are evaluated, and the variants.
        formula: the equations.
        values: parameters in SI that differ from those of `judge`.
    """
    if not (formula.has("forward") and formula.has("inverse")):
        return None
    truth = judge.truth
    parameters = {p.name: float(np.asarray(truth.symbols[p.name])) for p in formula.parameters} | dict(values)
    joints = {j.name: truth.symbols[j.name] for j in formula.joints if j.name in truth.symbols}
    with np.errstate(all="ignore"):
        pose = _pose(judge, formula, {**parameters, **joints})
        if pose is None or not np.isfinite(pose).any():
            return None
        coordinates = Rebuilder().function(formula.coordinates.from_pose)(Matrix(pose))
        symbols = {**parameters, POSE_SYMBOL: Matrix(pose)}
        symbols |= dict(zip(formula.coordinates.names, coordinates, strict=True))
        given = _outputs(judge, formula, symbols, "inverse")
        if any(name not in given for name in joints):
            return None
        again = _pose(judge, formula, {**parameters, **{name: given[name] for name in joints}})
    if again is None or again.shape != pose.shape:
        return None
    known = np.isfinite(pose).all(axis=(1, 2)) & np.isfinite(again).all(axis=(1, 2))
    if np.mean(known) < 0.5:
        return None
    off = np.abs(again - pose)[known]
    return bool(off.max() <= _CLOSED)


def coincidences(judge: Judge) -> list[tuple[Parameter, ...]]:
    """Return the groups of parameters only for whose values inverse and forward equations belong together."""
    values = {p.name: float(np.asarray(judge.truth.symbols[p.name])) for p in judge.formula.parameters}
    if closes(judge, judge.formula, {}) is not True:
        return []
    return [g for g in groups(judge.formula) if closes(judge, judge.formula, changed(g, values)) is False]


def _pose(judge: Judge, formula: Formula, symbols: dict[str, object]) -> Array | None:
    """Return the poses (k, 4, 4) of the forward equations for values of symbols; None without poses."""
    pose = _outputs(judge, formula, symbols, "forward").get(POSE_SYMBOL)
    k = judge.truth.k
    return np.broadcast_to(pose.a, (k, 4, 4)) if isinstance(pose, Matrix) and pose.shape == (4, 4) else None


def _outputs(judge: Judge, formula: Formula, symbols: dict[str, object], stage: str) -> dict[str, object]:
    """Return the outputs of the equations of one stage."""
    truth = Truth(symbols, {}, judge.truth.k, judge.truth.Ts, None, judge.truth.coordinates, {})
    try:
        run = Judge(formula, judge.variants, truth, judge.tolerance)
    except TwinError:
        return {}
    out: dict[str, object] = {}
    for step in run.steps:
        if step.stage == stage and not step.missing:
            out.update(step.gave)
    return out
