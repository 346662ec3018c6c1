"""Run augmented assignments of equations on arrays as CasADi runs them: `v += a` gives `v` a new value.

A scalar of CasADi is never changed in place, an array of NumPy is. After `v = q; v += a`, an equation on arrays would
have changed `q` as well, and with it the mechanism's values that later rows use.
"""

from __future__ import annotations

import ast
import copy
import operator
import types
from collections.abc import Callable, Mapping

import numpy as np

from twin.core.errors import KinematicsError
from twin.formula.scalar import Value
from twin.formula.variant_rows import function_definition

_SYMBOLIC = "twin.formula.symbolic"

AUGMENTED_NAME = "_augmented_"
"""Name of the function that replaces augmented assignments, in the globals of rebuilt functions."""

_OUTER_NAME = "_outer_"
"""Name of a function around a closure that is compiled again; it has the closure's variables."""

_SIGNS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "//",
    ast.Mod: "%",
    ast.MatMult: "@",
    ast.Pow: "**",
}

_OPERATIONS: dict[str, tuple[Callable[..., Value], Callable[..., Value]]] = {
    "+": (operator.add, operator.iadd),
    "-": (operator.sub, operator.isub),
    "*": (operator.mul, operator.imul),
    "/": (operator.truediv, operator.itruediv),
    "//": (operator.floordiv, operator.ifloordiv),
    "%": (operator.mod, operator.imod),
    "@": (operator.matmul, operator.imatmul),
    "**": (operator.pow, operator.ipow),
}
"""The operation that gives a new value, and the one that changes its first argument where that is possible."""


def augmented(sign: str, value: Value, operand: Value) -> Value:
    """Return the value of a variable after an augmented assignment.

    Arrays of numbers stand for scalars of CasADi: they get a new value. All others are changed where Python does it, as
    lists and arrays of objects.
    """
    make_new, change_in_place = _OPERATIONS[sign]
    if isinstance(value, np.ndarray) and value.dtype != object:
        return make_new(value, operand)
    return change_in_place(value, operand)


class _Rewriter(ast.NodeTransformer):
    """Writes augmented assignments of variables as calls of `augmented`."""

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.stmt:
        """Return the assignment of a call; entries and attributes are changed in place by CasADi as well."""
        self.generic_visit(node)
        sign = _SIGNS.get(type(node.op))
        if sign is None or not isinstance(node.target, ast.Name):
            return node
        before = ast.Name(node.target.id, ast.Load())
        call = ast.Call(ast.Name(AUGMENTED_NAME, ast.Load()), [ast.Constant(sign), before, node.value], [])
        assignment = ast.copy_location(ast.Assign([node.target], call), node)
        return ast.fix_missing_locations(assignment)


def compiled(text: str, path: str) -> types.CodeType:
    """Return the code of statements, with augmented assignments as in CasADi.

    The globals with which it runs must have `augmented` under the name `AUGMENTED_NAME`.

    Raises:
        SyntaxError: the text is not valid Python.
    """
    tree = ast.parse(text, path)
    return compile(_Rewriter().visit(tree), path, "exec")


def _has_augmented(root: ast.AST) -> bool:
    return any(isinstance(node, ast.AugAssign) for node in ast.walk(root))


def rewritten(function: types.FunctionType) -> types.CodeType:
    """Return the code of a function, with augmented assignments as in CasADi where its source can be read."""
    # Without the attributes of `function`, so that the definition is its own, not that of a function that it decorates.
    bare = types.FunctionType(function.__code__, function.__globals__, function.__name__, None, function.__closure__)
    try:
        node = function_definition(bare)
    except KinematicsError:
        return function.__code__
    if not _has_augmented(node):
        return function.__code__
    tree = _Rewriter().visit(copy.deepcopy(node))  # the tree of the file stays as it is, because others read it
    tree.decorator_list = []
    free_variables = function.__code__.co_freevars
    statements = ast.Module([_with_free_variables(tree, free_variables)], [])
    module = compile(statements, function.__code__.co_filename, "exec")
    code = _code_of(function.__code__.co_name, module)
    # A closure holds one cell for each free variable, in their order: code with other ones cannot take its place.
    if code is None or code.co_freevars != free_variables:
        return function.__code__
    return code.replace(co_firstlineno=function.__code__.co_firstlineno)


def _with_free_variables(tree: ast.FunctionDef, free_variables: tuple[str, ...]) -> ast.FunctionDef:
    """Return a function's definition inside of one whose arguments are its free variables; itself without any."""
    if not free_variables:
        return tree
    names = [ast.arg(name) for name in free_variables]
    arguments = ast.arguments([], names, None, [], [], None, [])
    outer = ast.FunctionDef(_OUTER_NAME, arguments, [tree], [])
    return ast.fix_missing_locations(ast.copy_location(outer, tree))


def _code_of(name: str, code: types.CodeType) -> types.CodeType | None:
    """Return the code of a function of this name that is defined in `code`, or in the function `_OUTER_NAME` there."""
    for constant in code.co_consts:
        if not isinstance(constant, types.CodeType):
            continue
        if constant.co_name == name:
            return constant
        if constant.co_name == _OUTER_NAME:
            return _code_of(name, constant)
    return None


def uses_casadi(names: Mapping[str, object]) -> bool:
    """Return whether the scalars of a module are CasADi's or twin's symbols; `names` are its globals.

    The scalars of other modules are NumPy's, and their arrays are changed in place.
    """
    for value in names.values():
        module = getattr(value, "__module__", None)
        if isinstance(value, types.ModuleType):
            module = value.__name__
        if not isinstance(module, str):  # any object may have an attribute of this name
            continue
        if module == _SYMBOLIC or module.split(".")[0] == "casadi":
            return True
    return AUGMENTED_NAME in names
