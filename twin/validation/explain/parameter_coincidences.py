"""Vary parameters that are equal or assumed, and check that inverse and forward equations still belong together.

The mechanism has one value of each parameter. Equations that are right only for this value, such as for two equal
lengths or a redundancy angle of zero, agree with it at every pose. Their errors show if forward and inverse equations
are evaluated one after the other with other values: forward, inverse, and forward again must give the same pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL, Formula
from twin.validation.explain.rebuilt_functions import Matrix, Rebuilder
from twin.validation.explain.reference_values import ReferenceValues
from twin.validation.explain.row_deviations import Judge

_SAME = 1e-9
"""Relative difference up to which two parameters are equal."""

_CLOSED = 1e-7
"""Largest difference of two equal poses, in m or as an entry of a rotation."""

_STEP, _NEWTON = 1e-6, 5
"""Relative difference for derivatives, and number of steps, with which derived parameters are fitted."""

_LENGTH = 0.3
"""Length in m by parts of which a length of zero is changed."""

_NEARER = 1e-3
"""Part of the usual change, with which right equations have values at the same poses as before."""

_ANGLES = ("deg", "rad")


def groups(formula: Formula) -> list[tuple[Parameter, ...]]:
    """Return the groups of equal parameters, and each assumed parameter; without values derived from others."""
    stated = [parameter for parameter in formula.parameters if parameter.provenance != "DERIVED"]
    found_groups: list[tuple[Parameter, ...]] = []
    for i, parameter in enumerate(stated):
        if not parameter.value:
            continue
        equal = [other for other in stated[i:] if _is_equal(parameter, other)]
        is_part = any(set(equal) <= set(group) for group in found_groups)
        if len(equal) > 1 and not is_part:
            found_groups.append(tuple(equal))
    for parameter in stated:
        if parameter.provenance == "ASSUMED":
            found_groups.append((parameter,))
    return found_groups


def _is_equal(parameter: Parameter, other: Parameter) -> bool:
    difference = abs(other.value - parameter.value)
    return other.unit == parameter.unit and difference <= _SAME * abs(parameter.value)


def condition(group: Sequence[Parameter]) -> str:
    """Return the condition on a group of `groups` under which equations belong together: "because a = b"."""
    if len(group) > 1:
        return f"because {' = '.join(p.name for p in group)}"
    (p,) = group
    return f"for {p.name} = {p.shown:g} {p.unit}"


def changed(parameters: Sequence[Parameter], values: Mapping[str, float], part: float = 1.0) -> dict[str, float]:
    """Return other values in SI of the given parameters, each changed by `part` of another amount."""
    out = {}
    for i, p in enumerate(parameters):
        amount = part * (0.03 + 0.017 * i)
        value = values[p.name]
        if p.unit in _ANGLES:
            out[p.name] = value + 4 * amount
        elif value == 0:
            out[p.name] = amount * _LENGTH
        else:
            out[p.name] = value * (1 + amount)
    return out


def closes(judge: Judge, values: Mapping[str, float]) -> bool | None:
    """Return whether forward, inverse and forward equations give one pose; None if they cannot be evaluated.

    Args:
        judge: gives the equations, and the joint values at which they are evaluated.
        values: parameters in SI that differ from those of `judge`.
    """
    differences = _differences(judge, values)
    if differences is None:
        return None
    known = np.isfinite(differences).all(axis=1)
    if np.mean(known) < 0.5:
        return None
    return bool(np.abs(differences[known]).max() <= _CLOSED)


def coincidences(judge: Judge) -> list[tuple[Parameter, ...]]:
    """Return the groups of parameters only for whose values inverse and forward equations belong together."""
    values = _values(judge)
    if closes(judge, {}) is not True:
        return []
    derived = [p.name for p in judge.formula.parameters if p.provenance == "DERIVED"]
    coinciding = []
    for group in groups(judge.formula):
        other = changed(group, values)
        closed = closes(judge, other)
        if closed is None:  # most poses may be out of reach with these values, but not with values that are near
            other = changed(group, values, _NEARER)
            closed = closes(judge, other)
        # An inverse that has no values near those of the mechanism does not belong to the forward equations there.
        if not closed and not (derived and _closes_with(judge, other, derived)):
            coinciding.append(group)
    return coinciding


def _closes_with(judge: Judge, values: Mapping[str, float], derived: Sequence[str]) -> bool:
    """Return whether the equations give one pose with other values of derived parameters.

    A parameter that is derived from a varied one has another value as well, but no formula is known for it.
    """
    before = _values(judge)
    tried = np.array([before[name] for name in derived])
    steps = np.maximum(np.abs(tried), 1e-3) * _STEP
    for _ in range(_NEWTON):
        given = dict(values) | dict(zip(derived, tried, strict=True))
        differences = _differences(judge, given)
        if differences is None:
            return False
        slopes = []
        for i, name in enumerate(derived):
            moved = _differences(judge, given | {name: tried[i] + steps[i]})
            if moved is None:
                return False
            slopes.append(((moved - differences) / steps[i]).ravel())
        J = np.stack(slopes, axis=1)
        known = np.isfinite(J).all(axis=1) & np.isfinite(differences.ravel())
        if not known.any():
            return False
        tried = tried - np.linalg.lstsq(J[known], differences.ravel()[known], rcond=None)[0]
        if closes(judge, dict(values) | dict(zip(derived, tried, strict=True))):
            return True
    return False


def _values(judge: Judge) -> dict[str, float]:
    """Return the parameters in SI with which the equations are judged."""
    values = {}
    for p in judge.formula.parameters:
        values[p.name] = float(np.asarray(judge.reference.symbols[p.name]))
    return values


def _differences(judge: Judge, values: Mapping[str, float]) -> Array | None:
    """Return the second pose minus the first of forward, inverse and forward equations, (k, 16)."""
    formula = judge.formula
    if not (formula.has("forward") and formula.has("inverse")):
        return None
    reference = judge.reference
    parameters = _values(judge) | dict(values)
    joints = {j.name: reference.symbols[j.name] for j in formula.joints if j.name in reference.symbols}
    with np.errstate(all="ignore"):
        pose = _pose(judge, {**parameters, **joints})
        if pose is None or not np.isfinite(pose).any():
            return None
        coordinates = Rebuilder().function(formula.coordinates.from_pose)(Matrix(pose))
        symbols = {**parameters, POSE_SYMBOL: Matrix(pose)}
        symbols |= dict(zip(formula.coordinates.names, coordinates, strict=True))
        given = _outputs(judge, symbols, "inverse")
        if any(name not in given for name in joints):
            return None
        again = _pose(judge, {**parameters, **{name: given[name] for name in joints}})
    if again is None or again.shape != pose.shape:
        return None
    return (again - pose).reshape(len(pose), -1)


def _pose(judge: Judge, symbols: dict[str, object]) -> Array | None:
    """Return the poses (k, 4, 4) of the forward equations for values of symbols; None without poses."""
    pose = _outputs(judge, symbols, "forward").get(POSE_SYMBOL)
    if not isinstance(pose, Matrix) or pose.shape != (4, 4):
        return None
    return np.broadcast_to(pose.a, (judge.reference.k, 4, 4))


def _outputs(judge: Judge, symbols: dict[str, object], stage: str) -> dict[str, object]:
    """Return the outputs of the equations of one stage."""
    reference = ReferenceValues(
        symbols, {}, judge.reference.k, judge.reference.Ts, None, judge.reference.coordinates, {}
    )
    only = [step.equation.name for step in judge.steps if step.stage == stage]
    run = judge.on(reference, only)
    outputs: dict[str, object] = {}
    for step in run.steps:
        if not step.missing:
            outputs.update(step.gave)
    return outputs
