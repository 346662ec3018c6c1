"""Find conventions under which formula and mechanism agree: Euler angles, units, signs, axes, and others.

Each convention is tried as a whole, because no edit of a single row has the same effect. Here are those of values:
Euler angles, units, signs, zeros, and axes of points. Those of poses are in `pose_conventions`, those of functions in
`denavit_hartenberg`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.formula.contract import POSE_SYMBOL
from twin.formula.scalar import Value
from twin.validation.explain.convention_rows import FixedRows, any_row_agrees, row_names, rows_fixed_by
from twin.validation.explain.denavit_hartenberg import denavit_hartenberg_forms
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.explanation_data import Convention
from twin.validation.explain.invariants import formula_values
from twin.validation.explain.pose_conventions import axes_text, joint_offsets, pose_frames, signed_permutations
from twin.validation.explain.rebuilt_functions import Matrix, to_array
from twin.validation.explain.reference_values import ReferenceValues
from twin.validation.explain.row_deviations import Judge, RowPlace, worst
from twin.validation.explain.suspect_statements import suspects

_VALUE_ROUNDING = 1e-9
"""Differences, in m or rad, that are rounding."""

_NAMED_RATIOS = (
    (-1.0, "sign", "the opposite sign"),
    (1e3, "unit", "millimetres instead of metres"),
    (1e-3, "unit", "metres instead of millimetres"),
    (180 / np.pi, "unit", "degrees instead of radians"),
    (np.pi / 180, "unit", "radians instead of degrees"),
    (1.0, "offset", ""),
)
"""Ratios of a value of the formula and that of the mechanism: (ratio, kind of the convention, what it says)."""


@np.errstate(all="ignore")  # a wrong convention may take a root or a quotient that does not exist: it is then NaN
def conventions(judge: Judge, general_conventions: Sequence[Convention] | None = None) -> list[Convention]:
    """Return the conventions that fix rows, sorted by the number of fixed rows, largest first.

    `general_conventions` is the result of `conventions_of_all_rows`; None: it is computed.
    """
    if not judge.failing():
        return []
    if general_conventions is None:
        general_conventions = conventions_of_all_rows(judge)
    found = [*general_conventions, *_scalar_outputs(judge)]
    if not found:  # a slow search, so only where nothing simpler was found
        found = list(joint_offsets(judge))
    return sorted(found, key=lambda convention: (-len(convention.rows), convention.after))


@np.errstate(all="ignore")  # as in `conventions`
def conventions_of_all_rows(judge: Judge) -> list[Convention]:
    """Return the conventions that are not of single rows: angles, units, axes, frames, Denavit-Hartenberg form."""
    return [
        *denavit_hartenberg_forms(judge),
        *_input_units(judge),
        *_point_axes(judge),
        *pose_frames(judge),
        *_euler_angles(judge),
    ]


def _axis_sequences() -> tuple[str, ...]:
    """Return the twelve sequences of axes of which no two adjacent ones are the same."""
    sequences: list[str] = []
    for first, second, third in product("xyz", repeat=3):
        if first != second and second != third:
            sequences.append(first + second + third)
    return tuple(sequences)


AXIS_SEQUENCES = _axis_sequences()
"""The twelve axis sequences of Euler angles."""


@dataclass(frozen=True)
class _EulerConvention:
    """Three rotations about axes; the formula's angles are the rotation angles in another order and with other signs.

    Attributes:
        order: axes of the rotations, such as "zyx".
        transposed: whether the rotations are applied in the opposite order.
        rotations: index of the rotation whose angle each of the formula's angles is.
        signs: sign of each of the formula's angles.
    """

    order: str
    transposed: bool
    rotations: tuple[int, ...]
    signs: tuple[float, ...]

    def text(self, angles: Sequence[str]) -> str:
        """Return the product of rotations as text, such as "Rz(psi) Ry(theta) Rx(-phi)"."""
        factors = [""] * 3
        for name, index, sign in zip(angles, self.rotations, self.signs, strict=True):
            minus = "-" if sign < 0 else ""
            factors[index] = f"R{self.order[index]}({minus}{name})"
        if self.transposed:
            factors.reverse()
        return " ".join(factors)


def _euler_conventions(R: Array) -> Iterator[tuple[_EulerConvention, Array]]:
    """Yield (convention, its angles (k, 3) in rad of the rotations R (k, 3, 3))."""
    for order in AXIS_SEQUENCES:
        for transposed in (False, True):
            assignments: Iterable[tuple[int, ...]]
            if transposed:
                # The same angles, applied in the opposite order: R^T has the opposite signs.
                rotation_angles = -spatial.euler_angles(np.swapaxes(R, 1, 2), order)
                assignments = ((0, 1, 2), (2, 1, 0))
            else:
                rotation_angles = spatial.euler_angles(R, order)
                assignments = permutations(range(3))
            for rotations in assignments:
                for signs in product((1.0, -1.0), repeat=3):
                    angles = rotation_angles[:, rotations] * signs
                    yield _EulerConvention(order, transposed, rotations, signs), angles


def _euler_angles(judge: Judge) -> Iterator[Convention]:
    """Yield a convention if the rows agree with the mechanism for another Euler sequence, or for other signs."""
    reference = judge.reference
    names = [name for name, unit in reference.coordinates if unit == "rad"]
    if len(names) != 3 or not _is_any_input(judge, names):
        return
    wrong: list[RowPlace] = []
    suspected_equations: set[str] = set()
    for place in judge.failing():
        if judge.step(place.equation).stage == "inverse":
            wrong.append(place)
            suspected_equations.update(suspects(judge, place))
    if not wrong:
        return
    own_angles = np.column_stack([reference.symbols[name] for name in names])
    for convention, angles in _euler_conventions(reference.Ts[:, :3, :3]):
        # The sine is also zero for angles that differ by full or half turns: those are the formula's own convention.
        if np.abs(np.sin(angles - own_angles)).max() < _VALUE_ROUNDING:
            continue
        angles_by_name = dict(zip(names, angles.T, strict=True))
        other_reference = reference.with_values(angles_by_name)
        # Few equations first: nearly all of the conventions fail there.
        if not any_row_agrees(judge.on(other_reference, suspected_equations), wrong):
            continue
        fixed_rows = rows_fixed_by(judge, judge.on(other_reference))
        if fixed_rows is None:
            continue
        message = (
            f"the rows agree with the angles of R = {convention.text(names)}, not with the angles "
            "that the formula's own convention gives"
        )
        yield fixed_rows.convention("euler", message)
        return


def _is_any_input(judge: Judge, symbols: Sequence[str]) -> bool:
    """Return whether an equation has one of the symbols as an input."""
    inputs: set[str] = set()
    for step in judge.steps:
        inputs.update(step.inputs)
    return not inputs.isdisjoint(symbols)


def _input_units(judge: Judge) -> Iterator[Convention]:
    """Yield one convention if the rows agree for angles in degrees, and one if they agree for lengths in mm."""
    in_degrees = "the rows expect angles in degrees, but the angles are given in radians"
    in_mm = "the rows expect lengths in millimetres, but the lengths are given in metres"
    failing_names = {place.name for place in judge.failing()}
    for kind, units, factor, message in (
        ("angle", ("deg",), 180 / np.pi, in_degrees),
        ("length", ("mm", "m"), 1e3, in_mm),
    ):
        other_judge = judge.on(_with_scaled_values(judge, kind, units, factor))
        residuals = _residuals_in_unit(judge, other_judge, kind, factor)
        if residuals and len(residuals) == len(failing_names):
            yield Convention("unit", message, row_names(residuals), max(residuals.values()))


def _with_scaled_values(judge: Judge, kind: str, units: Sequence[str], factor: float) -> ReferenceValues:
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


def _residuals_in_unit(judge: Judge, other_judge: Judge, kind: str, factor: float) -> dict[RowPlace, float]:
    """Return {row that is wrong in `judge` and agrees in `other_judge`, which has another unit: its residual}."""
    other_residuals: dict[RowKey, Array] = {}
    for place, residual in other_judge.residuals.items():
        other_residuals.setdefault(place.key, residual)
    fixed: dict[RowPlace, float] = {}
    for place, residual in judge.residuals.items():
        if place.key not in other_residuals or worst(residual) <= 1 or judge.reference.kinds[place.symbol] == "pose":
            continue
        other_residual = other_residuals[place.key]
        largest = worst(other_residual)
        if judge.reference.kinds[place.symbol] == kind:
            # An output may be in either unit: it must agree in one of them.
            largest = min(largest, worst(other_residual / factor))
        if largest <= 1:
            fixed[place] = largest
    return fixed


def _scalar_outputs(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for rows whose value differs from the mechanism's only by a sign, a unit or a zero offset."""
    reference = judge.reference
    values = formula_values(judge)
    fixed_rows: dict[tuple[str, str], FixedRows] = {}  # by kind and text of the convention
    for place in judge.failing():
        true_value = to_array(reference.symbols[place.symbol], reference.k)
        is_constant = np.ptp(true_value) < _VALUE_ROUNDING  # any value is then a constant value with an offset
        if place.symbol not in values or true_value.shape[1] != 1 or is_constant:
            continue
        is_angle = reference.kinds[place.symbol] == "angle"
        tolerance = judge.tolerance.angle if is_angle else judge.tolerance.length
        value = np.asarray(values[place.symbol], float)
        for ratio, kind, ratio_text in _NAMED_RATIOS:
            offset, residual = _offset_and_residual(value, true_value[:, 0], ratio, is_angle, tolerance)
            if not residual <= 1:  # also for NaN
                continue
            parts: list[str] = []
            if ratio_text:
                parts.append(ratio_text)
            if abs(offset) > tolerance:
                parts.append(_offset_text(offset, ratio, is_angle))
            if parts:
                key = (kind, " and ".join(parts))
                before = fixed_rows.get(key, FixedRows([], 0.0))
                fixed_rows[key] = FixedRows([*before.places, place], max(before.residual, residual))
            break
    for (kind, text), rows in fixed_rows.items():
        symbols = ", ".join(place.symbol for place in rows.places)
        yield rows.convention(kind, f"{symbols}: {text}")


def _offset_text(offset: float, ratio: float, is_angle: bool) -> str:
    """Return what a message says of an offset in m or rad of a value with another sign or unit."""
    if is_angle and abs(ratio) != 1:  # full turns of 2 pi are lost, and are no full turns of the formula's unit
        return "its zero position differs from the zero position in the mechanism"
    size = f"{offset * 1e3:.6g} mm"
    if is_angle:
        size = f"{np.degrees(offset):.6g}°"
    return f"its zero position differs by {size} from the zero position in the mechanism"


def _offset_and_residual(
    value: Array, true_value: Array, ratio: float, is_angle: bool, tolerance: float
) -> tuple[float, float]:
    """Return (offset, residual) of values (k,) that should be `ratio` * `true_value` + offset.

    The offset is in m or rad, also if the formula has another unit; the residual is the largest deviation in units of
    the tolerance. `formula_values` gives an angle up to full turns of 2 pi, whatever its unit is; therefore differences
    of angles are compared without full turns.
    """
    difference = value - ratio * true_value  # in the formula's unit
    if is_angle:
        mean = float(np.angle(np.mean(np.exp(1j * difference))))
        deviations = _within_half_turn(difference - mean)
    else:
        mean = float(difference.mean())
        deviations = difference - mean
    unit = abs(ratio)  # one m or rad in the formula's unit
    return mean / unit, float(np.abs(deviations).max() / unit / tolerance)


def _within_half_turn(angles: Array) -> Array:
    """Return angles in rad without full turns, from -pi to pi."""
    return np.angle(np.exp(1j * angles))


@dataclass(frozen=True)
class _WrongPoint:
    """A named point whose rows are wrong: its positions (k, 3) in m in the formula, and in the mechanism."""

    name: str
    places: list[RowPlace]
    position: Array
    true_position: Array


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


def _point_axes(judge: Judge) -> Iterator[Convention]:
    """Yield a convention if the named points agree with the mechanism after axes are permuted, mirrored or scaled."""
    points = _wrong_points(judge)
    if not points:
        return
    names: list[str] = []
    places: list[RowPlace] = []
    for point in points:
        names.append(point.name)
        places += point.places
    positions = np.vstack([point.position for point in points])
    true_positions = np.vstack([point.true_position for point in points])
    if not np.isfinite(positions).all():
        return
    for permutation in signed_permutations()[1:]:
        for factor, unit_text in ((1.0, ""), (1e3, ", in millimetres")):
            deviation = np.abs(positions - factor * true_positions @ permutation.T).max()
            residual = float(deviation / factor / judge.tolerance.length)
            if residual > 1:
                continue
            kind = "axes"
            handedness = ""
            if np.linalg.det(permutation) < 0:
                kind = "handedness"
                handedness = ": a left-handed frame"
            message = f"points {', '.join(names)} use other axes{handedness}: {axes_text(permutation)}{unit_text}"
            yield Convention(kind, message, row_names(places), residual)
            return
