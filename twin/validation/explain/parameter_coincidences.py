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
from twin.formula.scalar import Value
from twin.validation.explain.rebuilt_functions import Matrix, Rebuilder
from twin.validation.explain.reference_values import ReferenceValues
from twin.validation.explain.row_deviations import Judge

_SAME_VALUE = 1e-9
"""Relative difference up to which two parameters are equal."""

_SAME_POSE = 1e-7
"""Largest difference of two equal poses, in m or as an entry of a rotation."""

_DERIVATIVE_STEP = 1e-6
"""Relative difference for derivatives with respect to derived parameters."""

_SMALLEST_SCALE = 1e-3
"""Smallest size in m or rad of a derived parameter, for that difference."""

_MOST_NEWTON_STEPS = 5
"""Number of steps with which derived parameters are fitted."""

_FIRST_CHANGE = 0.03
"""Relative change of the first parameter of a group."""

_FURTHER_CHANGE = 0.017
"""How much more each further parameter of a group is changed than the one before, so that they are no longer equal."""

_ANGLE_CHANGE_FACTOR = 4
"""Factor of these changes for angles, in rad."""

_LEAST_SHARE_OF_POSES = 0.5
"""Part of the poses at which equations must have values with other parameters."""

_LENGTH_FOR_ZERO = 0.3
"""Length in m by parts of which a length of zero is changed."""

_NEAR_CHANGE_FACTOR = 1e-3
"""Part of the usual change, with which right equations have values at the same poses as before."""

_ANGLE_UNITS = ("deg", "rad")


def parameter_groups(formula: Formula) -> list[tuple[Parameter, ...]]:
    """Return the groups of equal parameters, and each assumed parameter; without values derived from others."""
    stated = [parameter for parameter in formula.parameters if parameter.provenance != "DERIVED"]
    all_groups: list[tuple[Parameter, ...]] = []
    for i, parameter in enumerate(stated):
        if not parameter.value:  # many parameters are zero for reasons of their own
            continue
        equal: list[Parameter] = []
        for candidate in stated[i:]:
            if _is_equal(parameter, candidate):
                equal.append(candidate)
        is_part = False
        for group in all_groups:
            is_part |= set(equal) <= set(group)
        if len(equal) > 1 and not is_part:
            all_groups.append(tuple(equal))
    for parameter in stated:
        if parameter.provenance == "ASSUMED":
            all_groups.append((parameter,))
    return all_groups


def _is_equal(parameter: Parameter, candidate: Parameter) -> bool:
    difference = abs(candidate.value - parameter.value)
    return candidate.unit == parameter.unit and difference <= _SAME_VALUE * abs(parameter.value)


def condition(group: Sequence[Parameter]) -> str:
    """Return the condition on a group of `parameter_groups` under which equations belong together: "because a = b"."""
    if len(group) > 1:
        names = [parameter.name for parameter in group]
        return f"because {' = '.join(names)}"
    (parameter,) = group
    return f"for {parameter.name} = {parameter.shown:g} {parameter.unit}"


def changed_values(parameters: Sequence[Parameter], values: Mapping[str, float], part: float = 1.0) -> dict[str, float]:
    """Return other values in SI of the given parameters, each changed by `part` of another amount."""
    other_values: dict[str, float] = {}
    for i, parameter in enumerate(parameters):
        name = parameter.name
        amount = part * (_FIRST_CHANGE + _FURTHER_CHANGE * i)
        value = values[name]
        if parameter.unit in _ANGLE_UNITS:
            other_values[name] = value + _ANGLE_CHANGE_FACTOR * amount
        elif value == 0:
            other_values[name] = amount * _LENGTH_FOR_ZERO
        else:
            other_values[name] = value * (1 + amount)
    return other_values


def returns_to_pose(judge: Judge, values: Mapping[str, float]) -> bool | None:
    """Return whether forward, inverse and forward equations give one pose; None if they cannot be evaluated.

    Args:
        judge: gives the equations, and the joint values at which they are evaluated.
        values: parameters in SI that differ from those of `judge`.
    """
    differences = _pose_differences(judge, values)
    if differences is None:
        return None
    has_value = np.isfinite(differences).all(axis=1)
    if np.mean(has_value) < _LEAST_SHARE_OF_POSES:
        return None
    return bool(np.abs(differences[has_value]).max() <= _SAME_POSE)


def coincidences(judge: Judge) -> list[tuple[Parameter, ...]]:
    """Return the groups of parameters only for whose values inverse and forward equations belong together."""
    values = _judged_values(judge)
    if returns_to_pose(judge, {}) is not True:
        return []
    derived: list[str] = []
    for parameter in judge.formula.parameters:
        if parameter.provenance == "DERIVED":
            derived.append(parameter.name)
    coinciding: list[tuple[Parameter, ...]] = []
    for group in parameter_groups(judge.formula):
        other_values = changed_values(group, values)
        closed = returns_to_pose(judge, other_values)
        if closed is None:  # most poses may be out of reach with these values, but not with values that are near
            other_values = changed_values(group, values, _NEAR_CHANGE_FACTOR)
            closed = returns_to_pose(judge, other_values)
        if closed:
            continue
        # An inverse that has no values near those of the mechanism does not belong to the forward equations there.
        if not derived or not _returns_with_derived(judge, other_values, derived):
            coinciding.append(group)
    return coinciding


def _returns_with_derived(judge: Judge, values: Mapping[str, float], derived: Sequence[str]) -> bool:
    """Return whether the equations give one pose with other values of derived parameters.

    A parameter that is derived from a varied one has another value as well, but no formula is known for it.
    """
    present_values = _judged_values(judge)
    start = [present_values[name] for name in derived]
    x = np.array(start)
    steps = np.maximum(np.abs(x), _SMALLEST_SCALE) * _DERIVATIVE_STEP
    for _ in range(_MOST_NEWTON_STEPS):
        parameters = {**values, **dict(zip(derived, x, strict=True))}
        differences = _pose_differences(judge, parameters)
        if differences is None:
            return False
        slopes: list[Array] = []
        for i, name in enumerate(derived):
            differences_ahead = _pose_differences(judge, {**parameters, name: x[i] + steps[i]})
            if differences_ahead is None:
                return False
            slope = (differences_ahead - differences) / steps[i]
            slopes.append(slope.ravel())
        J = np.stack(slopes, axis=1)
        r = differences.ravel()
        has_value = np.isfinite(J).all(axis=1) & np.isfinite(r)
        if not has_value.any():
            return False
        step, *_ = np.linalg.lstsq(J[has_value], r[has_value], rcond=None)
        x = x - step
        if returns_to_pose(judge, {**values, **dict(zip(derived, x, strict=True))}):
            return True
    return False


def _judged_values(judge: Judge) -> dict[str, float]:
    """Return the parameters in SI with which the equations are judged."""
    values: dict[str, float] = {}
    for parameter in judge.formula.parameters:
        values[parameter.name] = float(np.asarray(judge.reference.symbols[parameter.name]))
    return values


def _pose_differences(judge: Judge, values: Mapping[str, float]) -> Array | None:
    """Return the second pose minus the first of forward, inverse and forward equations, (k, 16)."""
    formula = judge.formula
    if not (formula.has("forward") and formula.has("inverse")):
        return None
    reference = judge.reference
    parameters = _judged_values(judge) | dict(values)
    joints: dict[str, Value] = {}
    for joint in formula.joints:
        if joint.name in reference.symbols:
            joints[joint.name] = reference.symbols[joint.name]
    with np.errstate(all="ignore"):
        pose = _forward_poses(judge, {**parameters, **joints})
        if pose is None or not np.isfinite(pose).any():
            return None
        coordinates = Rebuilder().function(formula.coordinates.from_pose)(Matrix(pose))
        symbols = {**parameters, POSE_SYMBOL: Matrix(pose)}
        symbols |= dict(zip(formula.coordinates.names, coordinates, strict=True))
        inverse = _stage_outputs(judge, symbols, "inverse")
        if not inverse.keys() >= joints.keys():
            return None
        joints_of_inverse = {name: inverse[name] for name in joints}
        second_pose = _forward_poses(judge, {**parameters, **joints_of_inverse})
    if second_pose is None or second_pose.shape != pose.shape:
        return None
    return (second_pose - pose).reshape(len(pose), -1)


def _forward_poses(judge: Judge, symbols: dict[str, object]) -> Array | None:
    """Return the poses (k, 4, 4) of the forward equations for values of symbols; None without poses."""
    pose = _stage_outputs(judge, symbols, "forward").get(POSE_SYMBOL)
    if not isinstance(pose, Matrix) or pose.shape != (4, 4):
        return None
    return np.broadcast_to(pose.a, (judge.reference.k, 4, 4))


def _stage_outputs(judge: Judge, symbols: dict[str, object], stage: str) -> dict[str, object]:
    """Return the outputs of the equations of one stage."""
    reference = ReferenceValues(
        symbols, {}, judge.reference.k, judge.reference.Ts, None, judge.reference.coordinates, {}
    )
    equations: list[str] = []
    for step in judge.steps:
        if step.stage == stage:
            equations.append(step.equation.name)
    judge_of_stage = judge.on(reference, equations)
    outputs: dict[str, object] = {}
    for step in judge_of_stage.steps:
        if not step.missing:
            outputs.update(step.output_values)
    return outputs
