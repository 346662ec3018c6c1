"""Values that a part of an expression must have, from the values of the whole, where an operation has an inverse."""

from __future__ import annotations

import ast
from collections.abc import Callable

import numpy as np

from twin.core.spatial import Array

Values = Callable[[ast.expr], Array | None]
"""Returns the values (k,) of a part of an expression; None if it has none."""


def inverse(node: ast.expr, child: ast.expr, required: Array, values: Values) -> Array | None:
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


def _of_call(node: ast.Call, child: ast.expr, required: Array, values: Values) -> Array | None:
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


def _of_direction(node: ast.Call, child: ast.expr, required: Array, values: Values) -> Array | None:
    """Return the values of one argument of atan2; the other one determines the length of the vector, with its sign."""
    is_first = child is node.args[0]
    other_argument = values(node.args[1 if is_first else 0])
    if other_argument is None:
        return None
    along, across = np.cos(required), np.sin(required)
    if not is_first:
        along, across = across, along
    return np.where(other_argument * along > 0, other_argument * across / along, np.nan)


def _of_operation(node: ast.BinOp, child: ast.expr, required: Array, values: Values) -> Array | None:
    is_left = child is node.left
    if isinstance(node.op, ast.Pow):
        square = isinstance(node.right, ast.Constant) and node.right.value == 2
        if not (is_left and square):
            return None
        present = values(child)
        root = np.sqrt(required)
        return root if present is None else np.where(present < 0, -root, root)
    other_operand = values(node.right if is_left else node.left)
    if other_operand is None:
        return None
    if isinstance(node.op, ast.Add):
        return required - other_operand
    if isinstance(node.op, ast.Sub):
        return required + other_operand if is_left else other_operand - required
    if isinstance(node.op, ast.Mult):
        return required / other_operand
    if isinstance(node.op, ast.Div):
        return required * other_operand if is_left else other_operand / required
    return None
