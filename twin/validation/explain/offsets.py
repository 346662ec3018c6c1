"""Find the joint offsets that are missing in a formula, if the formula's tool pose disagrees with the mechanism.

Offsets are accepted if, with them and with constant rotations of base and tool, the pose agrees with the mechanism.

A Denavit-Hartenberg table without joint offsets cannot be corrected by an edit of one row. An offset of the first or
last angle is equivalent to a rotation of base or tool. For the other angles, quarter turns of up to three angles are
tried. Offsets of lengths are computed by least squares.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.validation.explain.invariants import said_pose
from twin.validation.explain.judge import Judge, Place
from twin.validation.explain.result import Convention

_QUARTERS = (np.pi / 2, -np.pi / 2, np.pi)
_MOST = 3
"""Maximum number of angles with an offset."""

_TRIALS = 400
_ALIKE = 1e-9
"""Mean squared rotation residual below which the rotations agree."""


def offsets(judge: Judge) -> Iterator[Convention]:
    """Yield, for each wrong forward equation, the smallest set of joint offsets with which the pose agrees."""
    for place in judge.failing():
        step = judge.step(place.equation)
        if step.stage != "forward" or judge.truth.kinds[place.symbol] != "pose":
            continue
        found = _search(judge, place)
        if found is not None:
            yield Convention("offset", f"{place.symbol} of {place.equation} {found[0]}", (place.name,), found[1])


def _search(judge: Judge, place: Place) -> tuple[str, float] | None:
    joints = [j for j in judge.formula.joints if j.name in judge.truth.symbols]
    angles = [j.name for j in joints[1:-1] if j.kind == "revolute"]
    slides = [j.name for j in joints if j.kind == "prismatic"]
    true = judge.truth.symbols[place.symbol].a
    tried = 0
    for count in range(_MOST + 1):
        for chosen in combinations(angles, count):
            for turns in product(_QUARTERS, repeat=count):
                tried += 1
                if tried > _TRIALS:
                    return None
                moved = dict(zip(chosen, turns, strict=True))
                T = _said(judge, place, moved)
                if T is None:
                    return None
                ends = _ends(T[:, :3, :3], true[:, :3, :3])
                found = None if ends is None else _placed(judge, place, moved, slides, T, *ends)
                if found is not None:
                    return found
    return None


def _said(judge: Judge, place: Place, moved: dict[str, float]) -> Array | None:
    """Return the formula's pose (k, 4, 4) with the joint offsets `moved`; None if the pose has no value."""
    truth = judge.truth
    symbols = {**truth.symbols, **{n: truth.symbols[n] + v for n, v in moved.items()}}
    other = judge.on(replace(truth, symbols=symbols), {s.equation.name for s in judge.steps if s.stage == "forward"})
    at = next((p for p in other.residuals if p.key == place.key), None)
    T = None if at is None else said_pose(other, at)
    return T if T is not None and np.isfinite(T).all() else None


def _ends(F: Array, R: Array) -> tuple[Array, Array] | None:
    """Return rotations of base and tool (3, 3) with R = base F tool at all poses (k, 3, 3); None if there are none.

    base^T R - F tool = 0 is linear in the unknowns base and tool; the solution must be unique up to a factor.
    """
    eye = np.eye(3)
    A = np.stack([np.hstack([np.kron(eye, r.T), -np.kron(f, eye)]) for f, r in zip(F, R, strict=True)])
    size, V = np.linalg.eigh(np.einsum("kij,kil->jl", A, A) / len(A))
    if size[0] > _ALIKE or size[1] < 1e3 * _ALIKE:
        return None
    X, Y = V[:9, 0].reshape(3, 3), V[9:, 0].reshape(3, 3)
    scale = np.cbrt(np.linalg.det(X))
    return (X / scale).T, Y / scale


def _placed(
    judge: Judge, place: Place, moved: dict[str, float], slides: list[str], T: Array, base: Array, tool: Array
) -> tuple[str, float] | None:
    """Return (text on the offsets, worst residual) if, with the rotations, the positions also agree; otherwise None."""
    true = judge.truth.symbols[place.symbol].a
    want = true[:, :3, 3] @ base - T[:, :3, 3]
    along = []
    for name in slides:
        there = _said(judge, place, {**moved, name: 0.1})
        if there is None:
            return None
        along.append((there[:, :3, 3] - T[:, :3, 3]) / 0.1)
    columns = np.stack(along, axis=2) if along else np.zeros((*want.shape, 0))
    fixed = np.concatenate([columns, T[:, :3, :3], np.broadcast_to(np.eye(3), T[:, :3, :3].shape)], axis=2)
    for A, count in ((columns, len(slides)), (fixed, len(slides) + 6)):
        flat = A.reshape(want.size, count)
        x = np.linalg.lstsq(flat, want.ravel(), rcond=None)[0]
        left = float(np.abs(flat @ x - want.ravel()).max(initial=0.0)) / judge.tolerance.length
        shifts = {n: v for n, v in zip(slides, x, strict=False) if abs(v) > judge.tolerance.length}
        if left <= 1 and (moved or shifts):
            return _text(moved, shifts, base, tool, x[len(slides) :]), left
    return None


def _text(moved: dict[str, float], shifts: dict[str, float], base: Array, tool: Array, ends: Array) -> str:
    parts = [f"{n} {'-' if v < 0 else '+'} {abs(np.degrees(v)):g}°" for n, v in moved.items()]
    parts += [f"{n} {'-' if v < 0 else '+'} {abs(v) / MM:.6g} mm" for n, v in shifts.items()]
    text = f"agrees with the mechanism's pose with {', '.join(parts)}"
    if not np.allclose(base, np.eye(3)):
        text += f"; base axes {axes_text(base)}"
    if not np.allclose(tool, np.eye(3)):
        text += f"; tool axes {axes_text(tool.T)}"
    for what, p in zip(("tool", "base"), ends.reshape(-1, 3), strict=False):
        if np.abs(p).max() > 1e-9:
            text += f"; {what} moved by ({', '.join(f'{v / MM:.6g}' for v in p)}) mm"
    return text


def axes_text(P: Array) -> str:
    """Return a rotation as text: "x = -y, ..." for quarter turns, otherwise its angle."""
    if np.abs(np.abs(P).max(axis=1) - 1).max() < 1e-6:
        rows = [(int(np.argmax(np.abs(r))), r) for r in P]
        return ", ".join(f"{a} = {'-' if r[i] < 0 else ''}{'xyz'[i]}" for a, (i, r) in zip("xyz", rows, strict=True))
    angle = np.degrees(np.arccos(np.clip((np.trace(P) - 1) / 2, -1, 1)))
    return f"turned by {angle:.4f}°"
