"""Find functions of a formula that use the other form of a Denavit-Hartenberg table: standard or modified.

With screws about two axes, a rotation and a translation each, a row of the table is

    modified   Screw_x(alpha, a) Screw_z(theta, d)
    standard   Screw_z(theta, d) Screw_x(alpha, a)

The form of a function with four arguments follows from its value for four numbers, see `dh_form`. Of any other function
that returns poses, rotation and translation are exchanged. The rows are then judged with the changed function.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import permutations

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.convention_rows import FixedRows, rows_fixed_by
from twin.validation.explain.equation_steps import Helper, Step
from twin.validation.explain.explanation_data import Convention
from twin.validation.explain.plain_values import as_arrays, as_objects
from twin.validation.explain.rebuilt_functions import Matrix, rotations_about
from twin.validation.explain.row_deviations import Judge

_MATRIX_ROUNDING = 1e-12
"""Largest difference of two matrices of the same row of a Denavit-Hartenberg table."""

_DH_PROBE = (0.3, 0.7, 1.1, 0.45)
"""Arguments, in m and rad, that show the form of a Denavit-Hartenberg row: they differ, so that only one order fits."""


def denavit_hartenberg_forms(judge: Judge) -> Iterator[Convention]:
    """Yield a convention for each helper that makes rows agree if it uses the other Denavit-Hartenberg form."""
    failing = {place.equation for place in judge.failing()}
    for step in judge.steps:
        if step.equation.name not in failing or step.stage == "helper":
            continue
        for helper in judge.helpers(step):
            for other_function, message in _other_forms(helper):
                fixed_rows = _fixed_by_helper(judge, step, helper, other_function)
                if fixed_rows is not None:
                    yield fixed_rows.convention("dh", message)
                    break


def _other_forms(helper: Helper) -> Iterator[tuple[Callable[..., Value], str]]:
    """Yield (function in the other form, message) for a helper that returns poses."""
    name = helper.source.name
    function = helper.function
    form = dh_form(function)
    if form is not None:
        kind, order = form
        other_form = "standard" if kind == "modified" else "modified"
        message = f"{name}() multiplies rows in {kind} Denavit-Hartenberg form; the table has the {other_form} form"
        yield partial(_dh_row, other_form, order), message
        return
    swap = "swap rotation and translation"
    is_modified = "moves first and then rotates, as in modified Denavit-Hartenberg form"
    message = f"{name}() {is_modified}; the rows agree if it rotates first (standard form): {swap}"
    yield partial(_swapped, function, False), message
    is_standard = "rotates first and then moves, as in standard Denavit-Hartenberg form"
    message = f"{name}() {is_standard}; the rows agree if it moves first (modified form): {swap}"
    yield partial(_swapped, function, True), message


def _fixed_by_helper(
    judge: Judge, step: Step, helper: Helper, other_function: Callable[..., Value]
) -> FixedRows | None:
    """Return the rows that agree if an equation calls another function instead of a helper; None as `rows_fixed_by`."""
    scopes = [step.scope, helper.function.__globals__]
    for called in judge.helpers(step):
        scopes.append(called.function.__globals__)
    with _replaced(helper.function, other_function, scopes):
        return rows_fixed_by(judge, judge.on(judge.reference))


@contextmanager
def _replaced(
    function: Callable[..., Value], other_function: Callable[..., Value], scopes: Iterable[dict[str, Value]]
) -> Iterator[None]:
    """In this context, each name of `function` in the scopes means `other_function`."""
    names_in_scopes: list[tuple[dict[str, Value], str]] = []
    for scope in scopes:
        for name, value in list(scope.items()):
            if value is function:
                names_in_scopes.append((scope, name))
                scope[name] = other_function
    try:
        yield
    finally:
        for scope, name in names_in_scopes:
            scope[name] = function


def _swapped(function: Callable[..., Value], rotates_first: bool, *values: Value) -> Value:
    """Return the pose of a function with rotation and translation in the other order.

    `rotates_first`: whether the function returns Rot Trans, which becomes Trans Rot; otherwise, the reverse.

    Raises:
        TypeError: the function returns no poses (4, 4).
    """
    value = function(*values)
    pose = as_arrays(value)
    if not isinstance(pose, Matrix) or pose.shape != (4, 4):
        raise TypeError("no pose")
    T = pose.a.copy()
    R = T[:, :3, :3]
    if rotates_first:  # the translation of Rot Trans is rotated: R^T rotates it back
        R = np.swapaxes(R, 1, 2)
    T[:, :3, 3] = (R @ T[:, :3, 3:])[..., 0]
    if isinstance(value, Matrix):
        return Matrix(T)
    return as_objects(Matrix(T))


def _dh_row(form: str, order: tuple[int, ...], *values: Value) -> Matrix:
    """Return the matrix of one row of a Denavit-Hartenberg table.

    `form` is "standard" or "modified"; `order` gives the positions of alpha, a, theta and d in `values`.
    """
    columns: list[Array] = []
    for i in order:
        columns.append(np.atleast_1d(np.asarray(values[i], float)))
    alpha, a, theta, d = np.broadcast_arrays(*columns)
    about_x = _screw_motions(rotations_about(0)(alpha).a, 0, a)
    about_z = _screw_motions(rotations_about(2)(theta).a, 2, d)
    if form == "modified":
        return Matrix(about_x @ about_z)
    return Matrix(about_z @ about_x)


def _screw_motions(R: Array, axis: int, distance: Array) -> Array:
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
    for form in ("modified", "standard"):
        for order in permutations(range(4)):
            row = _dh_row(form, order, *_DH_PROBE)
            if np.abs(row.a - T.a).max() < _MATRIX_ROUNDING:
                return form, order
    return None
