"""Wrapper of one function of a plain formula: conversion of arguments and outputs, errors with file and line."""

from __future__ import annotations

import ast
import inspect
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import FunctionType

import numpy as np

from twin.core.errors import KinematicsError, unknown
from twin.formula.loader import text_of
from twin.formula.scalar import NeedsNumberError, Value

POSE = "pose"
"""Name of the argument that receives the whole pose (4, 4)."""

JOINTS = "q"
"""Name of the argument that receives all active joints (n,), unless a joint has this name."""


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
        symbols_known: Iterable[str],
        pose: str,
        casadi: bool,
        unread: Iterable[str] = (),
    ) -> None:
        """Check the arguments of a function against the available symbols.

        `unread` are symbols that no function uses; an error about an unknown argument suggests these symbols.

        Raises:
            KinematicsError: an argument is unknown; the message gives file and line.
        """
        self.name = name
        self.path = path
        self.joints = tuple(joints)
        self.pose = pose
        self.casadi = casadi
        self.function = function
        self.__wrapped__ = function
        self.__name__ = name
        self.__qualname__ = name
        self.__doc__ = function.__doc__
        self.line = function.__code__.co_firstlineno
        self.end = _last_return(path, function)
        self.outputs: tuple[str, ...] = ()
        symbols_known = {*symbols_known, *self.joints, POSE, JOINTS, pose}
        self.argument_names: list[str] = []
        for parameter in inspect.signature(function).parameters.values():
            if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD, parameter.POSITIONAL_ONLY):
                raise self.error(f"{name}() must have named arguments: replace '{parameter}' by names", self.line)
            if parameter.name not in symbols_known:
                text = unknown("symbol", parameter.name, symbols_known, unread)
                raise self.error(f"{name}() uses '{parameter.name}'; {text}", self.line)
            self.argument_names.append(parameter.name)
        # the signature names symbols: those of which `pose` and `q` consist
        symbols: list[str] = []
        for argument in self.argument_names:
            if argument == JOINTS and JOINTS not in self.joints:
                symbols += self.joints
            elif argument == POSE:
                symbols.append(pose)
            else:
                symbols.append(argument)
        parameters = []
        for symbol in dict.fromkeys(symbols):
            parameters.append(inspect.Parameter(symbol, inspect.Parameter.KEYWORD_ONLY))
        self.__signature__ = inspect.Signature(parameters)

    @abstractmethod
    def __call__(self, **symbols: Value) -> Value:
        """Return the outputs for the values of the symbols."""

    def arguments(
        self, symbols: Mapping[str, Value], convert: Callable[[Value], Value], join: Callable[..., Value]
    ) -> dict[str, Value]:
        """Return {argument: value} for a call of the function, from the values of the symbols.

        `convert` converts one value to the form that the function requires; `join` joins several values to one array.
        """
        values = {}
        for argument in self.argument_names:
            if argument == POSE:
                values[argument] = convert(symbols[self.pose])
            elif argument == JOINTS and JOINTS not in self.joints:
                q = [symbols[joint] for joint in self.joints]
                values[argument] = join(*q)
            elif argument in symbols:
                values[argument] = convert(symbols[argument])
        return values

    def spread(self, value: object, split: Callable[[object], list[Value] | None]) -> list[Value]:
        """Return the function's result as a list with one value for each output.

        The result is a sequence, a column, or a dictionary {output: value}. `split` returns the entries of a
        one-dimensional array or of a column, and None for any other value.

        Raises:
            KinematicsError: there are too many or too few outputs, or wrong names; the message gives file and line.
        """
        names = self.outputs
        if isinstance(value, Mapping):
            differences = []
            for name in names:
                if name not in value:
                    differences.append(f"'{name}' is missing")
            for name in value:
                if name not in names:
                    differences.append(f"'{name}' is unknown")
            if differences:
                what = "points" if self.name == "points" else "active joints"
                expected = f"{what} {', '.join(names)}"
                text = ", ".join(differences)
                raise self.error(f"{self.name}() returns names that differ from the {expected}: {text}")
            return [value[name] for name in names]
        if self.name == "forward":  # a pose is one output, though it may be a list of rows
            return [value]
        values = list(value) if isinstance(value, tuple | list) else split(value)
        if values is None:
            values = [value]
        if len(values) != len(names):
            noun = "value" if len(values) == 1 else "values"
            raise self.error(
                f"{self.name}() returns {len(values)} {noun} for the {len(names)} active joints {', '.join(names)}, "
                "in the order of the robot's TOML file"
            )
        return values

    def error(self, text: str, line: int | None = None) -> KinematicsError:
        """Return an error whose message has the file, the line and a text; default line: that of the last return."""
        return KinematicsError(f"{self.path}:{line or self.end}: {text}.")

    def located(self, error: BaseException) -> KinematicsError:
        """Return a `KinematicsError` with the reason of `error` and its last traceback line that is in this file."""
        line = self.line
        for frame in traceback.extract_tb(error.__traceback__):
            if frame.filename == str(self.path):
                line = frame.lineno
        return self.error(f"{self.name}(): {reason(error)}", line)


def reason(error: BaseException) -> str:
    """Return the message about an error in a plain formula, for the author of the formula."""
    text = " ".join(str(error).split()).rstrip(".")
    if isinstance(error, NeedsNumberError):
        return text
    if "truth value of a CasADi" in text:
        return _CASADI_IF
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
    """Return the line of the function's last `return`; if there is none, or no readable file, that of its `def`."""
    first_line = function.__code__.co_firstlineno
    try:
        tree = ast.parse(text_of(path, function.__globals__))
    except (OSError, SyntaxError):
        return first_line
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.lineno <= first_line <= (node.end_lineno or 0):
            if node.name != function.__name__:  # a function around it
                continue
            return_lines = []
            for inner in ast.walk(node):
                if isinstance(inner, ast.Return):
                    return_lines.append(inner.lineno)
            return max(return_lines, default=first_line)
    return first_line


def entries(array: object) -> list[Value] | None:
    """Return the entries of an array (n,), (n, 1) or (1, n); None for any other shape."""
    if isinstance(array, np.ndarray) and array.ndim in (1, 2) and array.size == max(array.shape):
        return list(array.ravel())
    return None
