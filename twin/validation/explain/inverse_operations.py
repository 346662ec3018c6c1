"""Values that a part of an expression must have, from the values of the whole, where an operation has an inverse."""

from __future__ import annotations

import ast
from collections.abc import Callable

import numpy as np

from twin.core.spatial import Array

ValuesOfPart = Callable[[ast.expr], Array | None]
"""Returns the values (k,) of a part of an expression; None if it has none."""


def operand_values(node: ast.expr, child: ast.expr, required: Array, values: ValuesOfPart) -> Array | None:
    """Return the values of `child`, an operand of `node`, with which `node` has the values `required` (..., k).

    NaN stands where there is no such value. A square has two roots: the one with the sign of the present value is
    returned. Return None if the operation has no inverse here, or another operand no value.
    """
    with np.errstate(all="ignore"):
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -required
        if isinstance(node, ast.Call):
            return _of_call(node, child, required, values)
        if isinstance(node, ast.BinOp):
            return _of_operation(node, child, required, values)
    return None


def _of_call(node: ast.Call, child: ast.expr, required: Array, values: ValuesOfPart) -> Array | None:
    """Return the values of the argument of a root or of an arc function, or of one argument of atan2."""
    name = ast.unparse(node.func).rpartition(".")[2]
    if name in ("atan2", "arctan2") and len(node.args) == 2 and child in node.args:
        return _of_direction(node, child, required, values)
    if len(node.args) != 1 or node.args[0] is not child:
        return None
    if name == "sqrt":
        return np.where(required >= 0, required**2, np.nan)
    if name in ("acos", "arccos"):
        return np.cos(required)
    if name in ("asin", "arcsin"):
        return np.sin(required)
    return None


def _of_direction(node: ast.Call, child: ast.expr, required: Array, values: ValuesOfPart) -> Array | None:
    """Return the values of one argument of atan2; the other one determines the length of the vector, with its sign."""
    y, x = node.args
    if child is y:  # y = x tan(angle)
        other_argument = values(x)
        along = np.cos(required)
        across = np.sin(required)
    else:  # x = y cot(angle)
        other_argument = values(y)
        along = np.sin(required)
        across = np.cos(required)
    if other_argument is None:
        return None
    # With the other sign, the vector would point half a turn further.
    return np.where(other_argument * along > 0, other_argument * across / along, np.nan)


def _of_operation(node: ast.BinOp, child: ast.expr, required: Array, values: ValuesOfPart) -> Array | None:
    """Return the values of one operand of a sum, a product or a quotient, or of the base of a square."""
    is_left = child is node.left
    if isinstance(node.op, ast.Pow):
        is_square = isinstance(node.right, ast.Constant) and node.right.value == 2
        if not (is_left and is_square):
            return None
        present = values(child)
        root = np.sqrt(required)
        if present is None:
            return root
        return np.where(present < 0, -root, root)
    other_operand = values(node.right if is_left else node.left)
    if other_operand is None:
        return None
    if isinstance(node.op, ast.Add):
        return required - other_operand
    if isinstance(node.op, ast.Mult):
        return required / other_operand
    if isinstance(node.op, ast.Sub):
        if is_left:
            return required + other_operand
        return other_operand - required
    if isinstance(node.op, ast.Div):
        if is_left:
            return required * other_operand
        return other_operand / required
    return None
