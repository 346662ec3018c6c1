"""Find conventions under which formula and mechanism agree: Euler angles, units, signs, axes, and others.

Each convention is tried as a whole, because no edit of a single row has the same effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations, product
from types import FunctionType
from typing import Any

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL
from twin.validation.explain.invariants import said, said_pose
from twin.validation.explain.judge import Judge, Place, worst
from twin.validation.explain.numeric import Matrix, to_array, turn
from twin.validation.explain.offsets import axes_text, offsets
from twin.validation.explain.plain import enter, leave
from twin.validation.explain.result import Convention
from twin.validation.explain.rows import Helper, Step
from twin.validation.explain.suspects import suspects

_NAMED = (
    (-1.0, "the opposite sign"),
    (1e3, "millimetres instead of metres"),
    (1e-3, "metres instead of millimetres"),
    (180 / np.pi, "degrees instead of radians"),
    (np.pi / 180, "radians instead of degrees"),
)


def conventions(judge: Judge, known: Sequence[Convention] | None = None) -> list[Convention]:
    """Return the conventions that fix rows, sorted by the number of fixed rows, largest first.

    `known` is the result of `general`; None: it is computed.
    """
    if not judge.failing():
        return []
    with np.errstate(all="ignore"):
        found = [*(general(judge) if known is None else known), *_scalars(judge)]
        if not found:
            found = [*offsets(judge)]
    return sorted(found, key=lambda c: (-len(c.rows), c.after))


def general(judge: Judge) -> list[Convention]:
    """Return the conventions that are not of single rows: angles, units, axes, frames, Denavit-Hartenberg form."""
    with np.errstate(all="ignore"):
        return [*_dh(judge), *_angles_in(judge), *_axes(judge), *_frames(judge), *_euler(judge)]


def _cured(judge: Judge, other: Judge) -> tuple[list[Place], float] | None:
    """Return (rows that are wrong in `judge` and agree in `other`, the worst residual of these rows in `other`).

    Return None if there is no such row, or if a row that agrees in `judge` is wrong in `other`.
    """
    bad = judge.failing()
    now = {p.key: worst(r) for p, r in other.residuals.items()}
    for p in judge.residuals:
        agreed = p not in bad and judge.step(p.equation).stage != "helper"
        if agreed and not now.get(p.key, np.inf) <= 1:
            return None
    cured = [p for p in bad if now.get(p.key, np.inf) <= 1]
    if not cured:
        return None
    return cured, max(now[p.key] for p in cured)


ORDERS = tuple("".join(o) for o in product("xyz", repeat=3) if o[0] != o[1] and o[1] != o[2])
"""The twelve axis sequences of Euler angles."""


def _euler(judge: Judge) -> Iterator[Convention]:
    """Yield a convention if the rows agree with the mechanism for another Euler sequence, or for other signs."""
    truth = judge.truth
    angles = [n for n, unit in truth.coordinates if unit == "rad"]
    if len(angles) != 3 or not any(set(angles) & set(step.inputs) for step in judge.steps):
        return  # no equation reads the angles
    bad = [p for p in judge.failing() if judge.step(p.equation).stage == "inverse"]
    if not bad:
        return
    involved = {e for p in bad for e in suspects(judge, p)}
    keys = {p.key for p in bad}
    R = truth.Ts[:, :3, :3]
    now = np.column_stack([truth.symbols[a] for a in angles])
    for order in ORDERS:
        for transposed in (False, True):
            values = spatial.euler_angles(np.swapaxes(R, 1, 2) if transposed else R, order)
            if transposed:
                values = -values  # the same angles, applied in the opposite order
            for place in permutations(range(3)) if not transposed else ((0, 1, 2), (2, 1, 0)):
                for signs in product((1.0, -1.0), repeat=3):
                    v = values[:, place] * signs
                    if np.abs(np.sin(v - now)).max() < 1e-9:
                        continue  # the formula's own convention
                    symbols = {**truth.symbols, **dict(zip(angles, v.T, strict=True))}
                    other = replace(truth, symbols=symbols)
                    quick = judge.on(other, involved).residuals
                    if not any(worst(r) <= 1 for p, r in quick.items() if p.key in keys):
                        continue
                    found = _cured(judge, judge.on(other))
                    if found is None:
                        continue
                    terms = [""] * 3
                    for k, (p, s) in enumerate(zip(place, signs, strict=True)):
                        terms[p] = f"R{order[p]}({'-' if s < 0 else ''}{angles[k]})"
                    text = " ".join(terms if not transposed else terms[::-1])
                    rows = tuple(p.name for p in found[0])
                    yield Convention(
                        "euler", f"the rows agree with the angles of R = {text}, not with the angles "
                        "that the formula's own convention gives", rows, found[1]
                    )  # fmt: skip
                    return


def _angles_in(judge: Judge) -> Iterator[Convention]:
    """Yield one convention if the rows agree for angles in degrees, and one if they agree for lengths in mm."""
    truth = judge.truth
    for kind, factor, text in (
        ("angle", 180 / np.pi, "the rows expect angles in degrees, but the angles are given in radians"),
        ("length", 1e3, "the rows expect lengths in millimetres, but the lengths are given in metres"),
    ):
        parameters = {p.name: p.unit for p in judge.formula.parameters}
        units = ("deg",) if kind == "angle" else ("mm", "m")
        symbols = {
            n: v * factor if (truth.kinds.get(n) == kind or parameters.get(n) in units) else v
            for n, v in truth.symbols.items()
        }
        if kind == "length":
            T = truth.symbols[POSE_SYMBOL].a.copy()
            T[:, :3, 3] *= factor
            symbols[POSE_SYMBOL] = Matrix(T)
        other = judge.on(replace(truth, symbols=symbols))
        cured = []
        for p, r in judge.residuals.items():
            q = next((x for x in other.residuals if x.key == p.key), None)  # fmt: skip
            if q is None or worst(r) <= 1 or truth.kinds[p.symbol] == "pose":
                continue
            # An output may be in either unit: it must agree in one of them.
            value = other.residuals[q] / (factor if truth.kinds[p.symbol] == kind else 1.0)
            if worst(value) <= 1 or worst(other.residuals[q]) <= 1:
                cured.append((p, min(worst(value), worst(other.residuals[q]))))
        if cured and len(cured) == len({p.name for p in judge.failing()}):
            yield Convention("unit", text, tuple(p.name for p, _ in cured), max(w for _, w in cured))


def _scalars(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for rows whose value differs from the mechanism's only by a sign, a unit or a zero offset."""
    truth, values = judge.truth, said(judge)
    groups: dict[str, list[tuple[Place, float]]] = {}
    for place in judge.failing():
        true = to_array(truth.symbols[place.symbol], truth.k)
        if place.symbol not in values or true.shape[1] != 1 or np.ptp(true) < 1e-9:
            continue
        raw = values[place.symbol]
        t, y = true[:, 0], np.asarray(raw, float)
        tolerance = judge.tolerance.angle if truth.kinds[place.symbol] == "angle" else judge.tolerance.length
        for slope, text in (*_NAMED, (1.0, "")):
            if truth.kinds[place.symbol] == "angle":
                offset = np.angle(np.exp(1j * (y - slope * t))) if abs(slope) == 1 else y - slope * t
                middle = float(np.angle(np.mean(np.exp(1j * offset)))) if abs(slope) == 1 else float(offset.mean())
                left = np.abs(np.angle(np.exp(1j * (offset - middle)))).max() / tolerance
            else:
                offset = y - slope * t
                middle = float(offset.mean())
                left = float(np.abs(offset - middle).max()) / tolerance / abs(slope)
            if not left <= 1:
                continue
            zero = ""
            if abs(middle) > tolerance:
                shown = (
                    f"{np.degrees(middle):.6g}°" if truth.kinds[place.symbol] == "angle" else f"{middle * 1e3:.6g} mm"
                )
                zero = f"its zero position differs by {shown} from the zero position in the mechanism"
            message = " and ".join(x for x in (text, zero) if x)
            if message:
                groups.setdefault(message, []).append((place, float(left)))
            break
    for message, places in groups.items():
        names = ", ".join(p.symbol for p, _ in places)
        yield Convention(
            "offset" if message.startswith("its zero") else "sign" if "sign" in message else "unit",
            f"{names}: {message}", tuple(p.name for p, _ in places), max(w for _, w in places)
        )  # fmt: skip


def _axes(judge: Judge) -> Iterator[Convention]:
    """Yield a convention if the named points agree with the mechanism after axes are permuted, mirrored or scaled."""
    truth, values = judge.truth, said(judge)
    pairs = []
    for name, symbol in judge.formula.points.items():
        parts = (symbol,) if isinstance(symbol, str) else symbol
        places = [p for p in judge.failing() if p.symbol in parts]
        if not places or not all(p in values for p in parts):
            continue
        y = np.hstack([to_array(values[p], truth.k) for p in parts])
        t = np.hstack([to_array(truth.symbols[p], truth.k) for p in parts])
        pairs.append((name, places, y, t))
    if not pairs:
        return
    Y, T = np.vstack([p[2] for p in pairs]), np.vstack([p[3] for p in pairs])
    if not np.isfinite(Y).all():
        return
    for P in signed_permutations()[1:]:
        for factor, unit in ((1.0, ""), (1e3, ", in millimetres")):
            left = np.abs(Y - factor * T @ P.T).max() / factor / judge.tolerance.length
            if left <= 1:
                hand = "" if np.linalg.det(P) > 0 else ": a left-handed frame"
                text = f"points {', '.join(p[0] for p in pairs)} use other axes{hand}: {axes_text(P)}{unit}"
                rows = tuple(p.name for _, places, _, _ in pairs for p in places)
                yield Convention("axes" if not hand else "handedness", text, rows, float(left))
                return


def signed_permutations() -> list[Array]:
    """Return the 48 signed permutation matrices (3, 3), the identity first."""
    signs = list(product((1.0, -1.0), repeat=3))
    return [np.eye(3)[list(order)] * np.array(s)[:, None] for order in permutations(range(3)) for s in signs]


def _frames(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for each pose that agrees after an inversion, or after constant rotations of base and tool."""
    for place in judge.failing():
        if judge.truth.kinds[place.symbol] != "pose":
            continue
        true, T = judge.truth.symbols[place.symbol].a, said_pose(judge, place)
        if not np.isfinite(T).all():
            continue
        made = {"": T, "inverted, ": np.linalg.inv(T) if np.linalg.cond(T).max() < 1e12 else T}
        best: tuple[float, str] | None = None
        for how, M in made.items():
            for unit, factor in (("", 1.0), ("its lengths in millimetres, ", 1e-3)):
                p, R = M[:, :3, 3] * factor, M[:, :3, :3]
                for P in signed_permutations():
                    left = np.abs(p @ P.T - true[:, :3, 3]).max() / judge.tolerance.length
                    if left > 1:
                        continue
                    Q = np.swapaxes(P @ R, 1, 2) @ true[:, :3, :3]
                    spread = np.abs(Q - Q.mean(axis=0)).max() / judge.tolerance.angle
                    if spread <= 1:
                        base = "" if np.allclose(P, np.eye(3)) else f"base axes {axes_text(P)}, "
                        tool = "" if np.allclose(Q[0], np.eye(3)) else f"tool axes {axes_text(Q[0].T)}, "
                        text = f"{how}{unit}{base}{tool}".removesuffix(", ")
                        score = (max(left, spread), text)
                        best = score if best is None or len(text) < len(best[1]) else best
        if best is not None:
            yield Convention(
                "axes", f"{place.symbol} of {place.equation} agrees with the mechanism's pose: {best[1]}",
                (place.name,), best[0],
            )  # fmt: skip


def _dh(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for each helper that makes rows agree if it uses the other Denavit-Hartenberg form."""
    for step in judge.steps:
        bad = [p for p in judge.failing() if p.equation == step.equation.name]
        if not bad or step.stage == "helper":
            continue
        for helper in judge.helpers(step):
            for stand_in, message in _other_forms(helper):
                found = _with_helper(judge, step, helper, stand_in)
                if found is not None:
                    yield Convention("dh", message, tuple(p.name for p in found[0]), found[1])
                    break


def _other_forms(helper: Helper) -> Iterator[tuple[Callable[..., Any], str]]:
    """Yield (function in the other form, message) for a helper that returns poses."""
    name = helper.source.name
    function: Any = helper.function
    form = dh_form(function)
    if form is not None:
        kind, order = form
        other = "standard" if kind == "modified" else "modified"
        text = f"{name}() multiplies rows in {kind} Denavit-Hartenberg form; the table has the {other} form"
        yield partial(_dh_row, other, order), text
        return
    swap = "moves first and then rotates, as in modified Denavit-Hartenberg form; the rows agree if it rotates first"
    yield partial(_swapped, function, False), f"{name}() {swap} (standard form): swap rotation and translation"
    swap = "rotates first and then moves, as in standard Denavit-Hartenberg form; the rows agree if it moves first"
    yield partial(_swapped, function, True), f"{name}() {swap} (modified form): swap rotation and translation"


def _with_helper(
    judge: Judge, step: Step, helper: Helper, stand_in: Callable[..., Any]
) -> tuple[list[Place], float] | None:
    """Return the result of `_cured` if a function replaces a helper of an equation."""
    undo = []
    for scope in (step.scope, helper.function.__globals__, *(h.function.__globals__ for h in judge.helpers(step))):
        for name, value in list(scope.items()):
            if value is helper.function:
                undo.append((scope, name))
                scope[name] = stand_in
    try:
        return _cured(judge, judge.on(judge.truth))
    finally:
        for scope, name in undo:
            scope[name] = helper.function


def _swapped(function: FunctionType, back: bool, *values: Any) -> Any:
    """Return the pose Rot Trans instead of Trans Rot of a function; `back`: Trans Rot instead of Rot Trans.

    Raises:
        TypeError: the function returns no poses (4, 4).
    """
    value = function(*values)
    pose = leave(value)
    if not isinstance(pose, Matrix) or pose.shape != (4, 4):
        raise TypeError("no pose")
    T = pose.a.copy()
    R = np.swapaxes(T[:, :3, :3], 1, 2) if back else T[:, :3, :3]
    T[:, :3, 3] = (R @ T[:, :3, 3:])[..., 0]
    return enter(Matrix(T)) if not isinstance(value, Matrix) else Matrix(T)


def _dh_row(kind: str, order: tuple[int, ...], *values: Any) -> Matrix:
    """Return the matrix of one row of a Denavit-Hartenberg table.

    `kind` is "standard" or "modified"; `order` gives the positions of alpha, a, theta and d in `values`.
    """
    alpha, a, theta, d = (np.atleast_1d(np.asarray(values[i], float)) for i in order)
    k = max(len(x) for x in (alpha, a, theta, d))
    alpha, a, theta, d = (np.broadcast_to(x, (k,)) for x in (alpha, a, theta, d))

    def place(R: Array, x: Array, z: Array) -> Array:
        T = np.tile(np.eye(4), (k, 1, 1))
        T[:, :3, :3], T[:, 0, 3], T[:, 2, 3] = R, x, z
        return T

    o = np.zeros(k)
    about_x, about_z = place(turn(0)(alpha).a, a, o), place(turn(2)(theta).a, o, d)
    return Matrix(about_x @ about_z if kind == "modified" else about_z @ about_x)


def dh_form(function: FunctionType) -> tuple[str, tuple[int, ...]] | None:
    """Return ("standard" or "modified", positions of the arguments alpha, a, theta, d) of a Denavit-Hartenberg row.

    None if the function does not compute such a row.
    """
    if function.__code__.co_argcount != 4:
        return None
    probe = (0.3, 0.7, 1.1, 0.45)
    try:
        made = function(*probe)
    except Exception:
        return None
    if not isinstance(made, Matrix) or made.shape != (4, 4):
        return None
    for kind in ("modified", "standard"):
        for order in permutations(range(4)):
            if np.abs(_dh_row(kind, order, *probe).a - made.a).max() < 1e-12:
                return kind, order
    return None
