"""Check invariants of any formula: rigid bodies, constant rod lengths, closed loops, rotations, dimensions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from twin.core.findings import Finding, Kind, disagreement
from twin.core.quantity import Quantity, mm
from twin.core.spatial import Array
from twin.core.units import MM, decimals
from twin.model.joint import Joint
from twin.reference import ReferenceModel
from twin.validation.explain.judge import Judge, Place, worst
from twin.validation.explain.numeric import Matrix, to_array
from twin.validation.explain.plain import copied, parts
from twin.validation.explain.source import OUT
from twin.validation.explain.truth import Truth

_LOOP = Kind("invariant.loop", "disagreement", word="tolerance")


def said(judge: Judge) -> dict[str, Any]:
    """Return {symbol: value computed by the formula from the mechanism's values}, for the compared symbols."""
    truth, out = judge.truth, {}
    units = {"length": judge.tolerance.length, "angle": judge.tolerance.angle}
    for place, r in judge.residuals.items():
        kind = truth.kinds[place.symbol]
        if kind == "pose" or (place.symbol in out and worst(r) == 0):
            continue
        true = to_array(truth.symbols[place.symbol], truth.k)
        value = true + r * units[kind]
        out[place.symbol] = (
            Matrix(value[:, :, None]) if isinstance(truth.symbols[place.symbol], Matrix) else value[:, 0]
        )
    return out


def said_pose(judge: Judge, place: Place) -> Array:
    """Return the pose (k, 4, 4) that a row of the formula computes; it is recovered from the residual of the row."""
    scale = np.full(16, judge.tolerance.angle)
    scale[[3, 7, 11]] = judge.tolerance.length
    return judge.truth.symbols[place.symbol].a + (judge.residuals[place] * scale).reshape(-1, 4, 4)


def solved(judge: Judge) -> dict[str, Any]:
    """Return the outputs of implicit equations; the coupled rows of an equation are solved together."""
    out: dict[str, Any] = {}
    k = judge.truth.k
    for step in judge.steps:
        names = [n for n in step.equation.outputs if n in step.required and n in judge.truth.kinds]
        if not names or step.missing or step.stage == "helper":
            continue

        def at(x: list[float], names: list[str] = names, step: Any = step) -> Array | None:
            got = outputs(judge, step.equation.name, dict(zip(names, x, strict=True)))
            return np.stack([to_array(got[n], k)[:, 0] for n in names], axis=1) if got else None

        n = len(names)
        b, tested = at([0.0] * n), at([2.0] * n)
        columns = [at([float(i == j) for j in range(n)]) for i in range(n)]
        if b is None or tested is None or any(c is None for c in columns):
            continue
        A = np.stack([c - b for c in columns if c is not None], axis=2)
        if not np.allclose(A.sum(axis=2) * 2 + b, tested, atol=1e-9) or not np.isfinite(A).all():
            continue  # the rows are not linear in the outputs
        M = np.eye(n) - A
        if np.linalg.cond(M).max() < 1e12:
            x = np.linalg.solve(M, b[..., None])[..., 0]
            out |= {name: x[:, i] for i, name in enumerate(names)}
    return out


def invariants(judge: Judge, model: ReferenceModel) -> list[Finding]:
    """Return findings on violated invariants; none if the formula agrees."""
    values = {**said(judge), **solved(judge)}
    out = [*_rigid(judge, model, values), *_rods(judge, model, values), *_loops(judge, model, values)]
    return [*out, *_rotations(judge), *_dimensions(judge)]


def _points(judge: Judge, values: dict[str, Any]) -> dict[str, Array]:
    out = {}
    for name, symbol in judge.formula.points.items():
        parts = (symbol,) if isinstance(symbol, str) else symbol
        if all(p in values for p in parts):
            out[name] = np.hstack([to_array(values[p], judge.truth.k) for p in parts])
    return out


def _off(judge: Judge, name: str) -> bool:
    """Return whether a row of a named point is wrong."""
    symbol = judge.formula.points[name]
    bad = {p.symbol for p in judge.failing()}
    return bool(bad & ({symbol} if isinstance(symbol, str) else set(symbol)))


def _rigid(judge: Judge, model: ReferenceModel, values: dict[str, Any]) -> Iterator[Finding]:
    """Yield a finding for each distance between points of one body that the formula makes different from the CAD."""
    placed = _points(judge, values)
    bodies: dict[str, list[str]] = {}
    for p in model.mechanism.points:
        if p.name in placed:
            bodies.setdefault(p.body, []).append(p.name)
    where = {p.name: p.p_body for p in model.mechanism.points}
    for body, names in bodies.items():
        for a, b in combinations(names, 2):
            if not (_off(judge, a) or _off(judge, b)):
                continue
            true = float(np.linalg.norm(where[a] - where[b]))
            length = np.linalg.norm(placed[a] - placed[b], axis=1)
            yield from _distance(judge, length, true, f"{a}-{b}", f"on '{body}' ", "invariant.rigid")


def _distance(
    judge: Judge, length: Array, true: float, name: str, where: str, code: str, what: str = ""
) -> Iterator[Finding]:
    off = np.abs(length - true)
    if not np.isfinite(off).any() or float(np.nanmax(off)) <= judge.tolerance.length:
        return
    low, high = float(np.nanmin(length)), float(np.nanmax(length))
    constant = high - low <= 10 * judge.tolerance.length
    n = decimals(float(np.nanmax(off)) / MM)
    much = f"{low / MM:.{n}f} mm" if constant else f"{low / MM:.{n}f} .. {high / MM:.{n}f} mm"
    yield disagreement(
        code,
        name,
        f"{what or f'the formula makes {name}'} {much} long; {where}in the CAD it is {true / MM:.{n}f} mm"
        + ("" if constant else ": a rigid body cannot change its length"),
        mm(float(np.nanmax(off))),
        mm(judge.tolerance.length),
        when=judge.truth.pose_text(int(np.nanargmax(off))),
        word="",
    )


def _rods(judge: Judge, model: ReferenceModel, values: dict[str, Any]) -> Iterator[Finding]:
    """Yield a finding for each link whose length would change if the joints had the formula's values."""
    truth = judge.truth
    active = {j.name for j in model.mechanism.active if j.name in values}
    wrong = {n for n in active if _moved(judge, n, values[n])}
    if truth.run is None or not wrong:
        return
    states = truth.run.x.copy()
    for name in wrong:
        states[:, model.tree.configuration[name]] = values[name]
    moved, real = model.link_poses(states), model.link_poses(truth.run.x)
    driven = {j.child: j.name for j in model.mechanism.tree if j.name in wrong}
    for link in model.mechanism.bodies:
        joints = [j for j in model.mechanism.joints if link.name in (j.parent, j.child)]
        from_drive = [j for j in joints if _other(j, link.name) in driven]
        for j in from_drive:
            pivot = _centre(j, _other(j, link.name), moved)
            held = _centre(j, link.name, real)
            ends = [(k.name, _centre(k, link.name, real)) for k in joints if k is not j and k not in from_drive]
            for name, end in ends:
                true = float(np.linalg.norm(held[0] - end[0]))
                if true < 1e-6 or j.type == "prismatic" or np.ptp(np.linalg.norm(held - end, axis=1)) > 1e-6:
                    continue
                length = np.linalg.norm(pivot - end, axis=1)
                drive = driven[_other(j, link.name)]
                what = f"with {drive} from the formula, '{link.name}' would be, from {j.name} to {name},"
                yield from _distance(judge, length, true, link.name, "", "invariant.rod", what)


def _moved(judge: Judge, name: str, value: Any) -> bool:
    """Return whether the formula's value of a joint differs from the value of this joint in the mechanism."""
    return not worst(judge.difference(name, value)) <= 1


def _other(joint: Joint, body: str) -> str:
    return joint.parent if joint.child == body else joint.child


def _centre(joint: Joint, body: str, poses: dict[str, Array]) -> Array:
    T = joint.T_parent_joint if joint.parent == body else joint.T_child_joint
    return (poses[body] @ T)[:, :3, 3]


def _loops(judge: Judge, model: ReferenceModel, values: dict[str, Any]) -> Iterator[Finding]:
    """Yield a finding for each loop that opens if wrong joint values of the formula replace those of the mechanism."""
    truth = judge.truth
    names = [n for n in model.tree.configuration if n in values and _moved(judge, n, values[n])]
    if truth.run is None or not names or not model.mechanism.loops:
        return
    states = truth.run.x.copy()
    for name in names:
        states[:, model.tree.configuration[name]] = values[name]
    if not np.isfinite(states).all():
        return
    gaps = model.collect(states).gaps[..., 0]
    for i, loop in enumerate(truth.run.loop_names):
        k = int(np.argmax(gaps[:, i]))
        if gaps[k, i] > max(judge.tolerance.length, 10 * float(truth.run.gaps[..., 0].max(initial=0.0))):
            yield _LOOP(
                loop,
                f"with {', '.join(names)} from the formula, the loop at {loop} opens",
                mm(gaps[k, i]),
                mm(judge.tolerance.length),
                when=truth.pose_text(k),
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
            off = float(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max())
            det = np.linalg.det(R)
            if off > 1e-9 or det.min() < 0:
                left = off <= 1e-9
                what = "left-handed (its determinant is -1)" if left else f"not orthogonal (R^T R - I is {off:.2g})"
                where, text = f"{step.equation.name}.{name}", f"rotation {name} of {step.equation.name} is {what}"
                yield disagreement("invariant.rotation", where, text, Quantity(off), 1e-9, word="")


def outputs(judge: Judge, equation: str, given: dict[str, Any] | None = None) -> dict[str, Any]:
    """Evaluate an equation; return its outputs by their names, or an empty dictionary after an error.

    The outputs are not compared with the mechanism. `given` are values, by name, that replace inputs of the equation.
    """
    step = judge.step(equation)
    if step.missing or not step.before:
        return {}
    env = {**copied(step.before[0]), **(given or {})}
    try:
        with np.errstate(all="ignore"):
            for code in step.codes:
                exec(code, env)
    except Exception:
        return {}
    values = env[OUT]
    if step.plain is not None:
        return dict(zip(step.equation.outputs, parts(step.plain, values), strict=True))
    values = list(values) if isinstance(values, tuple | list) else [values]
    return dict(zip(step.equation.outputs, values, strict=False))


_SCALE = 1.25


def _dimensions(judge: Judge) -> Iterator[Finding]:
    """Yield a finding for each wrong row that is dimensionally inconsistent: its error does not scale with lengths."""
    failing = judge.failing()
    if not failing:
        return
    scaled = _scaled(judge)
    again = judge.on(scaled)
    for place in failing:
        other = next((r for p, r in again.residuals.items() if p.key == place.key), None)
        if other is None:
            continue
        r = judge.residuals[place]
        kind = judge.truth.kinds[place.symbol]
        if kind == "pose" or not (np.isfinite(r).all() and np.isfinite(other).all()):
            continue
        factor = _SCALE if kind == "length" else 1.0
        off = float(np.abs(other - factor * r).max()) / max(float(np.abs(r).max()), 1e-300)
        if off > 1e-6:
            unit = "a length" if kind == "length" else "an angle"
            yield disagreement(
                "invariant.dimension",
                f"{place.name}, line {place.line}",
                f"the row of {place.symbol} in {place.equation} ({place.variant}) is dimensionally inconsistent; "
                f"{unit} is expected",
                suggestion="look for a missing square, root or parenthesis",
            )


def _scaled(judge: Judge) -> Truth:
    truth, symbols = judge.truth, dict(judge.truth.symbols)
    lengths = {p.name for p in judge.formula.parameters if p.unit in ("mm", "m", "cm", "um")}
    for name, value in symbols.items():
        kind = truth.kinds.get(name)
        if kind == "pose":
            a = value.a.copy()
            a[:, :3, 3] *= _SCALE
            symbols[name] = Matrix(a)
        elif kind == "length" or name in lengths:
            symbols[name] = value * _SCALE
    return replace(truth, symbols=symbols)
