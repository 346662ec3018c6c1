"""Evaluate the equations of a formula on symbols: CasADi expressions of pose and joint values."""

from __future__ import annotations

import inspect
import re
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError, no_inverse, unknown
from twin.core.program_end import ProgramEndError, contained
from twin.formula.contract import POSE_SYMBOL, Equation, Formula, Stage, SymbolFunction, arguments, unread
from twin.formula.scalar import Value

_NOT_SQUARE = re.compile(r"not square but (\d+)x(\d+)")
"""Pattern in CasADi's error message for a matrix that is not square."""

_LARGEST_CONDITION = 1e8
"""Maximum condition number of numeric matrices to invert."""

_ZERO_ENTRY = 1e-15
"""Magnitude below which entries of an inverse become zero."""


def call(function: SymbolFunction, symbols: Mapping[str, Value], what: str, suggestions: Sequence[str] = ()) -> Value:
    """Call a function with the symbols that it names as arguments, and return its result.

    `what` is the name of the function in messages. If a symbol is missing, the message also suggests names from
    `suggestions`.

    Raises:
        KinematicsError: a symbol is missing, or the function fails; the message gives file and line.
    """
    required, optional = arguments(function)
    for name in required:
        if name not in symbols:
            text = unknown("symbol", name, symbols, suggestions).removeprefix("there is no ")
            raise KinematicsError(f"{what} needs {text}")
    values: dict[str, Value] = {}
    for name in (*required, *optional):
        if name in symbols:
            values[name] = symbols[name]
    with _failures_located(function, what):
        return function(**values)


@contextmanager
def _failures_located(function: Callable[..., object], what: str) -> Iterator[None]:
    """In this context, the function is called: its failure raises a `KinematicsError` with file and line.

    `what` is the name of the function in messages. Errors with a message of twin's own remain as they are.
    """
    try:
        with contained(function):
            yield
    except (KinematicsError, ProgramEndError):
        raise
    except Exception as error:
        raise KinematicsError(f"{what} fails at {_line_of(error, function)}: {_message(error)}") from error


def _message(error: Exception) -> str:
    """Return the text of an error; a short one for a matrix that CasADi cannot invert."""
    text = str(error)
    match = _NOT_SQUARE.search(text)
    if match is None:
        return text
    rows = int(match[1])
    columns = int(match[2])
    return no_inverse(rows, columns)


def run(formula: Formula, variants: Mapping[str, str], symbols: Mapping[str, Value], stage: Stage) -> dict[str, Value]:
    """Return the symbols together with the outputs of the equations of one stage.

    An equation is skipped if all its outputs are already among the symbols. A flow can therefore start in the middle,
    for example from the named points instead of the pose.

    Raises:
        KinematicsError: a symbol is missing, or an equation returns the wrong number of values or a wrong shape.
    """
    flow = dict(symbols)
    for equation in formula.equations:
        if equation.stage != stage or flow.keys() >= set(equation.outputs):
            continue
        variant = variants.get(equation.name, equation.default)
        values = _outputs(formula, equation, equation.variants[variant], flow)
        for name, value in zip(equation.outputs, values, strict=True):
            flow.setdefault(name, value)  # an output that was given keeps its value
    return flow


def from_pose(formula: Formula, T: ca.SX) -> dict[str, Value]:
    """Return {symbol: value} of a pose (4, 4): the pose itself and its coordinates.

    Raises:
        KinematicsError: `coordinates.from_pose` fails, or returns the wrong number of values.
    """
    what = f"formula '{formula.name}', coordinates.from_pose"
    function = formula.coordinates.from_pose
    with _failures_located(function, what):
        values = function(T)
    names = formula.coordinates.names
    if not isinstance(values, tuple | list) or len(values) != len(names):
        raise KinematicsError(f"{what} must return {len(names)} values: {', '.join(names)}.")
    return {POSE_SYMBOL: T, **dict(zip(names, values, strict=True))}


def to_pose(formula: Formula, symbols: Mapping[str, Value]) -> ca.SX:
    """Return the pose (4, 4) from the coordinates among the symbols.

    Raises:
        KinematicsError: a coordinate is missing, `coordinates.to_pose` fails, or its result has another shape.
    """
    what = f"formula '{formula.name}', coordinates.to_pose"
    function = formula.coordinates.to_pose
    values = []
    for name in formula.coordinates.names:
        if name not in symbols:
            text = unknown("symbol", name, symbols).removeprefix("there is no ")
            raise KinematicsError(f"{what} needs {text}")
        values.append(symbols[name])
    with _failures_located(function, what):
        T = ca.SX(function(*values))
    if T.shape != (4, 4):
        raise KinematicsError(f"{what} must return a pose of shape (4, 4), not {T.shape}.")
    return T


def gather(formula: Formula, symbols: Mapping[str, Value], names: tuple[str, ...], what: str) -> ca.SX:
    """Return scalar symbols as one column, in the order of `names`.

    Raises:
        KinematicsError: a symbol is missing or not a scalar.
    """
    column = []
    for name in names:
        if name not in symbols:
            raise KinematicsError(
                f"formula '{formula.name}': no equation gives {what} '{name}'. Symbols: {', '.join(sorted(symbols))}."
            )
        value = expression(formula, symbols, name, what)
        if value.shape != (1, 1):
            raise KinematicsError(f"formula '{formula.name}': {what} '{name}' has shape {value.shape}, not (1, 1).")
        column.append(value)
    if not column:
        return ca.SX(0, 1)  # `vertcat` of nothing has no column
    return ca.vertcat(*column)


def expression(formula: Formula, symbols: Mapping[str, Value], name: str, what: str) -> ca.SX:
    """Return a symbol as an expression; `what` is its role in messages.

    Raises:
        KinematicsError: it is not a number, vector or matrix.
    """
    try:
        return ca.SX(symbols[name])
    except NotImplementedError:
        kind = type(symbols[name]).__name__
        text = f"formula '{formula.name}': {what} '{name}' is a {kind}, not a number, vector or matrix."
        raise KinematicsError(text) from None


def _outputs(
    formula: Formula, equation: Equation, function: SymbolFunction, symbols: Mapping[str, Value]
) -> list[Value]:
    """Return the values of an equation's outputs; implicit outputs (see `Equation`) are solved for.

    Raises:
        KinematicsError: as `run`; or an implicit equation is not linear.
    """
    what = f"formula '{formula.name}', equation '{equation.name}'"
    names = equation.outputs
    required, _ = arguments(function)
    unknowns: dict[str, ca.SX] = {}
    for name in names:
        if name in required and name not in symbols:
            unknowns[name] = ca.SX.sym(name)
    values_of_arguments = {**symbols, **unknowns}
    suggestions = ()
    # a name that does not exist likely means a parameter that no equation reads
    if not values_of_arguments.keys() >= set(required):
        suggestions = unread(formula, {})
    values = call(function, values_of_arguments, what, suggestions)
    if not isinstance(values, tuple | list):
        values = [values]
    values = list(values)
    if len(values) != len(names):
        raise KinematicsError(f"{what} returns {len(values)} values for {len(names)} outputs: {', '.join(names)}.")
    if not unknowns:
        return values
    implicit = ", ".join(unknowns)
    places = [names.index(name) for name in unknowns]
    implicit_rows = [values[place] for place in places]
    rows = ca.vertcat(*implicit_rows)
    x = ca.vertcat(*unknowns.values())
    if rows.shape != x.shape:
        raise KinematicsError(f"{what}: its implicit rows {implicit} must be scalars.")
    # the rows are x = matrix x + constant_part
    matrix = ca.jacobian(rows, x)
    if ca.depends_on(matrix, x):
        raise KinematicsError(f"{what} is implicit in {implicit} and not linear in them.")
    constant_part = ca.substitute(rows, x, 0 * x)
    solution = _solution(ca.SX.eye(len(unknowns)) - matrix, constant_part)
    solved_values = []
    for value in values:
        solved_values.append(ca.substitute(ca.SX(value), x, solution))
    for i, place in enumerate(places):
        solved_values[place] = solution[i]
    return solved_values


def _solution(matrix: ca.SX, right_side: ca.SX) -> ca.SX:
    """Return the solution of matrix x = right_side; one of plain numbers is inverted once."""
    if not ca.symvar(matrix):
        entries = ca.DM(ca.densify(matrix)).full()
        if np.linalg.cond(entries) < _LARGEST_CONDITION:
            inverse = ca.DM(np.linalg.inv(entries))
            # without entries that are only rounding errors, which would add terms
            return ca.SX(ca.sparsify(inverse, _ZERO_ENTRY)) @ right_side
    return ca.solve(matrix, right_side)


def _line_of(error: BaseException, function: Callable[..., object]) -> str:
    """Return "file:line" of the last line in the error's traceback that is in the file of the function."""
    code = getattr(inspect.unwrap(function), "__code__", None)
    if code is None:
        return repr(function)
    line = code.co_firstlineno
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename == code.co_filename:
            line = frame.lineno
    return f"{code.co_filename}:{line}"
