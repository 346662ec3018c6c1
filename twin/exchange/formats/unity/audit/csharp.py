"""Interpret a small subset of C#, so that a script can be checked by running its static numeric functions.

Supported: constants, static methods with overloads by the types of their parameters, local variables, assignment,
`if`, `return`, the conditional operator, arithmetic, casts of numbers, members and constructors of plain values,
`Math` and enumerations. Other code raises `CSharpError`.
"""

from __future__ import annotations

import math
import operator as op
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

_TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:[eE][-+]?\d+)?)[fFdD]?|([A-Za-z_]\w*)|(==|!=|<=|>=|&&|\|\||[-+*/]=|.))", re.DOTALL
)
_METHOD = re.compile(r"\bstatic\s+(\w+)\s+(\w+)\s*\(([^)]*)\)\s*\{")
_CONSTANT = re.compile(r"\bconst\s+\w+\s+(\w+)\s*=\s*([^;]+);")
_MATH: dict[str, Any] = {
    **{
        n: getattr(math, n.lower())
        for n in ("Sin", "Cos", "Tan", "Asin", "Acos", "Atan", "Atan2", "Sqrt", "Exp", "Log")
    },
    **{"Abs": abs, "Min": min, "Max": max, "Pow": pow},
}
_MOST_CALLS = 10_000
"""Maximum number of method calls of one script: a recursive method could run for years."""

_NUMERIC = ("double", "float", "int", "long")
_LEVELS = (("||",), ("&&",), ("==", "!="), ("<", ">", "<=", ">="), ("+", "-"), ("*", "/"))


def _divided(a: float, b: float) -> float:
    """Return a / b as in C#: division by zero gives infinity or NaN, without an exception."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.float64(a) / np.float64(b))


_APPLY: dict[str, Callable[[Any, Any], Any]] = {
    **{"==": op.eq, "!=": op.ne, "<": op.lt, ">": op.gt, "<=": op.le, ">=": op.ge},
    **{"+": op.add, "-": op.sub, "*": op.mul, "/": _divided},
}


class CSharpError(Exception):
    """The C# code is unsupported, or fails when it runs."""


@dataclass(frozen=True)
class Value:
    """A C# struct, such as a vector or quaternion: type name, and components x, y, z (and w)."""

    type: str
    numbers: tuple[float, ...]

    def member(self, name: str) -> float:
        """Return the component with the given name (x, y, z or w)."""
        if name not in "xyzw"[: len(self.numbers)]:
            raise CSharpError(f"{self.type} has no '{name}'")
        return self.numbers["xyzw".index(name)]


class Script:
    """The static methods of a source file.

    Raises:
        CSharpError: a method has no closing brace. Unsupported code causes an error only when `call` runs the method.
    """

    def __init__(self, source: str) -> None:
        text = re.sub(r"//[^\n]*|/\*.*?\*/", " ", source, flags=re.DOTALL)
        self._methods: dict[str, list[tuple[list[tuple[str, str]], str]]] = {}
        for m in _METHOD.finditer(text):
            params = [tuple(p.split()[-2:]) for p in m[3].split(",") if p.strip()]
            self._methods.setdefault(m[2], []).append(([(t, n) for t, n in params], _block(text, m.end() - 1)))
        self._calls = 0
        self._constants = {m[1]: m[2] for m in _CONSTANT.finditer(text)}

    def has(self, name: str) -> bool:
        """Return whether the script has a method with the given name."""
        return name in self._methods

    def call(self, name: str, *given: Any) -> Any:
        """Run a method and return its result; the arguments are numbers, `Value`s or names of enumeration members.

        Raises:
            CSharpError: no overload accepts arguments of the given types, or the code is unsupported.
        """
        self._calls += 1
        if self._calls > _MOST_CALLS:
            raise CSharpError(f"the script calls methods more than {_MOST_CALLS} times")
        for params, body in self._methods.get(name, []):
            pairs = zip(params, given, strict=False)
            if len(params) == len(given) and all(not isinstance(g, Value) or g.type == t for (t, _), g in pairs):
                scope = {n: g for (_, n), g in zip(params, given, strict=True)}
                done, result = _Run(self, body, scope).statements()
                if not done:
                    raise CSharpError(f"{name} returns nothing")
                return result
        raise CSharpError(f"no method '{name}' accepts {len(given)} arguments of these types")

    def constant(self, name: str) -> float:
        """Return the value of the constant with the given name in the script."""
        if name not in self._constants:
            raise CSharpError(f"there is no constant '{name}'")
        return _Run(self, self._constants[name], {}).expression()


def _block(text: str, start: int) -> str:
    """Return the text between the opening brace at `start` and the matching closing brace."""
    depth = 0
    for i in range(start, len(text)):
        depth += {"{": 1, "}": -1}.get(text[i], 0)
        if depth == 0:
            return text[start + 1 : i]
    raise CSharpError("an opening brace has no closing brace")


class _Run:
    """Parser and interpreter of one method, in one pass without a syntax tree: methods are short and seldom run."""

    def __init__(self, script: Script, text: str, scope: dict[str, Any]) -> None:
        self._script, self._scope = script, scope
        self._tokens = [
            m.group(m.lastindex or 0) for m in _TOKEN.finditer(text) if m.lastindex and m[m.lastindex].strip()
        ]
        self._at = 0

    # ------------------------------------------------------------------------------------------ statements

    def statements(self, live: bool = True) -> tuple[bool, Any]:
        """Run the statements up to the end of the text or a closing brace; if `live` is False, only parse them.

        Return (returned, value): whether a `return` statement ran, and the value that it returned.
        """
        done, result = False, None
        while self._at < len(self._tokens) and self._peek() != "}":
            one, value = self._statement(live and not done)
            if one:
                done, result = True, value
        return done, result

    def _statement(self, live: bool) -> tuple[bool, Any]:
        if self._take("{"):
            out = self.statements(live)
            self._need("}")
            return out
        if self._take("if"):
            self._need("(")
            chosen = bool(self.expression())
            self._need(")")
            out = self._statement(live and chosen)
            if self._take("else"):
                other = self._statement(live and not chosen)
                out = out if chosen else other
            return out if live else (False, None)
        if self._take("return"):
            value = self.expression() if live else self._skip()
            self._need(";")
            return live, value
        name = self._next()
        if re.fullmatch(r"[A-Za-z_]\w*", self._peek()):  # the previous token was a type
            name = self._next()
        operator = self._next()
        if operator not in ("=", "+=", "-=", "*=", "/="):
            raise CSharpError(f"'{name} {operator}' is not supported")
        if live:
            value = self.expression()
            self._scope[name] = value if operator == "=" else _APPLY[operator[0]](self._scope[name], value)
        else:
            self._skip()
        self._need(";")
        return False, None

    def _skip(self) -> None:
        while self._peek() != ";":
            self._next()

    # ------------------------------------------------------------------------------------------ expressions

    def expression(self) -> Any:
        value = self._binary(0)
        if self._take("?"):
            yes = self.expression()
            self._need(":")
            no = self.expression()
            return yes if value else no
        return value

    def _binary(self, level: int) -> Any:
        if level == len(_LEVELS):
            return self._unary()
        value = self._binary(level + 1)
        while self._peek() in _LEVELS[level]:
            operator = self._next()
            other = self._binary(level + 1)
            if operator in ("&&", "||"):
                value = (value and other) if operator == "&&" else (value or other)
            else:
                value = _APPLY[operator](value, other)
        return value

    def _unary(self) -> Any:
        if self._take("-"):
            return -self._unary()
        if self._take("!"):
            return not self._unary()
        if self._peek() == "(" and self._peek(1) in _NUMERIC and self._peek(2) == ")":
            self._at += 3
            return self._unary()
        value = self._primary()
        while self._take("."):
            name = self._next()
            if not isinstance(value, Value):
                raise CSharpError(f"'.{name}' is not supported")
            value = value.member(name)
        return value

    def _primary(self) -> Any:
        token = self._next()
        if token == "(":
            value = self.expression()
            self._need(")")
            return value
        if token[0].isdigit():
            return float(token)
        if token == "new":
            name = self._next()
            return Value(name, tuple(map(float, self._arguments())))
        if token in self._scope:
            return self._scope[token]
        if self._peek() == "(":
            return self._script.call(token, *self._arguments())
        if self._peek() == "." and token[0].isupper():
            self._at += 1
            return self._static(token, self._next())
        return self._script.constant(token)

    def _static(self, owner: str, name: str) -> Any:
        if owner in ("Math", "Mathf") and name in _MATH:
            try:
                return float(_MATH[name](*self._arguments()))
            except ValueError:
                return math.nan
        if (owner, name) == ("Quaternion", "identity"):
            return Value("Quaternion", (0.0, 0.0, 0.0, 1.0))
        if self._peek() == "(":
            raise CSharpError(f"{owner}.{name}() is not supported")
        return name  # the value of an enumeration member is its name

    def _arguments(self) -> list[Any]:
        self._need("(")
        out = []
        while not self._take(")"):
            out.append(self.expression())
            self._take(",")
        return out

    # ------------------------------------------------------------------------------------------ tokens

    def _peek(self, ahead: int = 0) -> str:
        return self._tokens[self._at + ahead] if self._at + ahead < len(self._tokens) else ""

    def _next(self) -> str:
        token = self._peek()
        if not token:
            raise CSharpError("the source ends within a statement")
        self._at += 1
        return token

    def _take(self, token: str) -> bool:
        if self._peek() != token:
            return False
        self._at += 1
        return True

    def _need(self, token: str) -> None:
        if not self._take(token):
            raise CSharpError(f"'{token}' is expected, found '{self._peek()}'")
