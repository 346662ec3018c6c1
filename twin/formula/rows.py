"""One function of a plain formula: what it asks for, what it gives back, and where in the file it goes wrong."""

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
from twin.formula.scalar import NeedsNumberError

POSE, JOINTS = "pose", "q"
"""Arguments that stand for the whole pose (4, 4) and for all active joints (n,)."""


class PlainRows(ABC):
    """A plain function in the form that a flow of symbols calls: its symbols by name, a tuple of its outputs.

    Attributes:
        name: "inverse", "forward" or "points".
        path: the file. line: of its `def`. end: of its last `return`.
        function: the function, in globals that understand symbols.
        casadi: whether it takes CasADi's matrices, because its file imports CasADi; else NumPy's arrays.
        joints: names of the active joints, in order.
        pose: name of the symbol that the pose is.
        outputs: names of what it returns, in order.
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
        """Check the arguments of a function against the symbols that it may ask for.

        `unread` are those that have a value and that no function asks for: where one is missing, they are meant.

        Raises:
            KinematicsError: an argument is not known; with file and line.
        """
        self.name, self.path, self.joints, self.pose, self.casadi = name, path, tuple(joints), pose, casadi
        self.function = self.__wrapped__ = function
        self.__name__ = self.__qualname__ = name
        self.__doc__ = function.__doc__
        self.line, self.end = function.__code__.co_firstlineno, _last_return(path, function)
        self.outputs: tuple[str, ...] = ()
        known = {*known, *self.joints, POSE, JOINTS, pose}
        self.asked: list[str] = []
        for p in inspect.signature(function).parameters.values():
            if p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD, p.POSITIONAL_ONLY):
                raise self.error(f"{name}() takes its arguments by name: replace '{p}' by names", self.line)
            if p.name not in known:
                raise self.error(f"{name}() asks for '{p.name}'; {unknown('symbol', p.name, known, unread)}", self.line)
            self.asked.append(p.name)
        wanted: list[str] = []
        for n in self.asked:
            if n == JOINTS and JOINTS not in self.joints:
                wanted += self.joints
            else:
                wanted.append(pose if n == POSE else n)
        kind = inspect.Parameter.KEYWORD_ONLY
        self.__signature__ = inspect.Signature([inspect.Parameter(n, kind) for n in dict.fromkeys(wanted)])

    @abstractmethod
    def __call__(self, **symbols: Any) -> Any:
        """Return the outputs for symbols of CasADi, which this room does not know."""

    def given(self, symbols: Mapping[str, Any], convert: Callable[[Any], Any], join: Callable[..., Any]) -> dict:
        """Return the arguments out of the symbols; `convert` turns one into what the function takes, `join` several."""
        out = {}
        for n in self.asked:
            if n == POSE:
                out[n] = convert(symbols[self.pose])
            elif n == JOINTS and JOINTS not in self.joints:
                out[n] = join(*(symbols[j] for j in self.joints))
            elif n in symbols:
                out[n] = convert(symbols[n])
        return out

    def spread(self, value: Any, split: Callable[[Any], list[Any] | None]) -> list[Any]:
        """Return one value for each output.

        Args:
            value: what the function returned: values in order, one column, or a dictionary by name.
            split: the entries of a column or array of one dimension; None for anything else.

        Raises:
            KinematicsError: too many, too few, or of other names; with file and line.
        """
        names = self.outputs
        if isinstance(value, Mapping):
            wrong = [f"'{n}' is missing" for n in names if n not in value]
            wrong += [f"'{n}' is too many" for n in value if n not in names]
            if wrong:
                what = "points" if self.name == "points" else "active joints"
                text = ", ".join(names)
                raise self.error(f"{self.name}() returns other names than the {what} {text}: {', '.join(wrong)}")
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
        """Return an error at a line of the file; default the last return."""
        return KinematicsError(f"{self.path}:{line or self.end}: {text}.")

    def located(self, error: BaseException) -> KinematicsError:
        """Return the error at the innermost line of this file that led to another error."""
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(self.path)]
        return self.error(f"{self.name}(): {reason(error)}", lines[-1] if lines else self.line)


def reason(error: BaseException) -> str:
    """Return what an error that came out of a plain formula means to its author."""
    text = " ".join(str(error).split()).rstrip(".")
    if isinstance(error, NeedsNumberError) or "truth value of a CasADi" in text:
        return text if isinstance(error, NeedsNumberError) else _CASADI_IF
    if isinstance(error, FloatingPointError):
        return f"{text}: the root or arc of a number out of range, or a division by zero"
    if isinstance(error, FutureWarning) and "casadi" in text:
        return "a NumPy function is called on a CasADi value: use CasADi's, or leave CasADi out and use NumPy alone"
    if "loop of ufunc" in text or "unsupported operand" in text:
        text = text.replace("Symbol", "symbol")
        return f"{text}: twin cannot differentiate this; write it with NumPy's elementary functions"
    return f"{type(error).__name__}: {text}"


_CASADI_IF = (
    "`if`, `and`, `not` need to know now whether this is true, but it depends on the pose or the joints. "
    "Write casadi.if_else(condition, yes, no)"
)


def _last_return(path: Path, function: FunctionType) -> int:
    first = function.__code__.co_firstlineno
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError):
        return first
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.lineno <= first <= (node.end_lineno or 0):
            if node.name != function.__name__:
                continue
            return max((n.lineno for n in ast.walk(node) if isinstance(n, ast.Return)), default=first)
    return first


def entries(array: Any) -> list[Any] | None:
    """Return the entries of an array (n,), (n, 1) or (1, n); None if it is none."""
    if isinstance(array, np.ndarray) and array.ndim in (1, 2) and array.size == max(array.shape):
        return list(array.ravel())
    return None
