"""The number in a cell of a table: plain, with a unit, as a multiple of pi, or beside the name of a coordinate.

Cells are texts of papers: with marks of LaTeX and Markdown, Greek letters, and signs that only look like ASCII.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass

_GREEK = {"α": "alpha", "⍺": "alpha", "β": "beta", "γ": "gamma", "θ": "theta", "ϑ": "theta", "σ": "sigma", "μ": "mu"}

UNITS = {
    **{"mm": "mm", "millimetre": "mm", "millimeter": "mm", "cm": "cm", "m": "m", "metre": "m", "meter": "m"},
    **{"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad"},
}
"""{name of a unit: unit}."""

_QUARTER_ROUNDING = 3e-4
"""Largest difference from a quarter turn in rad of a number that means one: 1.571 has three decimals."""

_MAX_CELL_LENGTH = 100
"""Length of the text of a cell, in characters, from which it is not read as a number."""

_LARGEST_EXPONENT = 30
"""Largest exponent of ten in a cell."""


def is_quarter_turn_in_rad(value: float) -> bool:
    """Return whether a number is a quarter or half turn in rad, written with three digits or more."""
    to_quarter = abs(abs(value) - 0.5 * math.pi)
    to_half = abs(abs(value) - math.pi)
    return min(to_quarter, to_half) < _QUARTER_ROUNDING


@dataclass(frozen=True)
class CellNumber:
    """A constant, its unit or "", whether it is a multiple of pi, the factor of the coordinate (0: there is none)."""

    value: float
    unit: str
    of_pi: bool
    factor: float


_SUBSCRIPTS = str.maketrans("₀₁₂₃₄₅₆₇₈₉₊₋ⱼᵢ⁻⁺", "0123456789+-ji-+")

_SUPERSCRIPT = re.compile("(?<=[0-9])([⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
"""An exponent: 10⁻³. After another sign, as in q⁻, it is a part of a name."""


def _exponent(match: re.Match[str]) -> str:
    exponent = unicodedata.normalize("NFKC", match[1]).replace("−", "-")
    return f"**({exponent})"


def plain_text(text: str) -> str:
    """Return a text without the marks of LaTeX and Markdown, with ASCII signs and the names of Greek letters."""
    # Before NFKC, which turns the superscripts of 10⁻³ into the digits of another number, 10-3.
    text = _SUPERSCRIPT.sub(_exponent, text)
    text = text.translate(_SUBSCRIPTS)
    for letter, name in _GREEK.items():
        text = text.replace(letter, name)
    text = unicodedata.normalize("NFKC", text)
    text = re.sub(r"\\(?:[dt]?frac)\{([^{}]*)\}\{([^{}]*)\}", r"((\1)/(\2))", text)
    text = re.sub(r"\\(?:mathrm|text|textbf|mathbf|textit|bm|boldsymbol|rm|operatorname)\s*\{([^{}]*)\}", r"\1", text)
    text = re.sub(r"\\sqrt\{([^{}]*)\}", r"sqrt(\1)", text)
    text = re.sub(r"\^\s*\{?\s*(?:\\circ|\\degree|∘|o)\s*\}?|\\degree|\\si\{\\degree\}|[º˚]", "°", text)
    text = re.sub(r"\\(?:cdot|times)", "*", text)
    text = text.replace("\\varepsilon", "").replace("\\vartheta", "theta").replace("\\,", " ").replace("\\ ", " ")
    text = re.sub(r"\\(alpha|beta|gamma|theta|sigma|mu|pi)", r"\1", text).replace("π", "pi").replace("·", "*")
    text = re.sub("[−–—‐‑]", "-", text).replace("×", "*").replace("÷", "/")
    text = re.sub(r"\\[a-zA-Z]+|[${}`\\]", "", text).strip()
    text = re.sub(r"(?<=10)\s*\^\s*\(?\s*([+-]?\d+)\s*\)?", r"**(\1)", text)
    bold = re.fullmatch(r"\*\*([^*].*?)\*\*", text)
    return bold[1].strip() if bold else text


COORDINATE = re.compile(
    r"(?<![\w.])(?:q|theta|d|r)_?\s*\(?(?:\d+|[ij])\)?\s*\*?(?:\(t\))?|(?<![\w.])(?:q|theta|var|variable)\b|^\*$"
)
"""The coordinate of a joint in a cell: q1, theta_1, d3*, q."""


def has_coordinate(text: str) -> bool:
    """Return whether a cell has the name of a coordinate, such as q1."""
    return COORDINATE.search(plain_text(text)) is not None


_OPERATORS: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}

_PYTHON_NUMBER = re.compile(r"\d_\d|(?<![\w.])0[xobXOB]")
"""Numbers of Python that no paper prints: 1_0, 0x10."""


def cell_number(text: str, may_have_coordinate: bool) -> CellNumber | None:
    """Return the number of a cell and the factor of its coordinate; None if it is not a number.

    Without `may_have_coordinate`, the name of a coordinate is not a number.
    The number of "q1 + pi/2" is pi/2.
    """
    expression = plain_text(text)
    if may_have_coordinate:
        # Once only: a cell with two coordinates is a number of no convention, and is left for the parser to refuse.
        expression = COORDINATE.sub(" COORDINATE ", expression, count=1)
    unit = ""
    unit_match = re.search(r"(?<=[\d.)\s])\s*(mm|cm|m|deg|degrees|rad|°)$", expression) or re.search("°", expression)
    if unit_match:
        unit = UNITS[unit_match[0].strip().lower()]
        if unit_match[0].strip() == "°":  # may stand anywhere, as in 90° + q1
            expression = expression.replace("°", "")
        else:
            expression = expression[: unit_match.start()]
    of_pi = "pi" in expression.lower()
    expression = re.sub(r"(?<=\d)\s*(?=pi)", "*", expression.strip(), flags=re.IGNORECASE)
    if not expression or len(expression) > _MAX_CELL_LENGTH or _PYTHON_NUMBER.search(expression):
        return None
    try:
        # The cell must be linear in the coordinate: three values show it, and give the constant and the factor.
        values: list[float] = []
        for coordinate in ("0", "1", "2"):
            with_coordinate = expression.replace("COORDINATE", coordinate).strip()
            # Parsed, but never run: a table is a file of somebody else.
            values.append(_evaluate(ast.parse(with_coordinate, mode="eval").body))
        factor = values[1] - values[0]
        if values[2] - values[1] != factor:
            return None
        # The factor is a difference of numbers with a constant such as pi / 2, and has their rounding.
        return CellNumber(values[0], unit, of_pi, round(factor, 9))
    except (SyntaxError, ValueError, ZeroDivisionError, OverflowError, RecursionError, MemoryError):
        return None


def _evaluate(node: ast.expr) -> float:
    """Return the value of numbers, pi, sqrt(), signs, the four operations and powers of ten.

    Raises:
        ValueError: it is another expression.
    """
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value)
    if isinstance(node, ast.Name) and node.id.lower() == "pi":
        return math.pi
    if isinstance(node, ast.Attribute) and node.attr == "pi":  # np.pi, math.pi
        return math.pi
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_evaluate(node.operand)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd):
        return _evaluate(node.operand)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        exponent = _evaluate(node.right)
        # only powers of ten are a way to print a number
        if _evaluate(node.left) != 10.0 or abs(exponent) > _LARGEST_EXPONENT or exponent != int(exponent):
            raise ValueError
        return float(f"1e{int(exponent)}")
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_evaluate(node.left), _evaluate(node.right))
    if (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "sqrt"
        and len(node.args) == 1
    ):
        return math.sqrt(_evaluate(node.args[0]))
    raise ValueError
