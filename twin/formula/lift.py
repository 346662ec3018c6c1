"""Versions of NumPy and math that accept symbols (`Scalar`), to run a plain function on symbols.

The user's file imports NumPy. Most NumPy functions accept arrays of objects. This module adds the other cases: numbers
and symbols in one array, arrays of zeros to fill with symbols, conditions, `math.sin`, inverses of small matrices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from types import FunctionType, ModuleType, SimpleNamespace

import numpy as np

from twin.core.errors import no_inverse
from twin.formula.functions import as_floats, if_else
from twin.formula.loader import ModuleNames
from twin.formula.scalar import Scalar, Value

_NUMPY_OF_MATH = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "hypot": np.hypot,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "radians": np.radians,
    "degrees": np.degrees,
    "fabs": np.absolute,
    "pow": np.power,
}
"""{name of a function in `math`: equivalent NumPy function}."""

_COMPARISONS = (np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal)
"""Functions whose result for symbols is a condition, not a bool."""

_ARRAY_MAKER_NAMES = (
    "zeros",
    "ones",
    "eye",
    "identity",
    "empty",
    "full",
    "zeros_like",
    "ones_like",
    "empty_like",
    "full_like",
)
"""Names of functions that make an array which authors fill later, also with symbols."""


def lifted_globals(home: ModuleNames) -> ModuleNames:
    """Return the globals of a plain formula, with versions of NumPy and math that accept symbols.

    Functions of the same file are recreated with these globals.
    """
    names: ModuleNames = {}
    for name, value in home.items():
        if isinstance(value, FunctionType) and value.__globals__ is home:
            # its own code with other globals: the author's module stays as it is
            lifted_function = FunctionType(value.__code__, names, value.__name__, value.__defaults__, value.__closure__)
            lifted_function.__kwdefaults__ = value.__kwdefaults__
            names[name] = lifted_function
        else:
            names[name] = lifted(value)
    return names


def lifted(value: object) -> object:
    """Return NumPy, math or one of their functions as a version that accepts symbols; return other values unchanged."""
    if isinstance(value, ModuleType):
        return _MODULES.get(value.__name__, value)
    module = getattr(value, "__module__", "")
    if isinstance(value, np.ufunc):
        module = "numpy"
    if module in ("numpy", "numpy.linalg") and not callable(value):
        return value
    name = getattr(value, "__name__", "")
    if module == "numpy":
        return getattr(_NUMPY, name, value)
    if module == "numpy.linalg":
        return getattr(_LINALG, name, value)
    if module == "math":
        return getattr(_MODULES["math"], name)
    return value


class _LiftedModule:
    """Replacement of a module: each of its functions is converted to a version for symbols at first use."""

    def __init__(self, module: ModuleType, **special: object) -> None:
        self._module = module
        self.__dict__.update(special)

    def __getattr__(self, name: str) -> object:
        value = getattr(self._module, name)
        if isinstance(value, np.ufunc):
            value = _elementwise(value)
        elif callable(value) and not isinstance(value, type):
            value = _on_whole_arrays(value)
        setattr(self, name, value)
        return value


def _symbol_class(*values: object) -> type[Scalar] | None:
    """Return the class of the first symbol in values, lists and arrays; None if there is no symbol."""
    for value in values:
        if isinstance(value, Scalar):
            return type(value)
        kind_inside = None
        if isinstance(value, list | tuple):
            kind_inside = _symbol_class(*value)
        elif isinstance(value, np.ndarray) and value.dtype == object:
            kind_inside = _symbol_class(*value.ravel())
        if kind_inside is not None:
            return kind_inside
    return None


def _as_symbols(x: Value, kind: type[Scalar]) -> Value:
    """Convert a number or an array so that every entry is a symbol."""
    if isinstance(x, Scalar):
        return x
    if isinstance(x, np.ndarray | list | tuple):
        values = np.asarray(x, dtype=object)
        symbols = np.full(values.shape, None, dtype=object)
        for i, value in np.ndenumerate(values):
            symbols[i] = value if isinstance(value, Scalar) else kind(float(value))
        return symbols
    return kind(float(x))


def _numbers(x: Value) -> Value:
    """Return an array without symbols as an array of floats; return other values unchanged."""
    if isinstance(x, np.ndarray):
        return as_floats(x)
    return x


def _on_numbers(function: Callable[..., Value], args: Iterable[Value], kwargs: Mapping[str, object]) -> Value:
    """Return the result of a NumPy function for arguments without symbols."""
    numbers = map(_numbers, args)
    return function(*numbers, **kwargs)


def _elementwise(ufunc: np.ufunc) -> Callable[..., Value]:
    """Return a version of a function of single entries (a ufunc)."""

    def call(*args: Value, **kwargs: object) -> Value:
        kind = _symbol_class(*args)
        if kind is None:
            return _on_numbers(ufunc, args, kwargs)
        if ufunc in _COMPARISONS:
            kwargs["dtype"] = object  # otherwise the result would have to be True or False
        boxed = []
        for arg in args:
            boxed.append(_as_symbols(arg, kind))
        return ufunc(*boxed, **kwargs)

    call.__name__ = ufunc.__name__
    return call


def _on_whole_arrays(function: Callable[..., Value]) -> Callable[..., Value]:
    """Return a version of a function of whole arrays, such as `np.stack`."""

    def call(*args: Value, **kwargs: object) -> Value:
        kind = _symbol_class(*args)
        if kind is None:
            return _on_numbers(function, args, kwargs)
        # dtype float is dropped, because the array may contain symbols
        if kwargs.get("dtype") is float:
            del kwargs["dtype"]
        if function in (np.array, np.asarray) and len(args) == 2 and args[1] is float:
            args = args[:1]
        boxed: list[Value] = []
        for arg in args:
            if isinstance(arg, np.ndarray):
                arg = _as_symbols(arg, kind)
            boxed.append(arg)
        result = function(*boxed, **kwargs)
        if isinstance(result, np.ndarray) and result.dtype == object:
            return _as_symbols(result, kind)
        return result

    call.__name__ = function.__name__
    return call


def _filled_later(function: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """Return a version of `zeros`, `ones` or a similar function; symbols can be assigned to entries of its arrays."""

    def call(*args: Value, **kwargs: object) -> np.ndarray:
        array = _on_numbers(function, args, kwargs)
        if array.dtype == float:
            return array.astype(object)  # an array of floats takes no symbol as an entry
        return array

    call.__name__ = function.__name__
    return call


_less = _elementwise(np.less)
_greater = _elementwise(np.greater)


def _maximum(a: Value, b: Value) -> Value:
    """Return `np.maximum` for numbers and symbols."""
    return if_else(_less(a, b), b, a)


def _minimum(a: Value, b: Value) -> Value:
    """Return `np.minimum` for numbers and symbols."""
    return if_else(_less(a, b), a, b)


def _clip(x: Value, low: Value, high: Value) -> Value:
    """Return `np.clip` for numbers and symbols."""
    return _minimum(_maximum(x, low), high)


def _sign(x: Value) -> Value:
    """Return `np.sign` for numbers and symbols."""
    of_others = if_else(_greater(x, 0), 1.0, 0.0)
    return if_else(_less(x, 0), -1.0, of_others)


def _det(matrix: Value) -> Value:
    """Return the determinant of a square matrix of numbers or symbols."""
    matrix = np.asarray(matrix)
    if _symbol_class(matrix) is None:
        return np.linalg.det(_numbers(matrix))
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"a determinant takes a square matrix, not {matrix.shape}")
    if len(matrix) == 1:
        return matrix[0, 0]
    # Laplace's expansion along the first row
    total = 0
    for j in range(len(matrix)):
        total = total + (-1.0) ** j * matrix[0, j] * _det(_without(matrix, 0, j))
    return total


def _inv(matrix: Value) -> Value:
    """Return the inverse of a square matrix of numbers, or of symbols by cofactors."""
    matrix = np.asarray(matrix)
    if matrix.ndim == 2 and matrix.shape[0] != matrix.shape[1]:
        raise ValueError(no_inverse(*matrix.shape))
    kind = _symbol_class(matrix)
    if kind is None:
        return np.linalg.inv(_numbers(matrix))
    size = len(matrix)
    det = _det(matrix)
    inverse = np.full((size, size), None, dtype=object)
    for i in range(size):
        for j in range(size):
            # the cofactor of the transposed entry
            inverse[i, j] = (-1.0) ** (i + j) * _det(_without(matrix, j, i)) / det
    return _as_symbols(inverse, kind)


def _pinv(matrix: Value) -> Value:
    """Return the pseudoinverse; that of symbols is only right for a matrix of full rank."""
    matrix = np.asarray(matrix)
    if _symbol_class(matrix) is None:
        return np.linalg.pinv(_numbers(matrix))
    rows, columns = matrix.shape
    if rows < columns:
        return matrix.T @ _inv(matrix @ matrix.T)
    return _inv(matrix.T @ matrix) @ matrix.T


def _solve(a: Value, b: Value) -> Value:
    """Return the solution of a x = b; the arguments are named as in NumPy, because authors may give them by name."""
    return _inv(a) @ np.asarray(b)


def _without(matrix: np.ndarray, i: int, j: int) -> np.ndarray:
    """Return a matrix without row i and column j."""
    without_row = np.delete(matrix, i, axis=0)
    return np.delete(without_row, j, axis=1)


_ARRAY_MAKERS: dict[str, Callable[..., np.ndarray]] = {}
for _name in _ARRAY_MAKER_NAMES:
    _ARRAY_MAKERS[_name] = _filled_later(getattr(np, _name))
_LINALG = _LiftedModule(np.linalg, det=_det, inv=_inv, pinv=_pinv, solve=_solve)
_NUMPY = _LiftedModule(
    np,
    **_ARRAY_MAKERS,
    maximum=_maximum,
    fmax=_maximum,
    minimum=_minimum,
    fmin=_minimum,
    linalg=_LINALG,
    where=if_else,
    clip=_clip,
    sign=_sign,
)


def _of_math(name: str) -> Callable[..., Value]:
    """Return a version of a function of `math` that accepts symbols; numbers are left to `math`."""
    on_number = getattr(math, name)
    on_symbol = _elementwise(_NUMPY_OF_MATH[name])

    def call(*args: Value) -> Value:
        if _symbol_class(*args) is None:
            return on_number(*args)
        return on_symbol(*args)

    call.__name__ = name
    return call


_LIFTED_MATH = {name: _of_math(name) for name in _NUMPY_OF_MATH}
_MODULES: dict[str, _LiftedModule | SimpleNamespace] = {
    "numpy": _NUMPY,
    "numpy.linalg": _LINALG,
    "math": SimpleNamespace(**(vars(math) | _LIFTED_MATH)),
}
