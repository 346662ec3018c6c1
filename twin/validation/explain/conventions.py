"""Find conventions under which formula and mechanism agree: Euler angles, units, signs, axes, and others.

Each convention is tried as a whole, because no edit of a single row has the same effect.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations, product

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL
from twin.formula.scalar import Value
from twin.validation.explain.equation_steps import Helper, RowKey, Step
from twin.validation.explain.explanation_data import Convention
from twin.validation.explain.invariants import formula_pose, formula_values
from twin.validation.explain.joint_offsets import axes_text, offsets
from twin.validation.explain.plain_values import enter, leave
from twin.validation.explain.rebuilt_functions import Matrix, to_array, turn
from twin.validation.explain.reference_values import ReferenceValues
from twin.validation.explain.row_deviations import Judge, RowPlace, worst
from twin.validation.explain.suspect_statements import suspects

_ROUNDING = 1e-9
"""Differences, in m or rad, that are rounding."""

_INVERTIBLE = 1e12
"""Condition number of a matrix above which its inverse is mostly rounding."""

_EXACT_ROW = 1e-12
"""Largest difference of two matrices of the same row of a Denavit-Hartenberg table."""

_DH_PROBE = (0.3, 0.7, 1.1, 0.45)
"""Arguments, in m and rad, that show the form of a Denavit-Hartenberg row: they differ, so that only one order fits."""

_NAMED_RATIOS = (
    (-1.0, "sign", "the opposite sign"),
    (1e3, "unit", "millimetres instead of metres"),
    (1e-3, "unit", "metres instead of millimetres"),
    (180 / np.pi, "unit", "degrees instead of radians"),
    (np.pi / 180, "unit", "radians instead of degrees"),
    (1.0, "offset", ""),
)
"""Ratios of a value of the formula and that of the mechanism: (ratio, kind of the convention, what it says)."""


def conventions(judge: Judge, general_conventions: Sequence[Convention] | None = None) -> list[Convention]:
    """Return the conventions that fix rows, sorted by the number of fixed rows, largest first.

    `general_conventions` is the result of `general`; None: it is computed.
    """
    if not judge.failing():
        return []
    with np.errstate(all="ignore"):
        if general_conventions is None:
            general_conventions = general(judge)
        candidates = [*general_conventions, *_scalars(judge)]
        if not candidates:  # a slow search, so only where nothing simpler was found
            candidates = list(offsets(judge))
    return sorted(candidates, key=lambda convention: (-len(convention.rows), convention.after))


def general(judge: Judge) -> list[Convention]:
    """Return the conventions that are not of single rows: angles, units, axes, frames, Denavit-Hartenberg form."""
    with np.errstate(all="ignore"):
        return [*_dh(judge), *_angles_in(judge), *_axes(judge), *_frames(judge), *_euler(judge)]


def _cured(judge: Judge, other_judge: Judge) -> tuple[list[RowPlace], float] | None:
    """Return (rows that are wrong in `judge` and agree in `other_judge`, the worst residual of these rows there).

    Return None if there is no such row, or if a row that agrees in `judge` is wrong in `other_judge`.
    """
    failing = judge.failing()
    worst_by_row: dict[RowKey, float] = {}
    for place, residual in other_judge.residuals.items():
        worst_by_row[place.key] = worst(residual)
    for place in judge.residuals:
        # Helpers have no printed rows of their own: a convention may change what they pass on.
        if place in failing or judge.step(place.equation).stage == "helper":
            continue
        if worst_by_row.get(place.key, np.inf) > 1:
            return None
    cured: list[RowPlace] = []
    largest = 0.0
    for place in failing:
        after = worst_by_row.get(place.key, np.inf)
        if after <= 1:
            cured.append(place)
            largest = max(largest, after)
    if not cured:
        return None
    return cured, largest


def _axis_sequences() -> tuple[str, ...]:
    """Return the twelve sequences of axes of which no two adjacent ones are the same."""
    sequences: list[str] = []
    for first, second, third in product("xyz", repeat=3):
        if first != second and second != third:
            sequences.append(first + second + third)
    return tuple(sequences)


ORDERS = _axis_sequences()
"""The twelve axis sequences of Euler angles."""


@dataclass(frozen=True)
class _EulerConvention:
    """Three rotations about axes; the formula's angles are the rotation angles in another order and with other signs.

    Attributes:
        order: axes of the rotations, such as "zyx".
        transposed: whether the rotations are applied in the opposite order.
        place: index of the rotation whose angle each of the formula's angles is.
        signs: sign of each of the formula's angles.
    """

    order: str
    transposed: bool
    place: tuple[int, ...]
    signs: tuple[float, ...]

    def text(self, angles: Sequence[str]) -> str:
        """Return the product of rotations as text, such as "Rz(psi) Ry(theta) Rx(-phi)"."""
        factors = [""] * 3
        for name, index, sign in zip(angles, self.place, self.signs, strict=True):
            minus = "-" if sign < 0 else ""
            factors[index] = f"R{self.order[index]}({minus}{name})"
        if self.transposed:
            factors.reverse()
        return " ".join(factors)


def _euler_conventions(R: Array) -> Iterator[tuple[_EulerConvention, Array]]:
    """Yield (convention, its angles (k, 3) in rad of the rotations R (k, 3, 3))."""
    for order in ORDERS:
        for transposed in (False, True):
            places: Iterable[tuple[int, ...]]
            if transposed:
                # The same angles, applied in the opposite order: R^T has the opposite signs.
                values = -spatial.euler_angles(np.swapaxes(R, 1, 2), order)
                places = ((0, 1, 2), (2, 1, 0))
            else:
                values = spatial.euler_angles(R, order)
                places = permutations(range(3))
            for place in places:
                for signs in product((1.0, -1.0), repeat=3):
                    yield _EulerConvention(order, transposed, place, signs), values[:, place] * signs


def _euler(judge: Judge) -> Iterator[Convention]:
    """Yield a convention if the rows agree with the mechanism for another Euler sequence, or for other signs."""
    reference = judge.reference
    angles = [name for name, unit in reference.coordinates if unit == "rad"]
    if len(angles) != 3 or not _read(judge, angles):
        return
    wrong: list[RowPlace] = []
    involved: set[str] = set()
    for place in judge.failing():
        if judge.step(place.equation).stage == "inverse":
            wrong.append(place)
            involved.update(suspects(judge, place))
    if not wrong:
        return
    values_of_angles = [reference.symbols[name] for name in angles]
    angle_values = np.column_stack(values_of_angles)
    for convention, values in _euler_conventions(reference.Ts[:, :3, :3]):
        # The sine is also zero for angles that differ by full or half turns: those are the formula's own convention.
        if np.abs(np.sin(values - angle_values)).max() < _ROUNDING:
            continue
        angles_by_name = dict(zip(angles, values.T, strict=True))
        other_values = reference.with_values(angles_by_name)
        # Few equations first: nearly all of the conventions fail there.
        if not _one_agrees(judge.on(other_values, involved), wrong):
            continue
        fix = _cured(judge, judge.on(other_values))
        if fix is None:
            continue
        cured, after = fix
        text = (
            f"the rows agree with the angles of R = {convention.text(angles)}, not with the angles "
            "that the formula's own convention gives"
        )
        yield Convention("euler", text, _names(cured), after)
        return


def _read(judge: Judge, symbols: Sequence[str]) -> bool:
    """Return whether an equation reads one of the symbols."""
    inputs: set[str] = set()
    for step in judge.steps:
        inputs.update(step.inputs)
    return not inputs.isdisjoint(symbols)


def _one_agrees(judge: Judge, places: Sequence[RowPlace]) -> bool:
    """Return whether at least one of some rows agrees in a judge."""
    rows = {place.key for place in places}
    for place, residual in judge.residuals.items():
        if place.key not in rows:
            continue
        if worst(residual) <= 1:
            return True
    return False


def _names(places: Iterable[RowPlace]) -> tuple[str, ...]:
    names = [place.name for place in places]
    return tuple(names)


def _angles_in(judge: Judge) -> Iterator[Convention]:
    """Yield one convention if the rows agree for angles in degrees, and one if they agree for lengths in mm."""
    in_degrees = "the rows expect angles in degrees, but the angles are given in radians"
    in_mm = "the rows expect lengths in millimetres, but the lengths are given in metres"
    failing_names = {place.name for place in judge.failing()}
    for kind, units, factor, text in (
        ("angle", ("deg",), 180 / np.pi, in_degrees),
        ("length", ("mm", "m"), 1e3, in_mm),
    ):
        other_judge = judge.on(_scaled(judge, kind, units, factor))
        cured = _cured_in_unit(judge, other_judge, kind, factor)
        if cured and len(cured) == len(failing_names):
            yield Convention("unit", text, _names(cured), max(cured.values()))


def _scaled(judge: Judge, kind: str, units: Sequence[str], factor: float) -> ReferenceValues:
    """Return the mechanism's values with all angles or all lengths multiplied by a factor."""
    reference = judge.reference
    scaled_parameters: set[str] = set()
    for parameter in judge.formula.parameters:
        if parameter.unit in units:
            scaled_parameters.add(parameter.name)
    symbols = dict(reference.symbols)
    for name, value in reference.symbols.items():
        if reference.kinds.get(name) == kind or name in scaled_parameters:
            symbols[name] = value * factor
    if kind == "length":
        T = reference.symbols[POSE_SYMBOL].a.copy()
        T[:, :3, 3] *= factor
        symbols[POSE_SYMBOL] = Matrix(T)
    return replace(reference, symbols=symbols)


def _cured_in_unit(judge: Judge, other_judge: Judge, kind: str, factor: float) -> dict[RowPlace, float]:
    """Return {row that is wrong in `judge` and agrees in `other_judge`, which has another unit: its residual}."""
    residuals: dict[RowKey, Array] = {}
    for place, residual in other_judge.residuals.items():
        residuals.setdefault(place.key, residual)
    cured: dict[RowPlace, float] = {}
    for place, r in judge.residuals.items():
        if place.key not in residuals or worst(r) <= 1 or judge.reference.kinds[place.symbol] == "pose":
            continue
        residual = residuals[place.key]
        after = worst(residual)
        if judge.reference.kinds[place.symbol] == kind:
            # An output may be in either unit: it must agree in one of them.
            after = min(after, worst(residual / factor))
        if after <= 1:
            cured[place] = after
    return cured


def _scalars(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for rows whose value differs from the mechanism's only by a sign, a unit or a zero offset."""
    reference = judge.reference
    values = formula_values(judge)
    groups: dict[tuple[str, str], list[tuple[RowPlace, float]]] = {}
    for place in judge.failing():
        true = to_array(reference.symbols[place.symbol], reference.k)
        is_constant = np.ptp(true) < _ROUNDING  # any value is then a constant value with an offset
        if place.symbol not in values or true.shape[1] != 1 or is_constant:
            continue
        angle = reference.kinds[place.symbol] == "angle"
        tolerance = judge.tolerance.angle if angle else judge.tolerance.length
        value = np.asarray(values[place.symbol], float)
        for slope, kind, ratio_text in _NAMED_RATIOS:
            offset, after = _offset(value, true[:, 0], slope, angle, tolerance)
            if not after <= 1:  # also for NaN
                continue
            parts: list[str] = []
            if ratio_text:
                parts.append(ratio_text)
            if abs(offset) > tolerance:
                parts.append(_offset_text(offset, slope, angle))
            if parts:
                groups.setdefault((kind, " and ".join(parts)), []).append((place, after))
            break
    for (kind, message), rows in groups.items():
        places: list[RowPlace] = []
        largest = 0.0
        for place, after in rows:
            places.append(place)
            largest = max(largest, after)
        symbols = [place.symbol for place in places]
        yield Convention(kind, f"{', '.join(symbols)}: {message}", _names(places), largest)


def _offset_text(offset: float, slope: float, angle: bool) -> str:
    """Return what a message says of an offset in m or rad of a value with another sign or unit."""
    if angle and abs(slope) != 1:  # full turns of 2 pi are lost, and are no full turns of the formula's unit
        return "its zero position differs from the zero position in the mechanism"
    size = f"{offset * 1e3:.6g} mm"
    if angle:
        size = f"{np.degrees(offset):.6g}°"
    return f"its zero position differs by {size} from the zero position in the mechanism"


def _offset(value: Array, true: Array, slope: float, angle: bool, tolerance: float) -> tuple[float, float]:
    """Return (offset, largest deviation from it / `tolerance`) of values (k,) that are `slope` * `true` + offset.

    The offset is in m or rad, also if the formula has another unit. `formula_values` gives an angle up to full turns of
    2 pi, whatever its unit is; therefore differences of angles are compared without full turns.
    """
    difference = value - slope * true  # in the formula's unit
    if angle:
        middle = float(np.angle(np.mean(np.exp(1j * difference))))
        deviations = _within_half_turn(difference - middle)
    else:
        middle = float(difference.mean())
        deviations = difference - middle
    unit = abs(slope)  # one m or rad in the formula's unit
    return middle / unit, float(np.abs(deviations).max() / unit / tolerance)


def _within_half_turn(angles: Array) -> Array:
    """Return angles in rad without full turns, from -pi to pi."""
    return np.angle(np.exp(1j * angles))


@dataclass(frozen=True)
class _WrongPoint:
    """A named point whose rows are wrong: its values (k, 3) in the formula, and in the mechanism."""

    name: str
    places: list[RowPlace]
    value: Array
    true: Array


def _wrong_points(judge: Judge) -> list[_WrongPoint]:
    """Return the named points with a wrong row, as far as the formula computes all of their coordinates."""
    reference = judge.reference
    values = formula_values(judge)
    failing = judge.failing()
    points: list[_WrongPoint] = []
    for name, symbol in judge.formula.points.items():
        symbols = symbol
        if isinstance(symbol, str):  # one vector, not three coordinates
            symbols = (symbol,)
        places = [place for place in failing if place.symbol in symbols]
        if not places or not values.keys() >= set(symbols):
            continue
        position = _stacked_columns(values, symbols, reference.k)
        true_position = _stacked_columns(reference.symbols, symbols, reference.k)
        points.append(_WrongPoint(name, places, position, true_position))
    return points


def _stacked_columns(values: Mapping[str, Value], symbols: Sequence[str], k: int) -> Array:
    """Return the values of symbols beside each other (k, entries of all)."""
    columns: list[Array] = []
    for symbol in symbols:
        columns.append(to_array(values[symbol], k))
    return np.hstack(columns)


def _axes(judge: Judge) -> Iterator[Convention]:
    """Yield a convention if the named points agree with the mechanism after axes are permuted, mirrored or scaled."""
    points = _wrong_points(judge)
    if not points:
        return
    names: list[str] = []
    places: list[RowPlace] = []
    values_of_points: list[Array] = []
    true_of_points: list[Array] = []
    for point in points:
        names.append(point.name)
        places += point.places
        values_of_points.append(point.value)
        true_of_points.append(point.true)
    value = np.vstack(values_of_points)
    true = np.vstack(true_of_points)
    if not np.isfinite(value).all():
        return
    for permutation in signed_permutations()[1:]:
        for factor, unit in ((1.0, ""), (1e3, ", in millimetres")):
            largest = np.abs(value - factor * true @ permutation.T).max()
            after = float(largest / factor / judge.tolerance.length)
            if after > 1:
                continue
            kind = "axes"
            handedness = ""
            if np.linalg.det(permutation) < 0:
                kind = "handedness"
                handedness = ": a left-handed frame"
            text = f"points {', '.join(names)} use other axes{handedness}: {axes_text(permutation)}{unit}"
            yield Convention(kind, text, _names(places), after)
            return


def signed_permutations() -> list[Array]:
    """Return the 48 signed permutation matrices (3, 3), the identity first."""
    matrices: list[Array] = []
    for order in permutations(range(3)):
        permutation = np.eye(3)[list(order)]
        for signs in product((1.0, -1.0), repeat=3):
            matrices.append(permutation * np.array(signs)[:, None])
    return matrices


def _frames(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for each pose that agrees after an inversion, or after constant rotations of base and tool."""
    for place in judge.failing():
        if judge.reference.kinds[place.symbol] != "pose":
            continue
        T = formula_pose(judge, place)
        if not np.isfinite(T).all():
            continue
        change = _other_frames(judge, judge.reference.symbols[place.symbol].a, T)
        if change is not None:
            text, after = change
            message = f"{place.symbol} of {place.equation} agrees with the mechanism's pose: {text}"
            yield Convention("axes", message, (place.name,), after)


def _other_frames(judge: Judge, true: Array, T: Array) -> tuple[str, float] | None:
    """Return (change of a pose T (k, 4, 4) with which it agrees, residual); the change with the shortest text."""
    inverse = T
    if np.linalg.cond(T).max() < _INVERTIBLE:
        inverse = np.linalg.inv(T)
    best: tuple[str, float] | None = None
    # Inversion, unit and base axes are tried; what is left must be one rotation of the tool, the same at all poses.
    for inversion, M in (("", T), ("inverted, ", inverse)):
        for unit, factor in (("", 1.0), ("its lengths in millimetres, ", 1e-3)):
            p = M[:, :3, 3] * factor
            for P in signed_permutations():
                position = float(np.abs(p @ P.T - true[:, :3, 3]).max() / judge.tolerance.length)
                if position > 1:
                    continue
                R_tool = np.swapaxes(P @ M[:, :3, :3], 1, 2) @ true[:, :3, :3]
                rotation = float(np.abs(R_tool - R_tool.mean(axis=0)).max() / judge.tolerance.angle)
                if not rotation <= 1:
                    continue
                text = f"{inversion}{unit}"
                if not np.allclose(P, np.eye(3)):
                    text += f"base axes {axes_text(P)}, "
                if not np.allclose(R_tool[0], np.eye(3)):
                    text += f"tool axes {axes_text(R_tool[0].T)}, "
                text = text.removesuffix(", ")
                if best is None or len(text) < len(best[0]):
                    best = text, max(position, rotation)
    return best


def _dh(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for each helper that makes rows agree if it uses the other Denavit-Hartenberg form."""
    failing = {place.equation for place in judge.failing()}
    for step in judge.steps:
        if step.equation.name not in failing or step.stage == "helper":
            continue
        for helper in judge.helpers(step):
            for stand_in, message in _other_forms(helper):
                fix = _with_helper(judge, step, helper, stand_in)
                if fix is not None:
                    cured, after = fix
                    yield Convention("dh", message, _names(cured), after)
                    break


def _other_forms(helper: Helper) -> Iterator[tuple[Callable[..., Value], str]]:
    """Yield (function in the other form, message) for a helper that returns poses."""
    name = helper.source.name
    function = helper.function
    form = dh_form(function)
    if form is not None:
        kind, order = form
        other_form = "standard" if kind == "modified" else "modified"
        text = f"{name}() multiplies rows in {kind} Denavit-Hartenberg form; the table has the {other_form} form"
        yield partial(_dh_row, other_form, order), text
        return
    swap = "moves first and then rotates, as in modified Denavit-Hartenberg form; the rows agree if it rotates first"
    yield partial(_swapped, function, False), f"{name}() {swap} (standard form): swap rotation and translation"
    swap = "rotates first and then moves, as in standard Denavit-Hartenberg form; the rows agree if it moves first"
    yield partial(_swapped, function, True), f"{name}() {swap} (modified form): swap rotation and translation"


def _with_helper(
    judge: Judge, step: Step, helper: Helper, stand_in: Callable[..., Value]
) -> tuple[list[RowPlace], float] | None:
    """Return the result of `_cured` if a function replaces a helper of an equation."""
    scopes = [step.scope, helper.function.__globals__]
    for called in judge.helpers(step):
        scopes.append(called.function.__globals__)
    replaced: list[tuple[dict[str, Value], str]] = []
    for scope in scopes:
        for name, value in list(scope.items()):
            if value is helper.function:
                replaced.append((scope, name))
                scope[name] = stand_in
    try:
        return _cured(judge, judge.on(judge.reference))
    finally:
        for scope, name in replaced:
            scope[name] = helper.function


def _swapped(function: Callable[..., Value], back: bool, *values: Value) -> Value:
    """Return the pose Rot Trans instead of Trans Rot of a function; `back`: Trans Rot instead of Rot Trans.

    Raises:
        TypeError: the function returns no poses (4, 4).
    """
    value = function(*values)
    pose = leave(value)
    if not isinstance(pose, Matrix) or pose.shape != (4, 4):
        raise TypeError("no pose")
    T = pose.a.copy()
    R = T[:, :3, :3]
    if back:
        R = np.swapaxes(R, 1, 2)
    T[:, :3, 3] = (R @ T[:, :3, 3:])[..., 0]
    if isinstance(value, Matrix):
        return Matrix(T)
    return enter(Matrix(T))


def _dh_row(form: str, order: tuple[int, ...], *values: Value) -> Matrix:
    """Return the matrix of one row of a Denavit-Hartenberg table.

    `form` is "standard" or "modified"; `order` gives the positions of alpha, a, theta and d in `values`.
    """
    columns: list[Array] = []
    for i in order:
        columns.append(np.atleast_1d(np.asarray(values[i], float)))
    alpha, a, theta, d = np.broadcast_arrays(*columns)
    about_x = _screw(turn(0)(alpha).a, 0, a)
    about_z = _screw(turn(2)(theta).a, 2, d)
    if form == "modified":
        return Matrix(about_x @ about_z)
    return Matrix(about_z @ about_x)


def _screw(R: Array, axis: int, distance: Array) -> Array:
    """Return the poses (k, 4, 4) of rotations R (k, 3, 3) with translations (k,) along an axis."""
    T = np.tile(np.eye(4), (len(R), 1, 1))
    T[:, :3, :3] = R
    T[:, axis, 3] = distance
    return T


def dh_form(function: Callable[..., Value]) -> tuple[str, tuple[int, ...]] | None:
    """Return ("standard" or "modified", positions of the arguments alpha, a, theta, d) of a Denavit-Hartenberg row.

    None if the function does not compute such a row.
    """
    if inspect.unwrap(function).__code__.co_argcount != 4:  # type: ignore[attr-defined]
        return None
    try:
        T = function(*_DH_PROBE)
    except Exception:
        return None
    if not isinstance(T, Matrix) or T.shape != (4, 4):
        return None
    for kind in ("modified", "standard"):
        for order in permutations(range(4)):
            row = _dh_row(kind, order, *_DH_PROBE)
            if np.abs(row.a - T.a).max() < _EXACT_ROW:
                return kind, order
    return None
