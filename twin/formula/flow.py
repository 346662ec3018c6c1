"""Evaluate the equations of a formula on symbols, and evaluate the resulting expressions on NumPy arrays."""

from __future__ import annotations

import inspect
import re
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError, no_inverse, unknown
from twin.core.program_end import ProgramEndError, contained
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.contract import POSE_SYMBOL, Equation, Formula, Rows, Stage, arguments, unread

if TYPE_CHECKING:
    from twin.codegen import Kernel

_SQUARE = re.compile(r"not square but (\d+)x(\d+)")
"""Pattern in CasADi's error message for a matrix that is not square."""

_MANY = 20_000
"""Minimum number of samples in a batch for which a compiled kernel is used."""

_REGULAR, _ROUNDING = 1e8, 1e-15
"""Maximum condition number of numeric matrices to invert; magnitude below which entries of an inverse become zero."""

_BLOCK = 32
"""Number of samples in one mapped call; larger blocks are no faster, and are slower for small batches."""


def choose(formula: Formula, variants: Mapping[str, str] | str | None) -> dict[str, str]:
    """Return the chosen variant of every equation, {equation: variant}.

    `variants` is {equation: variant}, or the name of one variant for all equations that have this variant.

    Raises:
        KinematicsError: an equation or a variant is unknown; the message lists the existing names.
    """
    known = {e.name: e for e in formula.equations if e.stage != "helper"}
    chosen = {name: e.default for name, e in known.items()}
    if isinstance(variants, str):
        having = {name: variants for name, e in known.items() if variants in e.variants}
        if not having:
            names = {v for e in known.values() for v in e.variants}
            raise KinematicsError(f"formula '{formula.name}': {unknown('variant', variants, names)}")
        variants = having
    for name, variant in (variants or {}).items():
        if name not in known:
            raise KinematicsError(f"formula '{formula.name}': {unknown('equation', name, known)}")
        if variant not in known[name].variants:
            raise KinematicsError(
                f"formula '{formula.name}', equation '{name}': {unknown('variant', variant, known[name].variants)}"
            )
        chosen[name] = variant
    return chosen


def call(function: Rows, symbols: Mapping[str, Any], what: str, unread: Sequence[str] = ()) -> Any:
    """Call a function with the symbols that it names as arguments, and return its result.

    `what` is the name of the function in messages. If a symbol is missing, the message suggests names from `unread`.

    Raises:
        KinematicsError: a symbol is missing, or the function fails; the message gives file and line.
    """
    required, optional = arguments(function)
    for name in required:
        if name not in symbols:
            text = unknown("symbol", name, symbols, unread).removeprefix("there is no ")
            raise KinematicsError(f"{what} needs {text}")
    try:
        with contained(function):
            return function(**{n: symbols[n] for n in (*required, *optional) if n in symbols})
    except (KinematicsError, ProgramEndError):
        raise
    except Exception as error:
        raise KinematicsError(f"{what} fails at {_where(error, function)}: {_message(error)}") from error


def _message(error: Exception) -> str:
    square = _SQUARE.search(str(error))
    return no_inverse(int(square[1]), int(square[2])) if square else str(error)


def run(formula: Formula, chosen: Mapping[str, str], symbols: Mapping[str, Any], stage: Stage) -> dict[str, Any]:
    """Return the symbols together with the outputs of the equations of one stage.

    An equation is skipped if all its outputs are already among the symbols. A flow can therefore start in the middle,
    for example from the named points instead of the pose.

    Raises:
        KinematicsError: a symbol is missing, or an equation returns the wrong number of values or a wrong shape.
    """
    out = dict(symbols)
    for equation in formula.equations:
        if equation.stage != stage or all(name in out for name in equation.outputs):
            continue
        function = equation.variants[chosen.get(equation.name, equation.default)]
        for name, value in zip(equation.outputs, _outputs(formula, equation, function, out), strict=True):
            out.setdefault(name, value)
    return out


def from_pose(formula: Formula, T: Any) -> dict[str, Any]:
    """Return {symbol: value} of a pose (4, 4): the pose itself and its coordinates."""
    what = f"formula '{formula.name}', coordinates.from_pose"
    try:
        with contained(formula.coordinates.from_pose):
            values = formula.coordinates.from_pose(T)
    except ProgramEndError:
        raise
    except Exception as error:
        raise KinematicsError(f"{what} fails at {_where(error, formula.coordinates.from_pose)}: {error}") from error
    names = formula.coordinates.names
    if not isinstance(values, tuple | list) or len(values) != len(names):
        raise KinematicsError(f"{what} must return {len(names)} values: {', '.join(names)}.")
    return {POSE_SYMBOL: T, **dict(zip(names, values, strict=True))}


def to_pose(formula: Formula, symbols: Mapping[str, Any]) -> ca.SX:
    """Return the pose (4, 4) from the coordinates among the symbols."""
    what = f"formula '{formula.name}', coordinates.to_pose"
    for name in formula.coordinates.names:
        if name not in symbols:
            raise KinematicsError(f"{what} needs {unknown('symbol', name, symbols).removeprefix('there is no ')}")
    try:
        with contained(formula.coordinates.to_pose):
            T = ca.SX(formula.coordinates.to_pose(*(symbols[n] for n in formula.coordinates.names)))
    except ProgramEndError:
        raise
    except Exception as error:
        raise KinematicsError(f"{what} fails at {_where(error, formula.coordinates.to_pose)}: {error}") from error
    if T.shape != (4, 4):
        raise KinematicsError(f"{what} must return a pose of shape (4, 4), not {T.shape}.")
    return T


def gather(formula: Formula, symbols: Mapping[str, Any], names: tuple[str, ...], what: str) -> ca.SX:
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
        value = ca.SX(symbols[name])
        if value.shape != (1, 1):
            raise KinematicsError(f"formula '{formula.name}': {what} '{name}' has shape {value.shape}, not (1, 1).")
        column.append(value)
    return ca.vertcat(*column) if column else ca.SX(0, 1)


def _outputs(formula: Formula, equation: Equation, function: Rows, symbols: Mapping[str, Any]) -> list[Any]:
    what = f"formula '{formula.name}', equation '{equation.name}'"
    required, _ = arguments(function)
    implicit = [n for n in equation.outputs if n in required and n not in symbols]
    unknowns = {n: ca.SX.sym(n) for n in implicit}
    given = {**symbols, **unknowns}
    values = call(function, given, what, () if given.keys() >= set(required) else unread(formula, {}))
    values = list(values) if isinstance(values, tuple | list) else [values]
    if len(values) != len(equation.outputs):
        raise KinematicsError(
            f"{what} returns {len(values)} values for {len(equation.outputs)} outputs: {', '.join(equation.outputs)}."
        )
    if not implicit:
        return values
    rows = ca.vertcat(*(values[equation.outputs.index(n)] for n in implicit))
    x = ca.vertcat(*unknowns.values())
    if rows.shape != x.shape:
        raise KinematicsError(f"{what}: its implicit rows {', '.join(implicit)} must be scalars.")
    A = ca.jacobian(rows, x)
    if ca.depends_on(A, x):
        raise KinematicsError(f"{what} is implicit in {', '.join(implicit)} and not linear in them.")
    solved = _solved(ca.SX.eye(len(implicit)) - A, ca.substitute(rows, x, 0 * x))
    values = [ca.substitute(ca.SX(v), x, solved) for v in values]
    for i, n in enumerate(implicit):
        values[equation.outputs.index(n)] = solved[i]
    return values


def _solved(A: ca.SX, b: ca.SX) -> ca.SX:
    """Return the solution of A x = b; a matrix of plain numbers is inverted once, not at every evaluation."""
    if not ca.symvar(A):
        numbers = ca.DM(ca.densify(A)).full()
        if np.linalg.cond(numbers) < _REGULAR:
            return ca.SX(ca.sparsify(ca.DM(np.linalg.inv(numbers)), _ROUNDING)) @ b
    return ca.solve(A, b)


def _where(error: BaseException, function: Rows) -> str:
    """Return "file:line" of the last line in the error's traceback that is in the file of the function."""
    code = getattr(inspect.unwrap(function), "__code__", None)
    if code is None:
        return repr(function)
    line = code.co_firstlineno
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename == code.co_filename:
            line = frame.lineno
    return f"{code.co_filename}:{line}"


def attach(function: ca.Function, *arguments: Array) -> tuple[Array, Callable[[], None]]:
    """Return (array, procedure). The procedure has no arguments and writes the value of the function to the array.

    The procedure reads the current numbers from the memory of `arguments`, which are contiguous arrays. Nothing is
    copied or checked, so that the procedure is fast enough for control loops.
    """
    out = np.zeros(function.size1_out(0))
    buffer, trigger = function.buffer()
    for i, argument in enumerate(arguments):
        if argument.size:
            buffer.set_arg(i, argument.data)  # pyright: ignore[reportCallIssue]
    if out.size:
        buffer.set_res(0, out.data)  # pyright: ignore[reportCallIssue]
    call = partial(trigger)
    call.__dict__["memory"] = buffer, arguments  # kept alive as long as this procedure
    return out, call


class Evaluator:
    """A compiled function of one vector, fast for single vectors and for batches.

    Batches are evaluated in blocks, or by a compiled kernel. `Function.buffer()` avoids CasADi's argument handling,
    which takes about 30 times as long as a small function. A lock protects the buffers, because a viewer calls from
    several threads.

    Attributes:
        one: function that returns the value, in the declared shape, at one vector z.
    """

    def __init__(self, name: str, z: Any, out: Any, shape: tuple[int, ...] = ()) -> None:
        self.name = name
        self.shape = shape or (out.numel(),)
        self.function = ca.Function(name, [z], [symbolic.flat(out) if out.shape[1] > 1 else ca.densify(out)])
        self._lock = threading.Lock()
        self.one = self._caller()

    def compile_one(self) -> None:
        """Replace `one` by compiled code, which takes half the time and gives the same numbers to the last bit.

        Compilation takes time, and therefore pays off only in loops of many calls.
        """
        from twin import codegen

        stage, size, shape = codegen.Stage(self.function, ("z",), ("out",)), self.function.size1_in(0), self.shape
        with suppress(ValueError):  # kernels do not support some operations: CasADi remains
            code = codegen.Kernel([stage], {"z": size}, ["out"], single=True, exact=True).single()
            self.one = code if len(shape) == 1 else lambda z: code(z).reshape(shape)

    def _caller(self) -> Callable[[Array], Array]:
        # Local names are used instead of attributes, `with` and `[:]`, which would take as long as the function itself.
        (given, call), lock = self.bind(), threading.Lock()
        acquire, release = lock.acquire, lock.release

        def one(z: Array) -> Array:
            acquire()
            try:
                given[...] = z
                return call()
            finally:
                release()

        return one

    def bind(self) -> tuple[Array, Callable[[], Array]]:
        """Return a vector z to fill, and a function that returns the value at z; for use in a single thread.

        This is faster in control loops than `one`, which needs a lock and copies its argument.
        """
        z = np.zeros(self.function.size1_in(0))
        out, compute = attach(self.function, z)
        copy = out.reshape(self.shape).copy

        def call() -> Array:
            compute()
            return copy()

        return z, call

    @cached_property
    def _kernel(self) -> Kernel | None:
        from twin import codegen

        stage = codegen.Stage(self.function, ("z",), ("out",))
        try:
            return codegen.Kernel([stage], {"z": self.function.size1_in(0)}, ["out"])
        except ValueError:  # kernels do not support rootfinders and some operations: use CasADi
            return None

    @cached_property
    def _mapped(self) -> tuple:
        function = self.function.map(_BLOCK)
        inputs, outputs = np.zeros((_BLOCK, self.function.size1_in(0))), np.zeros((_BLOCK, self.function.size1_out(0)))
        buffer, trigger = function.buffer()
        buffer.set_arg(0, inputs.reshape(-1).data)  # pyright: ignore[reportCallIssue]
        buffer.set_res(0, outputs.reshape(-1).data)  # pyright: ignore[reportCallIssue]
        return inputs, outputs, trigger, buffer  # the buffer must stay alive

    def many(self, Z: Array) -> Array:
        """Return the values (k, *shape) at the rows of Z (k, n)."""
        k = len(Z)
        if k >= _MANY and self.function.size1_out(0) and self._kernel is not None:
            return self._kernel.rows(np.asarray(Z, float)).reshape(k, *self.shape)
        result = np.zeros((k, self.function.size1_out(0)))
        if k <= 16:
            for i in range(k):
                result[i] = self.one(Z[i]).ravel()
        elif self.function.size1_out(0):
            with self._lock:
                inputs, outputs, trigger, _ = self._mapped
                for start in range(0, k, _BLOCK):
                    n = min(_BLOCK, k - start)
                    inputs[:n] = Z[start : start + n]
                    trigger()
                    result[start : start + n] = outputs[:n]
        return result.reshape(k, *self.shape)
