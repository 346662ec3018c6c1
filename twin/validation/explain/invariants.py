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
from twin.validation.explain.function_source import OUT
from twin.validation.explain.plain_values import copied
from twin.validation.explain.rebuilt_functions import Matrix, to_array
from twin.validation.explain.reference_values import ReferenceValues
from twin.validation.explain.row_deviations import Judge, RowPlace, returned_values, worst

_LOOP = Kind("invariant.loop", "disagreement", word="tolerance")


def formula_values(judge: Judge) -> dict[str, Value]:
    """Return {symbol: value computed by the formula from the mechanism's values}, for the compared symbols."""
    reference = judge.reference
    values: dict[str, Value] = {}
    units = {"length": judge.tolerance.length, "angle": judge.tolerance.angle}
    for place, r in judge.residuals.items():
        symbol = place.symbol
        kind = reference.kinds[symbol]
        if kind == "pose":
            continue
        if symbol in values and worst(r) == 0:  # a row that only passes on the mechanism's value says nothing new
            continue
        value = to_array(reference.symbols[symbol], reference.k) + r * units[kind]
        if isinstance(reference.symbols[symbol], Matrix):
            values[symbol] = Matrix(value[:, :, None])
        else:
            values[symbol] = value[:, 0]
    return values


def formula_pose(judge: Judge, place: RowPlace) -> Array:
    """Return the pose (k, 4, 4) that a row of the formula computes; it is recovered from the residual of the row."""
    scale = np.full(16, judge.tolerance.angle)
    scale[[3, 7, 11]] = judge.tolerance.length
    return judge.reference.symbols[place.symbol].a + (judge.residuals[place] * scale).reshape(-1, 4, 4)


def solved(judge: Judge) -> dict[str, Value]:
    """Return the outputs of implicit equations; the coupled rows of an equation are solved together."""
    values: dict[str, Value] = {}
    for step in judge.steps:
        names = [n for n in step.equation.outputs if n in step.required and n in judge.reference.kinds]
        if not names or step.missing or step.stage == "helper":
            continue
        x = _solution(judge, step.equation.name, names)
        if x is not None:
            values |= dict(zip(names, x.T, strict=True))
    return values


def _solution(judge: Judge, equation: str, names: list[str]) -> Array | None:
    """Return the values (k, n) of an equation's inputs `names` that its outputs reproduce: x = A x + b.

    None if the outputs are not linear in these inputs, or do not determine them.
    """
    n = len(names)
    b = _outputs_at(judge, equation, names, [0.0] * n)
    tested = _outputs_at(judge, equation, names, [2.0] * n)
    if b is None or tested is None:
        return None
    columns: list[Array] = []
    for unit in np.eye(n).tolist():
        moved = _outputs_at(judge, equation, names, unit)
        if moved is None:
            return None
        columns.append(moved - b)
    A = np.stack(columns, axis=2)
    if not np.allclose(A.sum(axis=2) * 2 + b, tested, atol=1e-9) or not np.isfinite(A).all():
        return None  # the rows are not linear in the outputs
    M = np.eye(n) - A
    if not np.linalg.cond(M).max() < 1e12:
        return None
    return np.asarray(np.linalg.solve(M, b[..., None])[..., 0], np.float64)


def _outputs_at(judge: Judge, equation: str, names: list[str], x: list[float]) -> Array | None:
    """Return the outputs `names` (k, n) of an equation for the values x of its inputs with the same names."""
    values = outputs(judge, equation, dict(zip(names, x, strict=True)))
    if not values:
        return None
    return np.stack([to_array(values[name], judge.reference.k)[:, 0] for name in names], axis=1)


def invariants(judge: Judge, model: ReferenceModel) -> list[Finding]:
    """Return findings on violated invariants; none if the formula agrees."""
    values = {**formula_values(judge), **solved(judge)}
    violated = [*_rigid(judge, model, values), *_rods(judge, model, values), *_loops(judge, model, values)]
    return [*violated, *_rotations(judge), *_dimensions(judge)]


def _parts(judge: Judge, point: str) -> tuple[str, ...]:
    """Return the symbols of a named point: one vector, or its coordinates."""
    symbol = judge.formula.points[point]
    return (symbol,) if isinstance(symbol, str) else tuple(symbol)


def _points(judge: Judge, values: Mapping[str, Value]) -> dict[str, Array]:
    """Return the positions (k, 3) of the named points that have values."""
    positions: dict[str, Array] = {}
    for name in judge.formula.points:
        parts = _parts(judge, name)
        if values.keys() >= set(parts):
            positions[name] = np.hstack([to_array(values[p], judge.reference.k) for p in parts])
    return positions


def _rigid(judge: Judge, model: ReferenceModel, values: Mapping[str, Value]) -> Iterator[Finding]:
    """Yield a finding for each distance between points of one body that the formula makes different from the CAD."""
    positions = _points(judge, values)
    failing = {p.symbol for p in judge.failing()}
    wrong = {name for name in positions if not failing.isdisjoint(_parts(judge, name))}
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
            yield from _distance(judge, length, true, name, "invariant.rigid", f"the formula makes {name}", body)


def _distance(
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
    low = f"{float(np.nanmin(length)) / MM:.{digits}f}"
    high = f"{float(np.nanmax(length)) / MM:.{digits}f}"
    where = f"on '{body}' " if body else ""
    reference = f"{where}in the CAD it is {true / MM:.{digits}f} mm"
    if float(np.nanmax(length)) - float(np.nanmin(length)) <= 10 * judge.tolerance.length:
        text = f"{what} {low} mm long; {reference}"
    else:
        text = f"{what} {low} .. {high} mm long; {reference}: a rigid body cannot change its length"
    yield disagreement(
        code,
        name,
        text,
        mm(largest),
        mm(judge.tolerance.length),
        when=judge.reference.pose_text(int(np.nanargmax(error))),
        word="",
    )


def _rods(judge: Judge, model: ReferenceModel, values: Mapping[str, Value]) -> Iterator[Finding]:
    """Yield a finding for each link whose length would change if the joints had the formula's values."""
    reference = judge.reference
    mechanism = model.mechanism
    wrong: set[str] = set()
    for joint in mechanism.active:
        if joint.name in values and _moved(judge, joint.name, values[joint.name]):
            wrong.add(joint.name)
    if reference.run is None or not wrong:
        return
    moved = model.link_poses(_with_values(reference.run.x, model, {n: values[n] for n in wrong}))
    real = model.link_poses(reference.run.x)
    drive_of = {j.child: j.name for j in mechanism.tree if j.name in wrong}  # by the body that the joint moves
    for link in mechanism.bodies:
        joints = [j for j in mechanism.joints if link.name in (j.parent, j.child)]
        driven = [j for j in joints if _other(j, link.name) in drive_of]
        for joint in driven:
            if joint.type == "prismatic":
                continue
            drive = drive_of[_other(joint, link.name)]
            pivot = _centre(joint, _other(joint, link.name), moved)
            held = _centre(joint, link.name, real)
            for far in joints:
                if far in driven:
                    continue
                end = _centre(far, link.name, real)
                true = float(np.linalg.norm(held[0] - end[0]))
                if true < 1e-6 or np.ptp(np.linalg.norm(held - end, axis=1)) > 1e-6:
                    continue
                length = np.linalg.norm(pivot - end, axis=1)
                what = f"with {drive} from the formula, '{link.name}' would be, from {joint.name} to {far.name},"
                yield from _distance(judge, length, true, link.name, "invariant.rod", what)


def _with_values(x: Array, model: ReferenceModel, values: Mapping[str, Value]) -> Array:
    """Return states x (k, n) in which some joints have other values (k,)."""
    states = x.copy()
    for name, value in values.items():
        states[:, model.tree.configuration[name]] = value
    return states


def _moved(judge: Judge, name: str, value: Value) -> bool:
    """Return whether the formula's value of a joint differs from the value of this joint in the mechanism."""
    return worst(judge.difference(name, value)) > 1


def _other(joint: Joint, body: str) -> str:
    return joint.parent if joint.child == body else joint.child


def _centre(joint: Joint, body: str, poses: Mapping[str, Array]) -> Array:
    """Return the positions (k, 3) of a joint on one of its two bodies."""
    T = joint.T_parent_joint if joint.parent == body else joint.T_child_joint
    return (poses[body] @ T)[:, :3, 3]


def _loops(judge: Judge, model: ReferenceModel, values: Mapping[str, Value]) -> Iterator[Finding]:
    """Yield a finding for each loop that opens if wrong joint values of the formula replace those of the mechanism."""
    run = judge.reference.run
    wrong = {n: values[n] for n in model.tree.configuration if n in values and _moved(judge, n, values[n])}
    if run is None or not wrong or not model.mechanism.loops:
        return
    states = _with_values(run.x, model, wrong)
    if not np.isfinite(states).all():
        return
    # Loops that are not quite closed in the mechanism itself do not count as opened.
    limit = max(judge.tolerance.length, 10 * float(run.gaps[..., 0].max(initial=0.0)))
    gaps = model.collect(states).gaps[..., 0]
    for loop, gap in zip(run.loop_names, gaps.T, strict=True):
        k = int(np.argmax(gap))
        if gap[k] > limit:
            yield _LOOP(
                loop,
                f"with {', '.join(wrong)} from the formula, the loop at {loop} opens",
                mm(gap[k]),
                mm(judge.tolerance.length),
                when=judge.reference.pose_text(k),
            )


def _rotations(judge: Judge) -> Iterator[Finding]:
    """Yield a finding for each computed pose whose rotation matrix is left-handed or not orthogonal."""
    for step in judge.steps:
        for name, value in outputs(judge, step.equation.name).items():
            if not isinstance(value, Matrix) or value.shape not in ((3, 3), (4, 4)):
                continue
            R = value.a[:, :3, :3]
            if not np.isfinite(R).all():
                continue
            deviation = float(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max())
            if deviation > 1e-9:
                what = f"not orthogonal (R^T R - I is {deviation:.2g})"
            elif np.linalg.det(R).min() < 0:
                what = "left-handed (its determinant is -1)"
            else:
                continue
            where = f"{step.equation.name}.{name}"
            text = f"rotation {name} of {step.equation.name} is {what}"
            yield disagreement("invariant.rotation", where, text, Quantity(deviation), 1e-9, word="")


def outputs(judge: Judge, equation: str, given: Mapping[str, Value] = MappingProxyType({})) -> dict[str, Value]:
    """Evaluate an equation; return its outputs by their names, or an empty dictionary after an error.

    The outputs are not compared with the mechanism. `given` are values, by name, that replace inputs of the equation.
    """
    step = judge.step(equation)
    if step.missing or not step.before:
        return {}
    scope = {**copied(step.before[0]), **given}
    try:
        with np.errstate(all="ignore"):
            for code in step.codes:
                exec(code, scope)
    except Exception:
        return {}
    values = returned_values(step, scope[OUT])
    return dict(zip(step.equation.outputs, values, strict=step.plain is not None))


_SCALE = 1.25
"""Factor of all lengths, with which the error of a dimensionally consistent row grows by the same factor."""


def _dimensions(judge: Judge) -> Iterator[Finding]:
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
        factor, unit = (_SCALE, "a length") if kind == "length" else (1.0, "an angle")
        deviation = float(np.abs(after - factor * before).max()) / max(float(np.abs(before).max()), 1e-300)
        if deviation > 1e-6:
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
    lengths = {p.name for p in judge.formula.parameters if p.unit in ("mm", "m", "cm", "um")}
    for name, value in symbols.items():
        kind = reference.kinds.get(name)
        if kind == "pose":
            T = value.a.copy()
            T[:, :3, 3] *= _SCALE
            symbols[name] = Matrix(T)
        elif kind == "length" or name in lengths:
            symbols[name] = value * _SCALE
    return replace(reference, symbols=symbols)
