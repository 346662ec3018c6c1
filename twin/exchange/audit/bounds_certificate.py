"""Audit a certificate of `twin prove --bounds`: both sides are evaluated at random joint values, without the prover.

A bound is never exceeded: one state beyond it refutes the certificate. `docs/check_bounds.py` proves the bound again.
The certificate is a JSON object with these entries, lengths in m and angles in rad:

    variables     {name, angle: whether it is an angle, low, high: range of a length}
    sides         two poses of the tool, of equations or of a mechanism:
      equations   {rows: operations, joints: {joint: number of a row}, pose: 3 rows of 4 numbers of rows}
      mechanism   {chain: [step, ...]}
      step        ["frame" or "inverse", 3 rows of a pose] or ["turn" or "slide", variable]
      row         ["number", value], ["variable", name], or [operation, number of a row before it, ...]
    position_m, rotation_rad    the bounds of the differences of the two poses
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.core.json_types import JsonMapping
from twin.exchange.audit.ledger import Ledger

Array = NDArray[np.float64]

_Row = Sequence[Any]
"""A row of equations, or a step of a chain, as JSON has it: its kind and what it is about."""

SCHEMA = "twin/bounds-certificate/1"

STATES = 4096
"""Number of random states."""

_ROUNDING = 1e-12
"""Rounding error in m and rad of the evaluated differences; poses are products of up to 40 frames."""

_SHARE_AT_ENDS = 0.5
"""Share of the states at which each length has its lowest or highest value."""


def audit_bounds(data: JsonMapping, ledger: Ledger) -> None:
    """Add a row for each bound, and a finding for each that is exceeded.

    Raises:
        ValueError, KeyError, TypeError, IndexError: the certificate was changed.
    """
    variable_values = _random_values(data["variables"])
    if len(variable_values) != len(data["variables"]):
        raise ValueError("two variables have one name")
    poses = []
    for side in data["sides"]:
        if "rows" in side:
            with np.errstate(all="ignore"):  # what is not a number exceeds the bound
                row_values = _row_values(side["rows"], variable_values)
            shared = sorted(variable_values.keys() & side["joints"].keys())
            if shared:
                raise ValueError(f"a side gives a value to {', '.join(shared)}, which is a variable")
            # A later side may be a chain of joints, whose values are those that these equations give.
            for name, row_number in side["joints"].items():
                variable_values[name] = _row_value(row_values, row_number)
            poses.append(_poses_of_rows(side["pose"], row_values))
        else:
            poses.append(_chain_poses(side["chain"], variable_values))
    first, second = poses
    if first.shape != (STATES, 3, 4) or second.shape != (STATES, 3, 4):
        raise ValueError("a pose has not 3 rows of 4 numbers")
    distance = np.linalg.norm(first[:, :, 3] - second[:, :, 3], axis=1)
    # the norm of the difference of two rotations is 2 sqrt(2) sin(angle / 2)
    sine = np.linalg.norm(first[:, :, :3] - second[:, :, :3], axis=(1, 2)) / (2 * np.sqrt(2))
    angle = 2 * np.arcsin(np.minimum(sine, 1.0))
    for description, unit, differences, claimed in (
        ("origins of the tool", "m", distance, float(data["position_m"])),
        ("orientations of the tool", "rad", angle, float(data["rotation_rad"])),
    ):
        largest = float(differences.max())
        ledger.row("bound", largest, unit, claimed, where=description)
        # Written with `not`, so that a difference that is not a number exceeds the bound as well.
        if not largest <= claimed + _ROUNDING:
            text = (
                f"the {description} differ by {largest:.6g} {unit} at a state, more than the bound {claimed:.6g} {unit}"
            )
            ledger.wrong("certificate.wrong", text, description)
    ranges = []
    for variable in data["variables"]:
        if not variable["angle"]:
            ranges.append(f"{variable['name']} {variable['low']:g} to {variable['high']:g} m")
    text = f"{STATES} random states were compared, which proves no bound; docs/check_bounds.py proves it again"
    if ranges:
        text += f". The ranges of lengths are those of the certificate: {', '.join(ranges)}"
    ledger.add("certificate.samples", "info", text)


def _random_values(variables: Sequence[JsonMapping]) -> dict[str, Array]:
    """Return {variable: values (k,)} in m and rad; half of the lengths are at an end of their range."""
    generator = np.random.default_rng()  # no state that the author of a certificate could foresee
    variable_values = {}
    for variable in variables:
        if variable["angle"]:
            variable_values[variable["name"]] = generator.uniform(-np.pi, np.pi, STATES)
            continue
        low, high = float(variable["low"]), float(variable["high"])
        if not -np.inf < low <= high < np.inf:
            raise ValueError(f"the range of {variable['name']} is {low} to {high}")
        inside = generator.uniform(low, high, STATES)
        # A bound of a length is often reached at an end of its range, where a uniform draw would hardly come.
        end = np.where(generator.random(STATES) < 0.5, low, high)
        variable_values[variable["name"]] = np.where(generator.random(STATES) < _SHARE_AT_ENDS, end, inside)
    return variable_values


def _row_value(row_values: Sequence[Array], row_number: int) -> Array:
    """Return the value of a row; ValueError if there is none: Python would count a negative number from the end."""
    if not 0 <= row_number < len(row_values):
        raise ValueError(f"there is no row {row_number}")
    return row_values[row_number]


def _poses_of_rows(row_numbers: Sequence[Sequence[int]], row_values: Sequence[Array]) -> Array:
    """Return the poses (k, 3, 4) at k states, of whose entries the numbers of the rows are given."""
    pose_rows = []
    for numbers in row_numbers:
        entries = []
        for number in numbers:
            value = _row_value(row_values, number)
            entries.append(np.broadcast_to(value, STATES))
        pose_rows.append(entries)
    return np.moveaxis(np.array(pose_rows, float), -1, 0)


def _row_values(rows: Sequence[_Row], variable_values: Mapping[str, Array]) -> list[Array]:
    """Return the values of the operations of the equations."""
    values: list[Array] = []
    for name, *operands in rows:
        if name == "number":
            values.append(np.array(float(operands[0])))
        elif name == "variable":
            values.append(variable_values[operands[0]])
        else:
            numbers = []
            for row_number in operands:
                numbers.append(_row_value(values, row_number))
            values.append(_OPERATIONS[name](*numbers))
    return values


_OPERATIONS = {
    "add": np.add,
    "multiply": np.multiply,
    "negative": np.negative,
    "inverse": np.reciprocal,
    "sine": np.sin,
    "cosine": np.cos,
}


def _chain_poses(steps: Sequence[_Row], variable_values: Mapping[str, Array]) -> Array:
    """Return the poses (k, 3, 4) at the end of a chain of frames and joints."""
    pose = np.broadcast_to(np.eye(4), (STATES, 4, 4))
    for kind, value in steps:
        if kind in ("frame", "inverse"):
            step = np.eye(4)
            step[:3] = np.array(value, float)
            if kind == "inverse":
                step = np.linalg.inv(step)
        elif kind in ("turn", "slide"):
            step = _joint_motion(kind, np.broadcast_to(variable_values[value], STATES))
        else:
            raise ValueError(f"a step is {kind!r}")
        pose = pose @ step
    return pose[:, :3]


def _joint_motion(kind: str, value: Array) -> Array:
    """Return the motions (k, 4, 4) of a joint about z, or along z."""
    step = np.zeros((len(value), 4, 4))
    # By hand, not by the functions of the prover: a mistake in those must not hide here too.
    step[:] = np.eye(4)
    if kind == "slide":
        step[:, 2, 3] = value
        return step
    step[:, 0, 0] = step[:, 1, 1] = np.cos(value)
    step[:, 1, 0] = np.sin(value)
    step[:, 0, 1] = -step[:, 1, 0]
    return step
