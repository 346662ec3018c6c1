"""Wrapper of one function of a plain formula: conversion of arguments and outputs, errors with file and line."""

from __future__ import annotations

import ast
import inspect
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from twin.core.errors import KinematicsError, unknown
from twin.formula.loader import text_of
from twin.formula.scalar import NeedsNumberError

POSE, JOINTS = "pose", "q"
"""Names of the arguments that receive the whole pose (4, 4), and all active joints (n,)."""


class PlainRows(ABC):
    """Wrapper of a plain function (see `twin.formula.plain`): takes symbols by name and returns a tuple of outputs.

    Attributes:
        name: "inverse", "forward" or "points".
        path: file of the function.
        line: line of the function's `def`.
        end: line of the function's last `return`.
        function: the function, with globals that accept symbols.
        casadi: whether the arguments are CasADi matrices, because the file imports CasADi; otherwise NumPy arrays.
        joints: names of the active joints, in order.
        pose: symbol of the pose.
        outputs: names of the outputs, in order.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        function: FunctionType,
        joints: Sequence[str],
        known: Iterable[str],
        pose: str,
        casadi: bool,
        unread: Iterable[str] = (),
    ) -> None:
        """Check the arguments of a function against the available symbols.

        `unread` are symbols that no function uses; an error about an unknown argument suggests these symbols.

        Raises:
            KinematicsError: an argument is unknown; the message gives file and line.
        """
        self.name, self.path, self.joints, self.pose, self.casadi = name, path, tuple(joints), pose, casadi
        self.function = self.__wrapped__ = function
        self.__name__ = self.__qualname__ = name
        self.__doc__ = function.__doc__
        self.line, self.end = function.__code__.co_firstlineno, _last_return(path, function)
        self.outputs: tuple[str, ...] = ()
        known = {*known, *self.joints, POSE, JOINTS, pose}
        self.argument_names: list[str] = []
        for p in inspect.signature(function).parameters.values():
            if p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD, p.POSITIONAL_ONLY):
                raise self.error(f"{name}() must have named arguments: replace '{p}' by names", self.line)
            if p.name not in known:
                raise self.error(f"{name}() uses '{p.name}'; {unknown('symbol', p.name, known, unread)}", self.line)
            self.argument_names.append(p.name)
        wanted: list[str] = []
        for n in self.argument_names:
            if n == JOINTS and JOINTS not in self.joints:
                wanted += self.joints
            else:
                wanted.append(pose if n == POSE else n)
        kind = inspect.Parameter.KEYWORD_ONLY
        self.__signature__ = inspect.Signature([inspect.Parameter(n, kind) for n in dict.fromkeys(wanted)])

    @abstractmethod
    def __call__(self, **symbols: Any) -> Any:
        """Return the outputs for the values of the symbols."""

    def arguments(self, symbols: Mapping[str, Any], convert: Callable[[Any], Any], join: Callable[..., Any]) -> dict:
        """Return {argument: value} for a call of the function, from the values of the symbols.

        `convert` converts one value to the form that the function requires; `join` joins several values to one array.
        """
        out = {}
        for n in self.argument_names:
            if n == POSE:
                out[n] = convert(symbols[self.pose])
            elif n == JOINTS and JOINTS not in self.joints:
                out[n] = join(*(symbols[j] for j in self.joints))
            elif n in symbols:
                out[n] = convert(symbols[n])
        return out

    def spread(self, value: Any, split: Callable[[Any], list[Any] | None]) -> list[Any]:
        """Return the function's result as a list with one value for each output.

        The result is a sequence, a column, or a dictionary {output: value}. `split` returns the entries of a
        one-dimensional array or of a column, and None for any other value.

        Raises:
            KinematicsError: there are too many or too few outputs, or wrong names; the message gives file and line.
        """
        names = self.outputs
        if isinstance(value, Mapping):
            wrong = [f"'{n}' is missing" for n in names if n not in value]
            wrong += [f"'{n}' is unknown" for n in value if n not in names]
            if wrong:
                what = "points" if self.name == "points" else "active joints"
                text = ", ".join(names)
                raise self.error(f"{self.name}() returns names that differ from the {what} {text}: {', '.join(wrong)}")
            return [value[n] for n in names]
        if self.name == "forward":
            return [value]
        parts = list(value) if isinstance(value, tuple | list) else split(value)
        if parts is None:
            parts = [value]
        if len(parts) != len(names):
            raise self.error(
                f"{self.name}() returns {len(parts)} value{'s' * (len(parts) != 1)} for the {len(names)} active "
                f"joints {', '.join(names)}, in the order of the robot's TOML file"
            )
        return parts

    def error(self, text: str, line: int | None = None) -> KinematicsError:
        """Return an error whose message has the file, the line and a text; default line: that of the last return."""
        return KinematicsError(f"{self.path}:{line or self.end}: {text}.")

    def located(self, error: BaseException) -> KinematicsError:
        """Return a `KinematicsError` with the reason of `error` and its last traceback line that is in this file."""
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(self.path)]
        return self.error(f"{self.name}(): {reason(error)}", lines[-1] if lines else self.line)


def reason(error: BaseException) -> str:
    """Return the message about an error in a plain formula, for the author of the formula."""
    text = " ".join(str(error).split()).rstrip(".")
    if isinstance(error, NeedsNumberError) or "truth value of a CasADi" in text:
        return text if isinstance(error, NeedsNumberError) else _CASADI_IF
    if isinstance(error, FloatingPointError):
        return f"{text}: a root or arc function is out of range, or a number is divided by zero"
    if isinstance(error, FutureWarning) and "casadi" in text:
        return "a NumPy function is called on a CasADi value: use the CasADi function, or use NumPy only"
    if "loop of ufunc" in text or "unsupported operand" in text:
        text = text.replace("Symbol", "symbol")
        return f"{text}: twin cannot differentiate this operation; use NumPy's elementary functions"
    return f"{type(error).__name__}: {text}"


_CASADI_IF = (
    "`if`, `and` and `not` do not work on values that depend on the pose or the joints. "
    "Write casadi.if_else(condition, yes, no)"
)


def _last_return(path: Path, function: FunctionType) -> int:
    first = function.__code__.co_firstlineno
    try:
        tree = ast.parse(text_of(path, function.__globals__))
    except (OSError, SyntaxError):
        return first
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.lineno <= first <= (node.end_lineno or 0):
            if node.name != function.__name__:
                continue
            return max((n.lineno for n in ast.walk(node) if isinstance(n, ast.Return)), default=first)
    return first


def entries(array: Any) -> list[Any] | None:
    """Return the entries of an array (n,), (n, 1) or (1, n); None for any other shape."""
    if isinstance(array, np.ndarray) and array.ndim in (1, 2) and array.size == max(array.shape):
        return list(array.ravel())
    return None
