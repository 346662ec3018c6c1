"""Find changes of a wrong tool pose of the formula with which it agrees with the mechanism: frames, and joint offsets.

Frames (`pose_frames`): the pose is inverted, in millimetres, or has constant rotations of base and tool.

Joint offsets (`joint_offsets`): a Denavit-Hartenberg table without them cannot be corrected by an edit of one row. They
are accepted if, with them and with constant rotations of base and tool, the pose agrees with the mechanism. An offset
of the first or last angle is equivalent to a rotation of base or tool. For the other angles, quarter turns of up to
three angles are tried. Offsets of lengths are computed by least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice, permutations, product

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.validation.explain.explanation_data import Convention
from twin.validation.explain.invariants import formula_pose
from twin.validation.explain.row_deviations import Judge, RowPlace

_LARGEST_CONDITION_NUMBER = 1e12
"""Condition number of a matrix above which its inverse is mostly rounding."""

_QUARTER_TURNS = (np.pi / 2, -np.pi / 2, np.pi)
"""Offsets in rad that are tried for each angle."""

_MOST_OFFSETS = 3
"""Maximum number of angles with an offset."""

_MOST_TRIALS = 400
"""Maximum number of choices of offsets that are tried: each is an evaluation of the forward equations."""

_UNIQUENESS_FACTOR = 1e3
"""The rotations are unique if the second smallest mean squared residual is so many times `_AGREEING_SQUARE`."""

_SLIDE_STEP = 0.1
"""Change of a sliding joint in m, with which the direction is computed in which it moves the tool."""

_LEAST_SHOWN_SHIFT = 1e-9
"""Shift of base or tool in m that is not told: it is rounding."""

_AXIS_ROUNDING = 1e-6
"""Difference from 1 up to which an entry of a rotation makes an axis one of the other frame."""

_AGREEING_SQUARE = 1e-9
"""Mean squared rotation residual below which the rotations agree."""


def signed_permutations() -> list[Array]:
    """Return the 48 signed permutation matrices (3, 3), the identity first."""
    matrices: list[Array] = []
    for order in permutations(range(3)):
        permutation = np.eye(3)[list(order)]
        for signs in product((1.0, -1.0), repeat=3):
            matrices.append(permutation * np.array(signs)[:, None])
    return matrices


def pose_frames(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for each pose that agrees after an inversion, or after constant rotations of base and tool."""
    for place in judge.failing():
        if judge.reference.kinds[place.symbol] != "pose":
            continue
        T = formula_pose(judge, place)
        if not np.isfinite(T).all():
            continue
        change = _agreeing_frames(judge, judge.reference.symbols[place.symbol].a, T)
        if change is not None:
            text, residual = change
            message = f"{place.symbol} of {place.equation} agrees with the mechanism's pose: {text}"
            yield Convention("axes", message, (place.name,), residual)


def _agreeing_frames(judge: Judge, true_T: Array, T: Array) -> tuple[str, float] | None:
    """Return (change of a pose T (k, 4, 4) with which it agrees, residual); the change with the shortest text."""
    inverse = T
    if np.linalg.cond(T).max() < _LARGEST_CONDITION_NUMBER:
        inverse = np.linalg.inv(T)
    true_p = true_T[:, :3, 3]
    true_R = true_T[:, :3, :3]
    best: tuple[str, float] | None = None
    # Inversion, unit and base axes are tried; what is left must be one rotation of the tool, the same at all poses.
    for inversion_text, T_tried in (("", T), ("inverted, ", inverse)):
        for unit_text, factor in (("", 1.0), ("its lengths in millimetres, ", 1e-3)):
            p = T_tried[:, :3, 3] * factor
            for R_base in signed_permutations():
                position_residual = float(np.abs(p @ R_base.T - true_p).max() / judge.tolerance.length)
                if position_residual > 1:
                    continue
                R_tool = np.swapaxes(R_base @ T_tried[:, :3, :3], 1, 2) @ true_R
                rotation_residual = float(np.abs(R_tool - R_tool.mean(axis=0)).max() / judge.tolerance.angle)
                if not rotation_residual <= 1:
                    continue
                text = f"{inversion_text}{unit_text}"
                if not np.allclose(R_base, np.eye(3)):
                    text += f"base axes {axes_text(R_base)}, "
                if not np.allclose(R_tool[0], np.eye(3)):
                    text += f"tool axes {axes_text(R_tool[0].T)}, "
                text = text.removesuffix(", ")
                if best is None or len(text) < len(best[0]):
                    best = text, max(position_residual, rotation_residual)
    return best


def joint_offsets(judge: Judge) -> Iterator[Convention]:
    """Yield, for each wrong forward equation, the smallest set of joint offsets with which the pose agrees."""
    for place in judge.failing():
        step = judge.step(place.equation)
        if step.stage != "forward" or judge.reference.kinds[place.symbol] != "pose":
            continue
        fit = _first_agreeing_offsets(judge, place)
        if fit is not None:
            text, after = fit
            yield Convention("offset", f"{place.symbol} of {place.equation} {text}", (place.name,), after)


def _first_agreeing_offsets(judge: Judge, place: RowPlace) -> tuple[str, float] | None:
    """Return (text on the offsets, worst residual) of the first offsets with which the pose agrees, fewest first."""
    joints = [joint for joint in judge.formula.joints if joint.name in judge.reference.symbols]
    angles: list[str] = []
    slides: list[str] = []
    for i, joint in enumerate(joints):
        is_inner = 0 < i < len(joints) - 1  # an offset of the first or last angle is a rotation of base or tool
        if joint.kind == "prismatic":
            slides.append(joint.name)
        elif joint.kind == "revolute" and is_inner:
            angles.append(joint.name)
    true = judge.reference.symbols[place.symbol].a
    for turns in islice(_quarter_turns(angles), _MOST_TRIALS):
        T = _pose_with_offsets(judge, place, turns)
        if T is None:
            return None
        ends = _end_rotations(T[:, :3, :3], true[:, :3, :3])
        if ends is None:
            continue
        base, tool = ends
        fit = _fitted_positions(judge, place, turns, slides, T, base, tool)
        if fit is not None:
            return fit
    return None


def _quarter_turns(angles: Sequence[str]) -> Iterator[dict[str, float]]:
    """Yield offsets in rad by name: quarter turns of no angle, of each angle, and of several angles."""
    for count in range(_MOST_OFFSETS + 1):
        for chosen in combinations(angles, count):
            for turns in product(_QUARTER_TURNS, repeat=count):
                yield dict(zip(chosen, turns, strict=True))


def _pose_with_offsets(judge: Judge, place: RowPlace, offsets: dict[str, float]) -> Array | None:
    """Return the formula's pose (k, 4, 4) with offsets of joints, in rad or m; None if the pose has no value."""
    symbols = dict(judge.reference.symbols)
    for name, offset in offsets.items():
        symbols[name] = symbols[name] + offset
    forward: set[str] = set()
    for step in judge.steps:
        if step.stage == "forward":
            forward.add(step.equation.name)
    judge_with_offsets = judge.on(judge.reference.with_values(symbols), forward)
    for other_place in judge_with_offsets.residuals:
        if other_place.key != place.key:
            continue
        T = formula_pose(judge_with_offsets, other_place)
        if np.isfinite(T).all():
            return T
        return None
    return None


def _end_rotations(R_formula: Array, R_mechanism: Array) -> tuple[Array, Array] | None:
    """Return rotations of base and tool (3, 3) with R = base F tool at all poses (k, 3, 3); None if there are none.

    base^T R - F tool = 0 is linear in the unknowns base and tool; the solution must be unique up to a factor.
    """
    eye = np.eye(3)
    blocks: list[Array] = []
    for f, r in zip(R_formula, R_mechanism, strict=True):
        # vec(base^T r) and vec(f tool), with the entries of a matrix row by row
        of_base = np.kron(eye, r.T)
        of_tool = np.kron(f, eye)
        blocks.append(np.hstack([of_base, -of_tool]))
    A = np.stack(blocks)
    mean_squares = np.einsum("kij,kil->jl", A, A) / len(A)
    squares, V = np.linalg.eigh(mean_squares)  # the smallest first
    if squares[0] > _AGREEING_SQUARE or squares[1] < _UNIQUENESS_FACTOR * _AGREEING_SQUARE:
        return None
    base_T = V[:9, 0].reshape(3, 3)
    tool = V[9:, 0].reshape(3, 3)
    scale = np.cbrt(np.linalg.det(base_T))  # the eigenvector has any length; a rotation has determinant 1
    return (base_T / scale).T, tool / scale


def _fitted_positions(
    judge: Judge, place: RowPlace, turns: dict[str, float], slides: list[str], T: Array, base: Array, tool: Array
) -> tuple[str, float] | None:
    """Return (text on the offsets, worst residual) if, with the rotations, the positions also agree; otherwise None.

    `turns` are the offsets of angles in rad, T (k, 4, 4) the formula's poses with them, `slides` the sliding joints,
    `base` and `tool` rotations (3, 3).
    """
    true = judge.reference.symbols[place.symbol].a
    missing = true[:, :3, 3] @ base - T[:, :3, 3]
    slopes: list[Array] = []  # change of the position (k, 3) with the value of each sliding joint
    for name in slides:
        T_moved = _pose_with_offsets(judge, place, {**turns, name: _SLIDE_STEP})
        if T_moved is None:
            return None
        slopes.append((T_moved[:, :3, 3] - T[:, :3, 3]) / _SLIDE_STEP)
    of_slides = np.zeros((*missing.shape, 0))
    if slopes:
        of_slides = np.stack(slopes, axis=2)
    R = T[:, :3, :3]
    of_tool = R  # a shift of the tool is turned with it, one of the base is not
    of_base = np.broadcast_to(np.eye(3), R.shape)
    of_all = np.concatenate([of_slides, of_tool, of_base], axis=2)
    # Offsets of the joints alone first, then also shifts of tool and base.
    for A in (of_slides, of_all):
        flat = A.reshape(missing.size, -1)
        x, *_ = np.linalg.lstsq(flat, missing.ravel(), rcond=None)
        after = float(np.abs(flat @ x - missing.ravel()).max(initial=0.0)) / judge.tolerance.length
        shifts: dict[str, float] = {}
        for name, shift in zip(slides, x, strict=False):
            if abs(shift) > judge.tolerance.length:
                shifts[name] = shift
        if after <= 1 and (turns or shifts):
            return _offsets_text(turns, shifts, base, tool, x[len(slides) :]), after
    return None


def _offsets_text(
    turns: dict[str, float], shifts: dict[str, float], base: Array, tool: Array, end_shifts: Array
) -> str:
    """Return the offsets of joints, and rotations and shifts of base and tool, as text.

    `end_shifts` are the shifts of tool and base in m, three numbers each; none without them.
    """
    offsets: list[str] = []
    for name, turn in turns.items():
        offsets.append(f"{name} {_sign_text(turn)} {abs(np.degrees(turn)):g}°")
    for name, shift in shifts.items():
        offsets.append(f"{name} {_sign_text(shift)} {abs(shift) / MM:.6g} mm")
    text = f"agrees with the mechanism's pose with {', '.join(offsets)}"
    if not np.allclose(base, np.eye(3)):
        text += f"; base axes {axes_text(base)}"
    if not np.allclose(tool, np.eye(3)):
        text += f"; tool axes {axes_text(tool.T)}"
    for end, p in zip(("tool", "base"), end_shifts.reshape(-1, 3), strict=False):
        if np.abs(p).max() > _LEAST_SHOWN_SHIFT:
            x, y, z = p / MM
            text += f"; {end} moved by ({x:.6g}, {y:.6g}, {z:.6g}) mm"
    return text


def _sign_text(x: float) -> str:
    return "-" if x < 0 else "+"


def axes_text(R: Array) -> str:
    """Return a rotation as text: "x = -y, ..." for quarter turns, otherwise its angle."""
    if np.abs(np.abs(R).max(axis=1) - 1).max() < _AXIS_ROUNDING:
        parts: list[str] = []
        for axis, row in zip("xyz", R, strict=True):
            i = int(np.argmax(np.abs(row)))
            minus = "-" if row[i] < 0 else ""
            parts.append(f"{axis} = {minus}{'xyz'[i]}")
        return ", ".join(parts)
    cosine = (np.trace(R) - 1) / 2
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return f"turned by {angle:.4f}°"
