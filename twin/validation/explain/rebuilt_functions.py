"""Run the functions of a formula file on NumPy arrays: one call evaluates many samples, without compilation.

A function is rebuilt with globals in which each CasADi name is replaced by a NumPy equivalent. Scalars are arrays (k,)
or floats, matrices are `Matrix` objects. Helpers called by the function, in its file or in another formula file, are
rebuilt in the same way.
"""

from __future__ import annotations

import contextlib
import inspect
import math
import types
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path

import numpy as np

from twin.core.errors import KinematicsError, no_inverse
from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.robots import FORMULA_MODULE
from twin.validation.explain.augmented_assignments import AUGMENTED_NAME, augmented, rewritten, uses_casadi

_SYMBOLIC_MODULE = "twin.formula.symbolic"
_PACKAGE_FOLDER = Path(__file__).resolve().parents[2]


class Matrix(np.lib.mixins.NDArrayOperatorsMixin):
    """An array `a` (k or 1, rows, columns) of matrices, with the operations of `casadi.SX` on all matrices at once."""

    __slots__ = ("a",)

    def __init__(self, a: Array) -> None:
        self.a = a

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *args: Value, **_: Value) -> Value:
        """Apply an operator or an elementwise function of NumPy; a product of shape (1, 1) is returned as a scalar."""
        if method != "__call__":
            return NotImplemented
        arrays: list[Array] = []
        shapes: set[tuple[int, ...]] = set()
        for x in args:
            array = _entries(x)
            arrays.append(array)
            if array.shape[1:] != (1, 1):
                shapes.add(array.shape[1:])
        if ufunc is np.matmul:
            return _matrix_or_scalar(np.matmul(*arrays))
        if len(shapes) > 1:  # NumPy would repeat a row or a column; CasADi raises an error
            raise ValueError(f"shapes {sorted(shapes)} do not match")
        return Matrix(ufunc(*arrays))

    def __matmul__(self, other: Value) -> Value:
        """Return the product; two matrices need no dispatch by NumPy, which takes longer than the product itself."""
        if not isinstance(other, Matrix):
            return super().__matmul__(other)
        return _matrix_or_scalar(np.matmul(self.a, other.a))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of each matrix."""
        return self.a.shape[1], self.a.shape[2]

    @property
    def T(self) -> Matrix:  # noqa: N802
        """The transposed matrices."""
        return Matrix(np.swapaxes(self.a, 1, 2))

    def numel(self) -> int:
        """Return the number of entries of each matrix."""
        return self.a.shape[1] * self.a.shape[2]

    def __getitem__(self, key: Value) -> Value:
        """Return entries as an array of their own, which may be changed in place without effect on the matrix."""
        rows, columns = self.shape
        if not isinstance(key, tuple):
            if columns != 1:  # as in CasADi, a single index counts column by column
                flat = Matrix(np.swapaxes(self.a, 1, 2).reshape(len(self.a), -1, 1))
                return flat[key, 0]
            key = (key, 0)
        i, j = key
        if isinstance(i, slice) or isinstance(j, slice):
            return Matrix(self.a[:, _as_slice(i, rows), _as_slice(j, columns)].copy())
        return self.a[:, _checked_index(i, rows), _checked_index(j, columns)].copy()


def _matrix_or_scalar(a: Array) -> Value:
    """Return matrices (k, rows, columns); matrices of one entry as a scalar (k,)."""
    if a.shape[1:] == (1, 1):
        return a[:, 0, 0]
    return Matrix(a)


def _as_slice(i: Value, n: int) -> slice:
    """Return an index as a slice; `n` is the number of rows or columns."""
    if isinstance(i, slice):
        return i
    first = _checked_index(i, n)
    return slice(first, first + 1)


def _checked_index(i: Value, n: int) -> int:
    """Return an index counted from the start; `n` is the number of rows or columns.

    Raises:
        TypeError: the index is no whole number.
        IndexError: there is no such row or column.
    """
    if isinstance(i, float | np.ndarray):
        raise TypeError("an index must be a whole number")
    if not -n <= i < n:
        raise IndexError(i)
    return i % n


def _as_matrix(x: Value) -> Matrix:
    """Convert a scalar, an array (k,) or a list of rows to a matrix."""
    if isinstance(x, Matrix):
        return x
    return Matrix(_entries(x))


def _entries(x: Value) -> Array:
    """Return a matrix, a scalar, an array (k,) or a list of rows as an array (k or 1, rows, columns)."""
    if isinstance(x, Matrix):
        return x.a
    a = np.asarray(x, float)
    if isinstance(x, list | tuple):
        return a.reshape(1, len(a), -1)
    return a.reshape(-1, 1, 1)


def _stack(args: tuple, axis: int) -> Value:
    """Return matrices and scalars as one matrix: below each other (`axis` 1), or beside each other (2)."""
    types_of_args = set(map(type, args))
    if types_of_args <= {int, float}:  # most rows of tables: one array is made faster than one of each number
        numbers = np.array(args, float)
        shape = (1, -1, 1)
        if axis == 2:
            shape = (1, 1, -1)
        return Matrix(numbers.reshape(shape))
    parts = [_entries(x) for x in args]
    k = max(map(len, parts))
    repeated: list[Array] = []
    for part in parts:
        if len(part) != k:  # the same at all samples
            part = part.repeat(k, axis=0)
        repeated.append(part)
    return Matrix(np.concatenate(repeated, axis=axis))


def _elementwise(op: np.ufunc, count: int = 1) -> Callable:
    """Return an elementwise function of `count` scalars or matrices (NumPy would use a further argument as output)."""

    def apply(*args: Value) -> Value:
        if len(args) != count:
            raise TypeError(f"{op.__name__} got {len(args)} arguments, not {count}")
        return op(*args)

    return apply


def _column(x: Value) -> Array:
    """Return the entries (k, entries) of a matrix column by column, as CasADi counts them."""
    a = _as_matrix(x).a
    return np.swapaxes(a, 1, 2).reshape(len(a), -1)


def _columns(a: Value, b: Value) -> tuple[Array, Array]:
    """Return the entries of two vectors, each (k or 1, entries); a ValueError if their numbers differ."""
    u = _column(a)
    v = _column(b)
    if u.shape[1] != v.shape[1]:  # numpy would repeat a scalar; CasADi raises an error
        raise ValueError(f"vectors have {u.shape[1]} and {v.shape[1]} entries; both need the same number")
    return u, v


def _dot(a: Value, b: Value) -> Array:
    u, v = _columns(a, b)
    return np.sum(u * v, axis=1)


def _cross(a: Value, b: Value) -> Matrix:
    u, v = np.broadcast_arrays(*_columns(a, b))
    if u.shape[1] != 3:
        raise ValueError(f"a cross product requires 3 entries, not {u.shape[1]}")
    return Matrix(np.cross(u, v)[:, :, None])


_UNGUARDED: ContextVar[bool] = ContextVar("unguarded", default=False)


@contextlib.contextmanager
def unguarded() -> Iterator[None]:
    """Evaluate `if_else(condition, value, nan)` as `value` in this block.

    Equations with an error may have no value at all otherwise, and no value says how far an expression is from right.
    """
    token = _UNGUARDED.set(True)
    try:
        yield
    finally:
        _UNGUARDED.reset(token)


def _if_else(condition: Value, yes: Value, no: Value, *_: Value) -> Value:
    """Return one of two values at each sample; a further argument of CasADi's, for short circuits, has no effect."""
    if isinstance(no, float) and math.isnan(no) and _UNGUARDED.get():
        return yes
    if isinstance(yes, Matrix) or isinstance(no, Matrix):
        return Matrix(np.where(_as_matrix(condition).a.astype(bool), _as_matrix(yes).a, _as_matrix(no).a))
    return np.where(condition, yes, no)


def _norm(x: Value) -> Array:
    return np.sqrt(np.sum(_column(x) ** 2, axis=1))


def _inv(A: Value) -> Matrix:
    """Return the inverse matrices; a ValueError for matrices that are not square."""
    a = _as_matrix(A).a
    if a.shape[1] != a.shape[2]:
        raise ValueError(no_inverse(*a.shape[1:]))
    return Matrix(np.asarray(np.linalg.inv(a), np.float64))


def _skew(w: Value) -> Matrix:
    """Return the matrices S of vectors w with S v = w x v."""
    x, y, z = _column(w).T
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return Matrix(np.stack(rows, axis=1).reshape(-1, 3, 3))


class _SX:
    """NumPy counterpart of `casadi.SX` and `casadi.DM`, with the functions that equations use."""

    def __call__(self, *args: Value) -> Value:
        if len(args) == 2:
            return Matrix(np.zeros((1, *args)))
        (x,) = args
        return _as_matrix(x) if isinstance(x, list | tuple) else x

    def eye(self, n: int) -> Matrix:
        return Matrix(np.eye(n)[None])

    def zeros(self, rows: int, columns: int = 1) -> Matrix:
        return Matrix(np.zeros((1, rows, columns)))

    def ones(self, rows: int, columns: int = 1) -> Matrix:
        return Matrix(np.ones((1, rows, columns)))


def _vertsplit(x: Matrix) -> list[Value]:
    """Return the rows of a matrix; those of a column as scalars."""
    rows, columns = x.shape
    if columns > 1:
        return [x[i, :] for i in range(rows)]
    return [x[i] for i in range(rows)]


def _mtimes(*factors: Value) -> Value:
    """Return the product of two or more matrices."""
    if len(factors) == 2:
        return factors[0] @ factors[1]
    return factors[0] @ _mtimes(*factors[1:])


_UNARY_FUNCTIONS = ("sin", "cos", "tan", "sqrt", "exp", "log", "sinh", "cosh", "tanh", "floor", "sign", "fabs")
_ARC_FUNCTIONS = {"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan}


def _elementwise_functions() -> dict[str, Callable]:
    """Return the elementwise functions of CasADi by name, each of which NumPy has as well."""
    functions: dict[str, Callable] = {}
    for name in _UNARY_FUNCTIONS:
        functions[name] = _elementwise(getattr(np, name))
    for short, function in _ARC_FUNCTIONS.items():  # CasADi has two names for each: asin and arcsin
        functions[short] = _elementwise(function)
        functions[f"arc{short[1:]}"] = _elementwise(function)
    for name in ("fmin", "fmax", "hypot"):
        functions[name] = _elementwise(getattr(np, name), 2)
    for name in ("atan2", "arctan2"):
        functions[name] = _elementwise(np.arctan2, 2)
    return functions


_FUNCTIONS: dict[str, Value] = {
    **_elementwise_functions(),
    "vertcat": lambda *a: _stack(a, 1),
    "horzcat": lambda *a: _stack(a, 2),
    "vcat": lambda a: _stack(tuple(a), 1),
    "hcat": lambda a: _stack(tuple(a), 2),
    "vertsplit": _vertsplit,
    "dot": _dot,
    "cross": _cross,
    "skew": _skew,
    "norm_2": _norm,
    "sumsqr": lambda x: np.sum(_column(x) ** 2, axis=1),
    "mtimes": _mtimes,
    "if_else": _if_else,
    "logic_and": _elementwise(np.logical_and, 2),
    "logic_or": _elementwise(np.logical_or, 2),
    "logic_not": _elementwise(np.logical_not),
    "densify": lambda x: x,
    "vec": lambda x: Matrix(_column(x)[:, :, None]),
    "inv": _inv,
    "pinv": lambda x: Matrix(np.linalg.pinv(x.a)),
    "solve": lambda A, b: _inv(A) @ b,
    "trace": lambda x: np.trace(x.a, axis1=1, axis2=2),
    "SX": _SX(),
    "DM": _SX(),
    "pi": np.pi,
    "inf": np.inf,
}


def rotations_about(axis: int) -> Callable[[Value], Matrix]:
    """Return a function that converts angles (k,) in rad to rotations about `axis` (0, 1 or 2)."""
    i = (axis + 1) % 3
    j = (axis + 2) % 3

    def rotation(a: Value) -> Matrix:
        angle = np.atleast_1d(np.asarray(a, float))
        R = np.zeros((len(angle), 3, 3))
        R[:, axis, axis] = 1
        R[:, i, i] = R[:, j, j] = np.cos(angle)
        R[:, j, i] = np.sin(angle)
        R[:, i, j] = -R[:, j, i]
        return Matrix(R)

    return rotation


def _pose(R: Value, p: Value) -> Matrix:
    """Return the poses (4, 4) of rotations (3, 3) and positions of three entries; either may stand for all samples."""
    R = _entries(R)
    p = _entries(p)
    if R.shape[1:] != (3, 3) or p.shape[1] * p.shape[2] != 3:
        raise ValueError("a pose needs a (3, 3) rotation and three numbers")
    T = np.zeros((max(len(R), len(p)), 4, 4))
    T[:, :3, :3] = R
    T[:, :3, 3] = p.reshape(len(p), 3)
    T[:, 3, 3] = 1
    return Matrix(T)


_NUMPY_VERSIONS = {
    "rotation_x": rotations_about(0),
    "rotation_y": rotations_about(1),
    "rotation_z": rotations_about(2),
    "pose": _pose,
}
"""Functions of `symbolic` that have their own NumPy version."""


_LONGEST_ARGUMENT = 2048
"""Maximum number of entries of an argument of a call whose result is cached."""

_MOST_CACHED_ENTRIES = 2_000_000
"""Maximum number of entries of the cached results of one function: 16 MB."""


def _with_cache(f: types.FunctionType) -> types.FunctionType:
    """Return a function that caches its results if they are matrices; `f` must call no function that can be edited.

    The results are cached and returned as copies, so that no caller can change them. While edits are tried, a row of a
    table is evaluated thousands of times with the same values.
    """
    results: dict[Value, Matrix] = {}
    cache_size = {"entries": 0}
    # The new function has the globals of `f`, in which edits replace functions; what it needs itself is in its closure.
    key_of = _cache_key
    matrix_type = Matrix
    most_entries = _MOST_CACHED_ENTRIES

    def cached(*args: Value, **named: Value) -> Value:
        key = None
        if not named:
            key = key_of(args)
        if key is None:
            return f(*args, **named)
        if key in results:
            return matrix_type(results[key].a.copy())
        value = f(*args)
        if isinstance(value, matrix_type):  # operators never change a matrix, but may change an array or a list
            cache_size["entries"] += value.a.size
            if cache_size["entries"] > most_entries:
                results.clear()
                cache_size["entries"] = value.a.size
            results[key] = matrix_type(value.a.copy())
        return value

    with_cache = types.FunctionType(cached.__code__, f.__globals__, f.__name__, None, cached.__closure__)
    with_cache.__wrapped__ = f  # type: ignore[attr-defined]
    return with_cache


def _is_leaf(f: types.FunctionType) -> bool:
    """Return whether a function, as it is in its module, calls no function of a formula."""
    for name in _global_names(f.__code__):
        called = f.__globals__.get(name)
        if isinstance(called, types.FunctionType) and is_of_formula(called) and not _is_of_casadi(called):
            return False
    return True


def _is_of_casadi(x: Value) -> bool:
    """Return whether a function is one of CasADi, some of which are plain Python functions."""
    module = getattr(x, "__module__", None) or ""
    return module.split(".")[0] == "casadi"


def _global_names(code: types.CodeType) -> set[str]:
    """Return the names that code and the functions and comprehensions in it look up outside of themselves."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= _global_names(constant)
    return names


def _cache_key(args: tuple[Value, ...]) -> tuple[Value, ...] | None:
    """Return a key, equal only for equal arguments; None if an argument is long, or neither number nor matrix."""
    key: list[Value] = [_UNGUARDED.get()]
    for x in args:
        numbers = x
        if isinstance(x, Matrix):
            numbers = x.a
        if isinstance(numbers, float):
            key.append(numbers.hex())  # 0.0 and -0.0 are equal, but not their arc tangents
        elif isinstance(numbers, int):
            key.append(numbers)
        elif isinstance(numbers, np.ndarray) and numbers.dtype == np.float64 and numbers.size <= _LONGEST_ARGUMENT:
            key.append((type(x), numbers.shape, numbers.tobytes()))
        else:
            return None
    return tuple(key)


class Rebuilder:
    """Rebuilds functions for arrays; each function is rebuilt only once per instance."""

    def __init__(self) -> None:
        self._rebuilt: dict[int, Value] = {}
        """Rebuilt functions, modules and globals by the identity of the original."""
        self._originals: list[Value] = []  # references, so that their identities stay unique

    def function(self, function: Callable) -> Callable:
        """Return the function rebuilt with numeric globals, defaults and closure."""
        if id(function) in self._rebuilt:
            return self._rebuilt[id(function)]
        if not isinstance(function, types.FunctionType):
            raise KinematicsError(f"{function!r} is not a plain Python function: it cannot be evaluated on arrays")
        scope = self.scope(function)
        code = function.__code__
        if AUGMENTED_NAME in scope:
            code = rewritten(function)
        rebuilt = types.FunctionType(code, scope, function.__name__, function.__defaults__, function.__closure__)
        self._rebuilt[id(function)] = rebuilt  # before its closure, which may hold the function itself
        self._originals.append(function)
        if function.__closure__:
            cells: list[types.CellType] = []
            for cell in function.__closure__:
                cells.append(types.CellType(self.value(cell.cell_contents)))
            rebuilt = types.FunctionType(code, scope, function.__name__, function.__defaults__, tuple(cells))
            self._rebuilt[id(function)] = rebuilt
        rebuilt.__kwdefaults__ = function.__kwdefaults__
        is_plain = not function.__closure__ and not function.__kwdefaults__ and is_of_formula(function)
        # In the rebuilt globals, an edited function may stand in for one of the formula; in the module's it never does.
        if is_plain and _is_leaf(function):
            rebuilt = _with_cache(rebuilt)
            self._rebuilt[id(function)] = rebuilt
        return rebuilt

    def scope(self, f: types.FunctionType) -> dict[str, Value]:
        """Return the globals of a function, each replaced by its numeric counterpart."""
        home = f.__globals__
        if id(home) not in self._rebuilt:
            scope: dict[str, Value] = {}
            if uses_casadi(home):
                scope[AUGMENTED_NAME] = augmented  # first, because the functions below are rebuilt with this scope
            self._rebuilt[id(home)] = scope
            self._originals.append(home)
            for name, value in home.items():
                if not name.startswith("__"):
                    scope[name] = self.value(value)
            scope["__builtins__"] = home.get("__builtins__", __builtins__)
            if home.get("__name__") == _SYMBOLIC_MODULE:
                scope |= _NUMPY_VERSIONS
        return self._rebuilt[id(home)]

    def value(self, x: Value) -> Value:
        """Return the numeric counterpart of a global, or the global itself if there is none."""
        if isinstance(x, types.ModuleType):
            if x.__name__.split(".")[0] == "casadi":
                return types.SimpleNamespace(**_FUNCTIONS)
            if x.__name__ == _SYMBOLIC_MODULE or x.__name__.startswith("twin.robots."):
                return self._module(x)
            return x
        if _is_of_casadi(x):
            name = getattr(x, "__name__", "")
            return _FUNCTIONS.get(name, _unsupported(name or str(x)))
        if isinstance(x, types.FunctionType) and _needs_rebuilding(x):
            return self.function(x)
        return x

    def _module(self, module: types.ModuleType) -> types.SimpleNamespace:
        """Return a namespace with the numeric counterparts of what is in a module."""
        if id(module) not in self._rebuilt:
            space = types.SimpleNamespace()
            self._rebuilt[id(module)] = space
            for name, value in vars(module).items():
                if not name.startswith("__"):
                    counterpart = None
                    if module.__name__ == _SYMBOLIC_MODULE:
                        counterpart = _NUMPY_VERSIONS.get(name)
                    setattr(space, name, counterpart or self.value(value))
        return self._rebuilt[id(module)]


_UNCHANGED_MODULES = {
    "dataclasses",
    "typing",
    "twin.formula.contract",
    "twin.formula.functions",
    "twin.formula.lift",
    "twin.formula.quantities",
    "twin.formula.rows",
    "twin.formula.scalar",
}
"""Modules whose functions run unchanged: their operations on symbols also work with NumPy values."""


def _needs_rebuilding(f: types.FunctionType) -> bool:
    """Return whether a function may use CasADi, directly or through helpers, and must be rebuilt."""
    module = f.__globals__.get("__name__", "")
    if module.split(".")[0] == "twin" or module.startswith(FORMULA_MODULE):  # wherever they are installed
        return module not in _UNCHANGED_MODULES
    return not {"site-packages", "dist-packages"} & set(Path(f.__code__.co_filename).parts)


def is_of_formula(f: types.FunctionType) -> bool:
    """Return whether a function that a formula calls is in a formula file, not in the library."""
    path = Path(inspect.unwrap(f).__code__.co_filename).resolve()  # type: ignore[attr-defined]
    return not path.is_relative_to(_PACKAGE_FOLDER) or path.is_relative_to(_PACKAGE_FOLDER / "robots")


def _unsupported(name: str) -> Callable:
    """Return the stand-in for a function of CasADi without a counterpart: it raises a KinematicsError when called."""

    def refuse(*_: Value, **__: Value) -> Value:
        raise KinematicsError(f"`explain` has no NumPy version of casadi.{name}")

    return refuse


def to_array(x: Value, k: int) -> Array:
    """Return a scalar or matrix as an array (k, entries); matrix entries are in row-major order."""
    if isinstance(x, Matrix):
        a = x.a.reshape(len(x.a), -1)
    else:
        a = np.asarray(x, float).reshape(-1, 1)
    if len(a) == k:
        return a
    return np.broadcast_to(a, (k, a.shape[1]))
