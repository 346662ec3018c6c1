"""Versions of NumPy and math that accept symbols (`Scalar`), to run a plain function on symbols.

The user's file imports NumPy. Most NumPy functions accept arrays of objects. This module adds the other cases: numbers
and symbols in one array, arrays of zeros to fill with symbols, conditions, `math.sin`, inverses of small matrices.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from twin.core.errors import no_inverse
from twin.formula.functions import if_else, plain
from twin.formula.scalar import Scalar

_MATH = {
    **{n: getattr(np, n) for n in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "hypot")},
    **{f"a{n}": getattr(np, f"arc{n}") for n in ("sin", "cos", "tan", "tan2")},
    **{n: getattr(np, n) for n in ("radians", "degrees")},
    "fabs": np.absolute,
    "pow": np.power,
}
"""{name of a function in `math`: equivalent NumPy function}."""

_COMPARE = (np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal)

_MAKE = ("zeros", "ones", "eye", "identity", "empty", "full", "zeros_like", "ones_like", "empty_like", "full_like")


def scope(home: dict[str, Any]) -> dict[str, Any]:
    """Return the globals of a plain formula, with versions of NumPy and math that accept symbols.

    Functions of the same file are recreated with these globals.
    """
    out: dict[str, Any] = {}
    for name, value in home.items():
        if isinstance(value, FunctionType) and value.__globals__ is home:
            new = FunctionType(value.__code__, out, value.__name__, value.__defaults__, value.__closure__)
            new.__kwdefaults__ = value.__kwdefaults__
            out[name] = new
        else:
            out[name] = lifted(value)
    return out


def lifted(value: Any) -> Any:
    """Return NumPy, math or one of their functions as a version that accepts symbols; return other values unchanged."""
    if isinstance(value, ModuleType):
        return _MODULES.get(value.__name__, value)
    if isinstance(value, np.ufunc) or getattr(value, "__module__", "") in ("numpy", "numpy.linalg"):
        space = _LINALG if getattr(value, "__module__", "") == "numpy.linalg" else _NUMPY
        return getattr(space, value.__name__, value) if callable(value) else value
    if getattr(value, "__module__", "") == "math":
        return getattr(_MODULES["math"], value.__name__)
    return value


class _Space:
    """Replacement of a module: each of its functions is converted to a version for symbols at first use."""

    def __init__(self, module: Any, **special: Any) -> None:
        self._module = module
        self.__dict__.update(special)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name)
        if isinstance(value, np.ufunc):
            value = _elementwise(value)
        elif callable(value) and not isinstance(value, type):
            value = _whole(value)
        setattr(self, name, value)
        return value


def _kind(*values: Any) -> type[Scalar] | None:
    """Return the class of the first symbol in values, lists and arrays; None if there is no symbol."""
    for v in values:
        if isinstance(v, Scalar):
            return type(v)
        if isinstance(v, list | tuple) or (isinstance(v, np.ndarray) and v.dtype == object):
            found = _kind(*(v if isinstance(v, list | tuple) else v.ravel()))
            if found is not None:
                return found
    return None


def _boxed(x: Any, kind: type[Scalar]) -> Any:
    """Convert a number or an array so that every entry is a symbol."""
    if isinstance(x, Scalar):
        return x
    if isinstance(x, np.ndarray | list | tuple):
        a = np.asarray(x, dtype=object)
        out = np.full(a.shape, None, dtype=object)
        for i, v in np.ndenumerate(a):
            out[i] = v if isinstance(v, Scalar) else kind(float(v))
        return out
    return kind(float(x))


def _numbers(x: Any) -> Any:
    return plain(x) if isinstance(x, np.ndarray) else x


def _elementwise(f: Any) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        kind = _kind(*args)
        if kind is None:
            return f(*map(_numbers, args), **kwargs)
        if f in _COMPARE:
            kwargs["dtype"] = object  # otherwise the result would have to be True or False
        return f(*(_boxed(a, kind) for a in args), **kwargs)

    call.__name__ = f.__name__
    return call


def _whole(f: Callable[..., Any]) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        kind = _kind(*args)
        if kind is None:
            return f(*map(_numbers, args), **kwargs)
        if kwargs.get("dtype") is float:  # dtype float is dropped, because the array may contain symbols
            del kwargs["dtype"]
        if f in (np.array, np.asarray) and len(args) == 2 and args[1] is float:
            args = args[:1]
        out = f(*(_boxed(a, kind) if isinstance(a, np.ndarray) else a for a in args), **kwargs)
        return _boxed(out, kind) if isinstance(out, np.ndarray) and out.dtype == object else out

    call.__name__ = f.__name__
    return call


def _filled_later(f: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """Return a version of `zeros`, `ones` or a similar function; symbols can be assigned to entries of its arrays."""

    def call(*args: Any, **kwargs: Any) -> np.ndarray:
        made = f(*map(_numbers, args), **kwargs)
        return made.astype(object) if made.dtype == float else made

    call.__name__ = f.__name__
    return call


def _maximum(a: Any, b: Any) -> Any:
    return if_else(_NUMPY.less(a, b), b, a)


def _minimum(a: Any, b: Any) -> Any:
    return if_else(_NUMPY.less(a, b), a, b)


def _clip(x: Any, low: Any, high: Any) -> Any:
    return _minimum(_maximum(x, low), high)


def _sign(x: Any) -> Any:
    return if_else(_NUMPY.less(x, 0), -1.0, if_else(_NUMPY.greater(x, 0), 1.0, 0.0))


def _det(A: Any) -> Any:
    A = np.asarray(A)
    if _kind(A) is None:
        return np.linalg.det(_numbers(A))
    if A.ndim != 2 or A.shape[0] != A.shape[1]:
        raise ValueError(f"a determinant takes a square matrix, not {A.shape}")
    if len(A) == 1:
        return A[0, 0]
    return sum((-1.0) ** j * A[0, j] * _det(_without(A, 0, j)) for j in range(len(A)))


def _inv(A: Any) -> Any:
    A = np.asarray(A)
    if A.ndim == 2 and A.shape[0] != A.shape[1]:
        raise ValueError(no_inverse(*A.shape))
    kind = _kind(A)
    if kind is None:
        return np.linalg.inv(_numbers(A))
    n, det = len(A), _det(A)
    rows = [[(-1.0) ** (i + j) * _det(_without(A, j, i)) / det for j in range(n)] for i in range(n)]
    return _boxed(rows, kind)


def _pinv(A: Any) -> Any:
    A = np.asarray(A)
    if _kind(A) is None:
        return np.linalg.pinv(_numbers(A))
    return A.T @ _inv(A @ A.T) if A.shape[0] < A.shape[1] else _inv(A.T @ A) @ A.T


def _solve(A: Any, b: Any) -> Any:
    return _inv(A) @ np.asarray(b)


def _without(A: np.ndarray, i: int, j: int) -> np.ndarray:
    return np.delete(np.delete(A, i, 0), j, 1)


_LINALG = _Space(np.linalg, det=_det, inv=_inv, pinv=_pinv, solve=_solve)
_NUMPY = _Space(
    np,
    **{n: _filled_later(getattr(np, n)) for n in _MAKE},
    **dict.fromkeys(("maximum", "fmax"), _maximum),
    **dict.fromkeys(("minimum", "fmin"), _minimum),
    linalg=_LINALG,
    where=if_else,
    clip=_clip,
    sign=_sign,
)


def _of_math(name: str, f: Callable[..., Any]) -> Callable[..., Any]:
    other = _elementwise(_MATH[name])

    def call(*args: Any) -> Any:
        return f(*args) if _kind(*args) is None else other(*args)

    call.__name__ = name
    return call


_MODULES: dict[str, Any] = {
    "numpy": _NUMPY,
    "numpy.linalg": _LINALG,
    "math": SimpleNamespace(**{**vars(math), **{n: _of_math(n, getattr(math, n)) for n in _MATH}}),
}
