"""Compare numbers in the sentences of a README.txt with each other and with the files: budgets, transmissions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_drives import FileMotor
from twin.exchange.audit.report import Ledger, Measured

_BUDGETS = re.compile(
    r"- (?P<name>\w+): [^\n]*?at most (?P<position>[\d.]+) um off[^\n]*?and (?P<rotation>[\d.]+) degrees; joints open "
    r"by at most (?P<gap>[\d.]+) um \(budget: (?P<most_position>[\d.]+) um, (?P<most_rotation>[\d.]+) degrees, "
    r"(?P<most_gap>[\d.]+) um\)"
)
"""Errors of a motion between its keys, and the budgets that the export had for them."""

_MATRIX = re.compile(r"the matrix of transmission (?P<name>\w+) \((?P<equations>[^()]*)\)")

_TERM = re.compile(r"(?P<factor>[-+]? ?[\d.]+(?:e[-+]?\d+)?) (?P<motor>\w+)")

_DIGITS = 1e-4
"""Maximum error of the product of a matrix and its inverse, if the entries have six digits."""


def check_numbers(text: str, contents: Sequence[Content], ledger: Ledger) -> None:
    """Report budgets that errors exceed or that differ between motions, and transmissions that no file has so.

    `text` is the README.txt with its wrapped lines joined.
    """
    _check_budgets(text, ledger)
    motors: dict[str, FileMotor] = {}
    for content in contents:
        if content.mechanism is not None and content.mechanism.all_motors:
            motors = dict(content.mechanism.motors or {})
            break
    for row in _MATRIX.finditer(text):
        _check_matrix(row["name"], row["equations"], motors, ledger)


def _check_budgets(text: str, ledger: Ledger) -> None:
    first: tuple[str, str] | None = None  # (motion, its budgets)
    for row in _BUDGETS.finditer(text):
        name = row["name"]
        for key in ("position", "rotation", "gap"):
            error = float(row[key])
            most = float(row[f"most_{key}"])
            if error > most:
                message = f"motion '{name}': the {key} is off by {error:g} between keys, above its budget of {most:g}."
                ledger.wrong("readme.budget", message, name, size=Measured(error, most))
        budgets = ", ".join((row["most_position"], row["most_rotation"], row["most_gap"]))
        if first is None:
            first = (name, budgets)
        elif budgets != first[1]:
            message = f"motion '{name}' has the budgets {budgets}, motion '{first[0]}' has {first[1]}."
            ledger.wrong("readme.budget", message, name)


def _check_matrix(name: str, equations: str, motors: Mapping[str, FileMotor], ledger: Ledger) -> None:
    """Compare joint = sum of factor times motor in README.txt with the rows of the motors, which are its inverse."""
    matrix: dict[str, dict[str, float]] = {}  # {joint: {motor: factor}}
    for equation in equations.split("; "):
        joint, _, terms = equation.partition(" = ")
        matrix[joint] = {}
        for term in _TERM.finditer(terms):
            matrix[joint][term["motor"]] = float(term["factor"].replace(" ", ""))
    motor_names: list[str] = []
    for factors in matrix.values():
        for motor in factors:
            if motor not in motor_names:
                motor_names.append(motor)
    rows: dict[str, Mapping[str, float]] = {}
    for motor in motor_names:
        if motor in motors and motors[motor].row is not None:
            rows[motor] = motors[motor].row or {}
    if not rows or len(motor_names) != len(matrix):
        return  # no file has these motors, or they are not as many as their joints
    size = len(motor_names)
    stated_matrix = np.zeros((size, size))
    inverse = np.zeros((size, size))
    for i, (joint, factors) in enumerate(matrix.items()):
        for k, motor in enumerate(motor_names):
            stated_matrix[i, k] = factors.get(motor, 0.0)
            inverse[k, i] = rows.get(motor, {}).get(joint, 0.0)
    error = float(np.abs(stated_matrix @ inverse - np.eye(size)).max())
    if not error <= _DIGITS:
        message = f"README.txt has other factors for the transmission '{name}' than the files: '{equations[:60]}…'."
        ledger.wrong("readme.transmission", message, name, size=Measured(error, _DIGITS))
