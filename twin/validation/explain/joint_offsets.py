"""Find the joint offsets that are missing in a formula, if the formula's tool pose disagrees with the mechanism.

Offsets are accepted if, with them and with constant rotations of base and tool, the pose agrees with the mechanism.

A Denavit-Hartenberg table without joint offsets cannot be corrected by an edit of one row. An offset of the first or
last angle is equivalent to a rotation of base or tool. For the other angles, quarter turns of up to three angles are
tried. Offsets of lengths are computed by least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.validation.explain.explanation_data import Convention
from twin.validation.explain.invariants import formula_pose
from twin.validation.explain.row_deviations import Judge, RowPlace

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
        if step.stage != "forward" or judge.reference.kinds[place.symbol] != "pose":
            continue
        fit = _search(judge, place)
        if fit is not None:
            text, after = fit
            yield Convention("offset", f"{place.symbol} of {place.equation} {text}", (place.name,), after)


def _search(judge: Judge, place: RowPlace) -> tuple[str, float] | None:
    """Return (text on the offsets, worst residual) of the first offsets with which the pose agrees, fewest first."""
    joints = [j for j in judge.formula.joints if j.name in judge.reference.symbols]
    angles = [j.name for j in joints[1:-1] if j.kind == "revolute"]
    slides = [j.name for j in joints if j.kind == "prismatic"]
    true = judge.reference.symbols[place.symbol].a
    for tried, moved in enumerate(_turned(angles)):
        if tried == _TRIALS:
            return None
        T = _said(judge, place, moved)
        if T is None:
            return None
        ends = _ends(T[:, :3, :3], true[:, :3, :3])
        if ends is None:
            continue
        fit = _placed(judge, place, moved, slides, T, *ends)
        if fit is not None:
            return fit
    return None


def _turned(angles: Sequence[str]) -> Iterator[dict[str, float]]:
    """Yield offsets in rad by name: quarter turns of no angle, of each angle, and of several angles."""
    for count in range(_MOST + 1):
        for chosen in combinations(angles, count):
            for turns in product(_QUARTERS, repeat=count):
                yield dict(zip(chosen, turns, strict=True))


def _said(judge: Judge, place: RowPlace, moved: dict[str, float]) -> Array | None:
    """Return the formula's pose (k, 4, 4) with the joint offsets `moved`; None if the pose has no value."""
    symbols = dict(judge.reference.symbols)
    for name, offset in moved.items():
        symbols[name] = symbols[name] + offset
    forward = {s.equation.name for s in judge.steps if s.stage == "forward"}
    other = judge.on(judge.reference.with_parameters(symbols), forward)
    for same in other.residuals:
        if same.key == place.key:
            T = formula_pose(other, same)
            return T if np.isfinite(T).all() else None
    return None


def _ends(F: Array, R: Array) -> tuple[Array, Array] | None:
    """Return rotations of base and tool (3, 3) with R = base F tool at all poses (k, 3, 3); None if there are none.

    base^T R - F tool = 0 is linear in the unknowns base and tool; the solution must be unique up to a factor.
    """
    eye = np.eye(3)
    blocks: list[Array] = []
    for f, r in zip(F, R, strict=True):
        blocks.append(np.hstack([np.kron(eye, r.T), -np.kron(f, eye)]))
    A = np.stack(blocks)
    squares, V = np.linalg.eigh(np.einsum("kij,kil->jl", A, A) / len(A))
    if squares[0] > _ALIKE or squares[1] < 1e3 * _ALIKE:
        return None
    base_T = V[:9, 0].reshape(3, 3)
    tool = V[9:, 0].reshape(3, 3)
    scale = np.cbrt(np.linalg.det(base_T))  # the eigenvector has any length; a rotation has determinant 1
    return (base_T / scale).T, tool / scale


def _placed(
    judge: Judge, place: RowPlace, moved: dict[str, float], slides: list[str], T: Array, base: Array, tool: Array
) -> tuple[str, float] | None:
    """Return (text on the offsets, worst residual) if, with the rotations, the positions also agree; otherwise None."""
    true = judge.reference.symbols[place.symbol].a
    want = true[:, :3, 3] @ base - T[:, :3, 3]
    slopes: list[Array] = []  # change of the position (k, 3) with the value of each sliding joint
    for name in slides:
        there = _said(judge, place, {**moved, name: 0.1})
        if there is None:
            return None
        slopes.append((there[:, :3, 3] - T[:, :3, 3]) / 0.1)
    columns = np.zeros((*want.shape, 0))
    if slopes:
        columns = np.stack(slopes, axis=2)
    fixed = np.concatenate([columns, T[:, :3, :3], np.broadcast_to(np.eye(3), T[:, :3, :3].shape)], axis=2)
    # Offsets of the joints alone first, then also shifts of tool and base.
    for A, count in ((columns, len(slides)), (fixed, len(slides) + 6)):
        flat = A.reshape(want.size, count)
        x = np.linalg.lstsq(flat, want.ravel(), rcond=None)[0]
        after = float(np.abs(flat @ x - want.ravel()).max(initial=0.0)) / judge.tolerance.length
        shifts: dict[str, float] = {}
        for name, shift in zip(slides, x, strict=False):
            if abs(shift) > judge.tolerance.length:
                shifts[name] = shift
        if after <= 1 and (moved or shifts):
            return _text(moved, shifts, base, tool, x[len(slides) :]), after
    return None


def _text(moved: dict[str, float], shifts: dict[str, float], base: Array, tool: Array, ends: Array) -> str:
    parts: list[str] = []
    for name, turn in moved.items():
        parts.append(f"{name} {_sign(turn)} {abs(np.degrees(turn)):g}°")
    for name, shift in shifts.items():
        parts.append(f"{name} {_sign(shift)} {abs(shift) / MM:.6g} mm")
    text = f"agrees with the mechanism's pose with {', '.join(parts)}"
    if not np.allclose(base, np.eye(3)):
        text += f"; base axes {axes_text(base)}"
    if not np.allclose(tool, np.eye(3)):
        text += f"; tool axes {axes_text(tool.T)}"
    for end, p in zip(("tool", "base"), ends.reshape(-1, 3), strict=False):
        if np.abs(p).max() > 1e-9:
            shift_mm = ", ".join(f"{v:.6g}" for v in p / MM)
            text += f"; {end} moved by ({shift_mm}) mm"
    return text


def _sign(x: float) -> str:
    return "-" if x < 0 else "+"


def axes_text(P: Array) -> str:
    """Return a rotation as text: "x = -y, ..." for quarter turns, otherwise its angle."""
    if np.abs(np.abs(P).max(axis=1) - 1).max() < 1e-6:
        parts: list[str] = []
        for axis, row in zip("xyz", P, strict=True):
            i = int(np.argmax(np.abs(row)))
            minus = "-" if row[i] < 0 else ""
            parts.append(f"{axis} = {minus}{'xyz'[i]}")
        return ", ".join(parts)
    angle = np.degrees(np.arccos(np.clip((np.trace(P) - 1) / 2, -1, 1)))
    return f"turned by {angle:.4f}°"
