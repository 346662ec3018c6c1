"""Evaluate the equations of a formula on symbols, and evaluate the resulting expressions on NumPy arrays."""

from __future__ import annotations

import inspect
import re
import threading
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError, no_inverse, unknown
from twin.core.program_end import ProgramEndError, contained
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.contract import POSE_SYMBOL, Equation, Formula, Rows, Stage, arguments, unread
from twin.formula.scalar import Value

if TYPE_CHECKING:
    from twin.codegen import Kernel

_SQUARE = re.compile(r"not square but (\d+)x(\d+)")
"""Pattern in CasADi's error message for a matrix that is not square."""

_MANY = 20_000
"""Minimum number of samples in a batch for which a compiled kernel is used."""

_REGULAR = 1e8
"""Maximum condition number of numeric matrices to invert."""

_ROUNDING = 1e-15
"""Magnitude below which entries of an inverse become zero."""

_BLOCK = 32
"""Number of samples in one mapped call; larger blocks are no faster, and are slower for small batches."""


def choose(formula: Formula, variants: Mapping[str, str] | str | None) -> dict[str, str]:
    """Return the chosen variant of every equation, {equation: variant}.

    `variants` is {equation: variant}, the same as a text ("eq1=printed"; several with commas), or the name of one
    variant for all equations that have this variant.

    Raises:
        KinematicsError: an equation or a variant is unknown; the message lists the existing names.
    """
    known = {equation.name: equation for equation in formula.equations if equation.stage != "helper"}
    chosen = {name: equation.default for name, equation in known.items()}
    if variants is None:
        return chosen
    if isinstance(variants, str):
        if "=" not in variants:
            return chosen | _everywhere(formula, known.values(), variants)
        variants = _pairs(formula, variants)
    for name, variant in variants.items():
        if name not in known:
            raise KinematicsError(f"formula '{formula.name}': {unknown('equation', name, known)}")
        existing = known[name].variants
        if variant not in existing:
            text = unknown("variant", variant, existing)
            raise KinematicsError(f"formula '{formula.name}', equation '{name}': {text}")
        chosen[name] = variant
    return chosen


def _pairs(formula: Formula, text: str) -> dict[str, str]:
    """Return {equation: variant} of a text such as "eq1=printed, eq2=literal".

    Raises:
        KinematicsError: a part of the text has another form, or an equation is given twice.
    """
    pairs: dict[str, str] = {}
    for part in text.split(","):
        equation, mark, variant = (piece.strip() for piece in part.partition("="))
        if not (equation and mark and variant):
            way_out = "write EQUATION=VARIANT, as eq1=printed"
            raise KinematicsError(f"formula '{formula.name}', variants '{text}': {way_out}")
        if equation in pairs:
            raise KinematicsError(f"formula '{formula.name}', variants '{text}': equation '{equation}' is given twice")
        pairs[equation] = variant
    return pairs


def _everywhere(formula: Formula, equations: Iterable[Equation], variant: str) -> dict[str, str]:
    """Return {equation: variant} for the equations that have this variant.

    Raises:
        KinematicsError: there is no such equation.
    """
    chosen = {}
    existing: set[str] = set()
    for equation in equations:
        existing.update(equation.variants)
        if variant in equation.variants:
            chosen[equation.name] = variant
    if not chosen:
        raise KinematicsError(f"formula '{formula.name}': {unknown('variant', variant, existing)}")
    return chosen


def call(function: Rows, symbols: Mapping[str, Value], what: str, unread: Sequence[str] = ()) -> Value:
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
    values = {name: symbols[name] for name in (*required, *optional) if name in symbols}
    try:
        with contained(function):
            return function(**values)
    except (KinematicsError, ProgramEndError):
        raise
    except Exception as error:
        raise KinematicsError(f"{what} fails at {_where(error, function)}: {_message(error)}") from error


def _message(error: Exception) -> str:
    text = str(error)
    match = _SQUARE.search(text)
    if match is None:
        return text
    rows = int(match[1])
    columns = int(match[2])
    return no_inverse(rows, columns)


def run(formula: Formula, chosen: Mapping[str, str], symbols: Mapping[str, Value], stage: Stage) -> dict[str, Value]:
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
        variant = chosen.get(equation.name, equation.default)
        values = _outputs(formula, equation, equation.variants[variant], out)
        for name, value in zip(equation.outputs, values, strict=True):
            out.setdefault(name, value)  # an output that was given keeps its value
    return out


def from_pose(formula: Formula, T: ca.SX) -> dict[str, Value]:
    """Return {symbol: value} of a pose (4, 4): the pose itself and its coordinates."""
    what = f"formula '{formula.name}', coordinates.from_pose"
    function = formula.coordinates.from_pose
    try:
        with contained(function):
            values = function(T)
    except ProgramEndError:
        raise
    except Exception as error:
        raise KinematicsError(f"{what} fails at {_where(error, function)}: {error}") from error
    names = formula.coordinates.names
    if not isinstance(values, tuple | list) or len(values) != len(names):
        raise KinematicsError(f"{what} must return {len(names)} values: {', '.join(names)}.")
    return {POSE_SYMBOL: T, **dict(zip(names, values, strict=True))}


def to_pose(formula: Formula, symbols: Mapping[str, Value]) -> ca.SX:
    """Return the pose (4, 4) from the coordinates among the symbols."""
    what = f"formula '{formula.name}', coordinates.to_pose"
    function = formula.coordinates.to_pose
    values = []
    for name in formula.coordinates.names:
        if name not in symbols:
            text = unknown("symbol", name, symbols).removeprefix("there is no ")
            raise KinematicsError(f"{what} needs {text}")
        values.append(symbols[name])
    try:
        with contained(function):
            T = ca.SX(function(*values))
    except ProgramEndError:
        raise
    except Exception as error:
        raise KinematicsError(f"{what} fails at {_where(error, function)}: {error}") from error
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


def _outputs(formula: Formula, equation: Equation, function: Rows, symbols: Mapping[str, Value]) -> list[Value]:
    """Return the values of an equation's outputs; implicit outputs (see `Equation`) are solved for.

    Raises:
        KinematicsError: as `run`; or an implicit equation is not linear.
    """
    what = f"formula '{formula.name}', equation '{equation.name}'"
    names = equation.outputs
    required, _ = arguments(function)
    unknowns = {name: ca.SX.sym(name) for name in names if name in required and name not in symbols}
    given = {**symbols, **unknowns}
    suggestions = ()
    if not given.keys() >= set(required):
        suggestions = unread(formula, {})
    values = call(function, given, what, suggestions)
    values = list(values) if isinstance(values, tuple | list) else [values]
    if len(values) != len(names):
        raise KinematicsError(f"{what} returns {len(values)} values for {len(names)} outputs: {', '.join(names)}.")
    if not unknowns:
        return values
    implicit = ", ".join(unknowns)
    places = [names.index(name) for name in unknowns]
    rows = ca.vertcat(*[values[place] for place in places])
    x = ca.vertcat(*unknowns.values())
    if rows.shape != x.shape:
        raise KinematicsError(f"{what}: its implicit rows {implicit} must be scalars.")
    # the rows are x = A x + b
    A = ca.jacobian(rows, x)
    if ca.depends_on(A, x):
        raise KinematicsError(f"{what} is implicit in {implicit} and not linear in them.")
    b = ca.substitute(rows, x, 0 * x)
    solution = _solution(ca.SX.eye(len(unknowns)) - A, b)
    values = [ca.substitute(ca.SX(value), x, solution) for value in values]
    for i, place in enumerate(places):
        values[place] = solution[i]
    return values


def _solution(A: ca.SX, b: ca.SX) -> ca.SX:
    """Return the solution of A x = b; a matrix of plain numbers is inverted once, not at every evaluation."""
    if not ca.symvar(A):
        numbers = ca.DM(ca.densify(A)).full()
        if np.linalg.cond(numbers) < _REGULAR:
            inverse = ca.DM(np.linalg.inv(numbers))
            # without entries that are only rounding errors, which would add terms
            return ca.SX(ca.sparsify(inverse, _ROUNDING)) @ b
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
    result = np.zeros(function.size1_out(0))
    buffer, trigger = function.buffer()
    for i, argument in enumerate(arguments):
        if argument.size:
            buffer.set_arg(i, argument.data)  # pyright: ignore[reportCallIssue]
    if result.size:
        buffer.set_res(0, result.data)  # pyright: ignore[reportCallIssue]
    procedure = partial(trigger)
    procedure.__dict__["memory"] = buffer, arguments  # kept alive as long as this procedure
    return result, procedure


class Evaluator:
    """A compiled function of one vector, fast for single vectors and for batches.

    Batches are evaluated in blocks, or by a compiled kernel. `Function.buffer()` avoids CasADi's argument handling,
    which takes about 30 times as long as a small function. A lock protects the buffers, because a viewer calls from
    several threads.

    Attributes:
        one: function that returns the value, in the declared shape, at one vector z.
    """

    def __init__(self, name: str, z: symbolic.SX, out: symbolic.SX, shape: tuple[int, ...] = ()) -> None:
        self.name = name
        self.shape = shape or (out.numel(),)
        if out.shape[1] > 1:
            column = symbolic.flat(out)
        else:
            column = ca.densify(out)
        self.function = ca.Function(name, [z], [column])
        self._lock = threading.Lock()
        self.one = self._caller()

    def compile_one(self) -> None:
        """Replace `one` by compiled code, which takes half the time and gives the same numbers to the last bit.

        Compilation takes time, and therefore pays off only in loops of many calls.
        """
        from twin import codegen

        stage = codegen.Stage(self.function, ("z",), ("out",))
        sizes = {"z": self.function.size1_in(0)}
        shape = self.shape
        try:
            code = codegen.Kernel([stage], sizes, ["out"], single=True, exact=True).single()
        except ValueError:  # kernels do not support some operations: CasADi remains
            return
        if len(shape) == 1:
            self.one = code
        else:
            self.one = lambda z: code(z).reshape(shape)

    def _caller(self) -> Callable[[Array], Array]:
        # Local names are used instead of attributes, `with` and `[:]`, which would take as long as the function itself.
        given, compute = self.bind()
        lock = threading.Lock()
        acquire = lock.acquire
        release = lock.release

        def one(z: Array) -> Array:
            acquire()
            try:
                given[...] = z
                return compute()
            finally:
                release()

        return one

    def bind(self) -> tuple[Array, Callable[[], Array]]:
        """Return a vector z to fill, and a function that returns the value at z; for use in a single thread.

        This is faster in control loops than `one`, which needs a lock and copies its argument.
        """
        z = np.zeros(self.function.size1_in(0))
        result, compute = attach(self.function, z)
        copy = result.reshape(self.shape).copy

        def call() -> Array:
            compute()
            return copy()

        return z, call

    @cached_property
    def _kernel(self) -> Kernel | None:
        from twin import codegen

        stage = codegen.Stage(self.function, ("z",), ("out",))
        sizes = {"z": self.function.size1_in(0)}
        try:
            return codegen.Kernel([stage], sizes, ["out"])
        except ValueError:  # kernels do not support rootfinders and some operations: use CasADi
            return None

    @cached_property
    def _mapped(self) -> tuple:
        function = self.function.map(_BLOCK)
        inputs = np.zeros((_BLOCK, self.function.size1_in(0)))
        outputs = np.zeros((_BLOCK, self.function.size1_out(0)))
        buffer, trigger = function.buffer()
        buffer.set_arg(0, inputs.reshape(-1).data)  # pyright: ignore[reportCallIssue]
        buffer.set_res(0, outputs.reshape(-1).data)  # pyright: ignore[reportCallIssue]
        return inputs, outputs, trigger, buffer  # the buffer must stay alive

    def many(self, Z: Array) -> Array:
        """Return the values (k, *shape) at the rows of Z (k, n)."""
        k = len(Z)
        width = self.function.size1_out(0)
        if k >= _MANY and width and self._kernel is not None:
            return self._kernel.rows(np.asarray(Z, float)).reshape(k, *self.shape)
        result = np.zeros((k, width))
        if k <= 16:
            for i in range(k):
                result[i] = self.one(Z[i]).ravel()
        elif width:
            with self._lock:
                inputs, outputs, trigger, _ = self._mapped
                for start in range(0, k, _BLOCK):
                    n = min(_BLOCK, k - start)
                    inputs[:n] = Z[start : start + n]
                    trigger()
                    result[start : start + n] = outputs[:n]
        return result.reshape(k, *self.shape)
