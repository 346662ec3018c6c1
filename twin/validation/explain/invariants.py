"""Check invariants of any formula: rigid bodies, constant rod lengths, closed loops, rotations, dimensions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType

import numpy as np

from twin.core.findings import Finding, Kind, disagreement
from twin.core.quantity import Quantity, mm
from twin.core.spatial import Array
from twin.core.units import MM, decimals
from twin.formula.scalar import Value
from twin.model.joint import Joint
from twin.reference import ReferenceModel
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.function_source import RETURN_NAME
from twin.validation.explain.plain_values import with_copied_values
from twin.validation.explain.rebuilt_functions import Matrix, to_array
from twin.validation.explain.reference_values import ReferenceValues
from twin.validation.explain.row_deviations import Judge, RowPlace, returned_values, worst

_LOOP_OPENS = Kind("invariant.loop", "disagreement", word="tolerance")

_LINEARITY_PROBE = 2.0
"""Value of all outputs of an implicit equation, with which it is tested that its rows are linear in them."""

_LINEARITY_ROUNDING = 1e-9
"""Absolute difference from linear rows that is rounding."""

_LARGEST_CONDITION_NUMBER = 1e12
"""Condition number above which rows do not determine the outputs of an implicit equation."""

_CONSTANT_LENGTH_FACTOR = 10
"""Change of a length that counts as none, in units of the tolerance: two points may each be off by rounding."""

_SHORTEST_ROD = 1e-6
"""Length in m: a rod that changes by more is none, and one that is shorter has no direction."""

_ORTHOGONALITY_ROUNDING = 1e-9
"""Largest entry of R^T R - I of a rotation."""

_LENGTH_FACTOR = 1.25
"""Factor of all lengths, with which the error of a dimensionally consistent row grows by the same factor."""

_LENGTH_UNITS = ("mm", "m", "cm", "um")
"""Units of parameters that are lengths."""

_LEAST_DIVISOR = 1e-300
"""Minimum divisor where an error may be zero, as that of a row that is wrong only because it has no value."""

_GROWTH_ROUNDING = 1e-6
"""Largest difference of the growth of an error from that of a length, or of an angle, relative to the error."""


def formula_values(judge: Judge) -> dict[str, Value]:
    """Return {symbol: value computed by the formula from the mechanism's values}, for the compared symbols."""
    reference = judge.reference
    values: dict[str, Value] = {}
    units = {"length": judge.tolerance.length, "angle": judge.tolerance.angle}
    for place, residual in judge.residuals.items():
        symbol = place.symbol
        kind = reference.kinds[symbol]
        if kind == "pose":
            continue
        if (
            symbol in values and worst(residual) == 0
        ):  # a row that only passes on the mechanism's value says nothing new
            continue
        value = to_array(reference.symbols[symbol], reference.k) + residual * units[kind]
        if isinstance(reference.symbols[symbol], Matrix):
            values[symbol] = Matrix(value[:, :, None])
        else:
            values[symbol] = value[:, 0]
    return values


def formula_pose(judge: Judge, place: RowPlace) -> Array:
    """Return the pose (k, 4, 4) that a row of the formula computes; it is recovered from the residual of the row."""
    scale = np.full(16, judge.tolerance.angle)
    scale[[3, 7, 11]] = judge.tolerance.length  # the entries of the position
    difference = judge.residuals[place] * scale
    return judge.reference.symbols[place.symbol].a + difference.reshape(-1, 4, 4)


def implicit_outputs(judge: Judge) -> dict[str, Value]:
    """Return the outputs of implicit equations; the coupled rows of an equation are solved together."""
    values: dict[str, Value] = {}
    for step in judge.steps:
        if step.missing or step.stage == "helper":
            continue
        names: list[str] = []
        for name in step.equation.outputs:
            if name in step.required and name in judge.reference.kinds:
                names.append(name)
        if not names:
            continue
        x = _linear_solution(judge, step.equation.name, names)
        if x is not None:
            values |= dict(zip(names, x.T, strict=True))
    return values


def _linear_solution(judge: Judge, equation: str, names: list[str]) -> Array | None:
    """Return the values (k, n) of an equation's inputs `names` that its outputs reproduce: x = A x + b.

    b are the outputs at x = 0, column j of A the difference at the unit vector j. None if the outputs are not linear in
    these inputs, or do not determine them.
    """
    count = len(names)
    outputs_at_zero = _outputs_at(judge, equation, names, [0.0] * count)
    outputs_at_other = _outputs_at(judge, equation, names, [_LINEARITY_PROBE] * count)
    if outputs_at_zero is None or outputs_at_other is None:
        return None
    columns: list[Array] = []
    for unit in np.eye(count).tolist():
        outputs_at_unit = _outputs_at(judge, equation, names, unit)
        if outputs_at_unit is None:
            return None
        columns.append(outputs_at_unit - outputs_at_zero)
    A = np.stack(columns, axis=2)
    predicted = A.sum(axis=2) * _LINEARITY_PROBE + outputs_at_zero
    is_linear = np.allclose(predicted, outputs_at_other, atol=_LINEARITY_ROUNDING)
    if not is_linear or not np.isfinite(A).all():
        return None
    M = np.eye(count) - A
    if not np.linalg.cond(M).max() < _LARGEST_CONDITION_NUMBER:
        return None
    x = np.linalg.solve(M, outputs_at_zero[..., None])
    return np.asarray(x[..., 0], np.float64)


def _outputs_at(judge: Judge, equation: str, names: list[str], x: list[float]) -> Array | None:
    """Return the outputs `names` (k, n) of an equation for the values x of its inputs with the same names."""
    values = outputs(judge, equation, dict(zip(names, x, strict=True)))
    if not values:
        return None
    columns: list[Array] = []
    for name in names:
        entries = to_array(values[name], judge.reference.k)
        columns.append(entries[:, 0])
    return np.stack(columns, axis=1)


def invariants(judge: Judge, model: ReferenceModel) -> list[Finding]:
    """Return findings on violated invariants; none if the formula agrees."""
    values = {**formula_values(judge), **implicit_outputs(judge)}
    violated = [
        *_wrong_distances(judge, model, values),
        *_wrong_rods(judge, model, values),
        *_open_loops(judge, model, values),
    ]
    return [*violated, *_wrong_rotations(judge), *_wrong_dimensions(judge)]


def _symbols_of_point(judge: Judge, point: str) -> tuple[str, ...]:
    """Return the symbols of a named point: one vector, or its coordinates."""
    symbol = judge.formula.points[point]
    if isinstance(symbol, str):
        return (symbol,)
    return tuple(symbol)


def _point_positions(judge: Judge, values: Mapping[str, Value]) -> dict[str, Array]:
    """Return the positions (k, 3) of the named points that have values."""
    positions: dict[str, Array] = {}
    for name in judge.formula.points:
        parts = _symbols_of_point(judge, name)
        if values.keys() >= set(parts):
            coordinates: list[Array] = []
            for part in parts:
                coordinates.append(to_array(values[part], judge.reference.k))
            positions[name] = np.hstack(coordinates)
    return positions


def _wrong_distances(judge: Judge, model: ReferenceModel, values: Mapping[str, Value]) -> Iterator[Finding]:
    """Yield a finding for each distance between points of one body that the formula makes different from the CAD."""
    positions = _point_positions(judge, values)
    failing = {place.symbol for place in judge.failing()}
    wrong: set[str] = set()
    for name in positions:
        if not failing.isdisjoint(_symbols_of_point(judge, name)):
            wrong.add(name)
    points_of: dict[str, list[str]] = {}
    p_body: dict[str, Array] = {}
    for point in model.mechanism.points:
        p_body[point.name] = point.p_body
        if point.name in positions:
            points_of.setdefault(point.body, []).append(point.name)
    for body, names in points_of.items():
        for a, b in combinations(names, 2):
            if a not in wrong and b not in wrong:
                continue
            true = float(np.linalg.norm(p_body[a] - p_body[b]))
            length = np.linalg.norm(positions[a] - positions[b], axis=1)
            name = f"{a}-{b}"
            yield from _wrong_length(judge, length, true, name, "invariant.rigid", f"the formula makes {name}", body)


def _wrong_length(
    judge: Judge, length: Array, true: float, name: str, code: str, what: str, body: str = ""
) -> Iterator[Finding]:
    """Yield a finding if one of the lengths (k,) in m differs from the true one; `body`: on which it is measured."""
    error = np.abs(length - true)
    if not np.isfinite(error).any():
        return
    largest = float(np.nanmax(error))
    if largest <= judge.tolerance.length:
        return
    digits = decimals(largest / MM)
    shortest = float(np.nanmin(length))
    longest = float(np.nanmax(length))
    low = f"{shortest / MM:.{digits}f}"
    high = f"{longest / MM:.{digits}f}"
    where = f"on '{body}' " if body else ""
    in_cad = f"{where}in the CAD it is {true / MM:.{digits}f} mm"
    if longest - shortest <= _CONSTANT_LENGTH_FACTOR * judge.tolerance.length:
        text = f"{what} {low} mm long; {in_cad}"
    else:
        text = f"{what} {low} .. {high} mm long; {in_cad}: a rigid body cannot change its length"
    yield disagreement(
        code,
        name,
        text,
        mm(largest),
        mm(judge.tolerance.length),
        when=judge.reference.pose_text(int(np.nanargmax(error))),
        word="",
    )


def _wrong_rods(judge: Judge, model: ReferenceModel, values: Mapping[str, Value]) -> Iterator[Finding]:
    """Yield a finding for each link whose length would change if the joints had the formula's values."""
    reference = judge.reference
    mechanism = model.mechanism
    wrong: set[str] = set()
    for joint in mechanism.active:
        if joint.name in values and _differs_from_mechanism(judge, joint.name, values[joint.name]):
            wrong.add(joint.name)
    if reference.run is None or not wrong:
        return
    wrong_values = {name: values[name] for name in wrong}
    moved_poses = model.link_poses(_with_values(reference.run.x, model, wrong_values))
    real_poses = model.link_poses(reference.run.x)
    drive_of: dict[str, str] = {}  # by the body that the joint moves
    for joint in mechanism.tree:
        if joint.name in wrong:
            drive_of[joint.child] = joint.name
    for link in mechanism.bodies:
        joints: list[Joint] = []
        driven: list[Joint] = []
        for joint in mechanism.joints:
            if link.name not in (joint.parent, joint.child):
                continue
            joints.append(joint)
            if _other_body(joint, link.name) in drive_of:
                driven.append(joint)
        for joint in driven:
            if joint.type == "prismatic":  # its centre has no place of its own on the link
                continue
            driving_body = _other_body(joint, link.name)
            drive = drive_of[driving_body]
            pivot = _centre(joint, driving_body, moved_poses)
            real_pivot = _centre(joint, link.name, real_poses)
            for opposite_joint in joints:
                if opposite_joint in driven:
                    continue
                real_end = _centre(opposite_joint, link.name, real_poses)
                real_length = np.linalg.norm(real_pivot - real_end, axis=1)
                true = float(np.linalg.norm(real_pivot[0] - real_end[0]))
                if true < _SHORTEST_ROD or np.ptp(real_length) > _SHORTEST_ROD:
                    continue
                length = np.linalg.norm(pivot - real_end, axis=1)
                ends = f"from {joint.name} to {opposite_joint.name}"
                what = f"with {drive} from the formula, '{link.name}' would be, {ends},"
                yield from _wrong_length(judge, length, true, link.name, "invariant.rod", what)


def _with_values(x: Array, model: ReferenceModel, values: Mapping[str, Value]) -> Array:
    """Return states x (k, n) in which some joints have other values (k,)."""
    states = x.copy()
    for name, value in values.items():
        states[:, model.tree.configuration[name]] = value
    return states


def _differs_from_mechanism(judge: Judge, name: str, value: Value) -> bool:
    """Return whether the formula's value of a joint differs from the value of this joint in the mechanism."""
    return worst(judge.difference(name, value)) > 1


def _other_body(joint: Joint, body: str) -> str:
    """Return the body that a joint connects with a body."""
    if joint.child == body:
        return joint.parent
    return joint.child


def _centre(joint: Joint, body: str, poses: Mapping[str, Array]) -> Array:
    """Return the positions (k, 3) of a joint on one of its two bodies."""
    T_body_joint = joint.T_child_joint
    if joint.parent == body:
        T_body_joint = joint.T_parent_joint
    T_world_joint = poses[body] @ T_body_joint
    return T_world_joint[:, :3, 3]


def _open_loops(judge: Judge, model: ReferenceModel, values: Mapping[str, Value]) -> Iterator[Finding]:
    """Yield a finding for each loop that opens if wrong joint values of the formula replace those of the mechanism."""
    run = judge.reference.run
    wrong: dict[str, Value] = {}
    for name in model.tree.configuration:
        if name in values and _differs_from_mechanism(judge, name, values[name]):
            wrong[name] = values[name]
    if run is None or not wrong or not model.mechanism.loops:
        return
    states = _with_values(run.x, model, wrong)
    if not np.isfinite(states).all():
        return
    # Loops that are not quite closed in the mechanism itself do not count as opened.
    limit = max(judge.tolerance.length, 10 * float(run.gaps[..., 0].max(initial=0.0)))
    gaps = model.collect(states).gaps[..., 0]
    for loop, gap in zip(run.loop_names, gaps.T, strict=True):
        widest = int(np.argmax(gap))
        if gap[widest] > limit:
            yield _LOOP_OPENS(
                loop,
                f"with {', '.join(wrong)} from the formula, the loop at {loop} opens",
                mm(gap[widest]),
                mm(judge.tolerance.length),
                when=judge.reference.pose_text(widest),
            )


def _wrong_rotations(judge: Judge) -> Iterator[Finding]:
    """Yield a finding for each computed pose whose rotation matrix is left-handed or not orthogonal."""
    for step in judge.steps:
        for name, value in outputs(judge, step.equation.name).items():
            if not isinstance(value, Matrix) or value.shape not in ((3, 3), (4, 4)):
                continue
            R = value.a[:, :3, :3]
            if not np.isfinite(R).all():
                continue
            difference = np.swapaxes(R, 1, 2) @ R - np.eye(3)
            deviation = float(np.abs(difference).max())
            if deviation > _ORTHOGONALITY_ROUNDING:
                what = f"not orthogonal (R^T R - I is {deviation:.2g})"
            elif np.linalg.det(R).min() < 0:
                what = "left-handed (its determinant is -1)"
            else:
                continue
            where = f"{step.equation.name}.{name}"
            text = f"rotation {name} of {step.equation.name} is {what}"
            yield disagreement("invariant.rotation", where, text, Quantity(deviation), _ORTHOGONALITY_ROUNDING, word="")


def outputs(judge: Judge, equation: str, other_values: Mapping[str, Value] = MappingProxyType({})) -> dict[str, Value]:
    """Evaluate an equation; return its outputs by their names, or an empty dictionary after an error.

    The outputs are not compared with the mechanism. `other_values` replace inputs of the equation, by name.
    """
    step = judge.step(equation)
    if step.missing or not step.before:
        return {}
    scope = {**with_copied_values(step.before[0]), **other_values}
    try:
        with np.errstate(all="ignore"):
            for code in step.codes:
                exec(code, scope)
    except Exception:
        return {}
    values = returned_values(step, scope[RETURN_NAME])
    return dict(zip(step.equation.outputs, values, strict=step.plain_function is not None))


def _wrong_dimensions(judge: Judge) -> Iterator[Finding]:
    """Yield a finding for each wrong row that is dimensionally inconsistent: its error does not scale with lengths."""
    failing = judge.failing()
    if not failing:
        return
    residuals: dict[RowKey, Array] = {}
    for place, residual in judge.on(_scaled(judge)).residuals.items():
        residuals.setdefault(place.key, residual)
    for place in failing:
        kind = judge.reference.kinds[place.symbol]
        if place.key not in residuals or kind == "pose":
            continue
        before = judge.residuals[place]
        after = residuals[place.key]
        if not (np.isfinite(before).all() and np.isfinite(after).all()):
            continue
        factor = 1.0
        unit = "an angle"
        if kind == "length":
            factor = _LENGTH_FACTOR
            unit = "a length"
        difference = float(np.abs(after - factor * before).max())
        size = max(float(np.abs(before).max()), _LEAST_DIVISOR)
        if difference / size > _GROWTH_ROUNDING:
            yield disagreement(
                "invariant.dimension",
                f"{place.name}, line {place.line}",
                f"the row of {place.symbol} in {place.equation} ({place.variant}) is dimensionally inconsistent; "
                f"{unit} is expected",
                suggestion="look for a missing square, root or parenthesis",
            )


def _scaled(judge: Judge) -> ReferenceValues:
    """Return the values of a mechanism that is larger in all its lengths."""
    reference = judge.reference
    symbols = dict(reference.symbols)
    lengths: set[str] = set()
    for parameter in judge.formula.parameters:
        if parameter.unit in _LENGTH_UNITS:
            lengths.add(parameter.name)
    for name, value in symbols.items():
        kind = reference.kinds.get(name)
        if kind == "pose":
            T = value.a.copy()
            T[:, :3, 3] *= _LENGTH_FACTOR
            symbols[name] = Matrix(T)
        elif kind == "length" or name in lengths:
            symbols[name] = value * _LENGTH_FACTOR
    return replace(reference, symbols=symbols)
