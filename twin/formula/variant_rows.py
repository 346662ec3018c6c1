"""Rows (statements) of equation functions; those of a variant replace some of the rows of another function."""

from __future__ import annotations

import ast
import copy
import inspect
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from types import FunctionType

from twin.core.errors import KinematicsError
from twin.formula.contract import SymbolFunction
from twin.formula.loader import ModuleNames, text_of
from twin.formula.scalar import Value

_ORIGIN = "_origin"
"""Attribute of the compiled function of a variant: (base, change) of its `VariantFunction`."""


class VariantFunction:
    """The function `base` with the rows changed by the function `change`.

    It is compiled when it is first called or inspected, so that loading a formula does not parse its file.
    """

    def __init__(self, base: SymbolFunction, change: SymbolFunction) -> None:
        self.base = base
        self.change = change

    def __call__(self, *args: Value, **kwargs: Value) -> Value:
        """Return the outputs of `base`, computed with the changed rows."""
        return self.__wrapped__(*args, **kwargs)

    @cached_property
    def __wrapped__(self) -> FunctionType:
        """The compiled function, under the name by which `inspect.unwrap` and `inspect.signature` find it."""
        return _compiled(inspect.unwrap(self.base), self.change)


@dataclass(frozen=True)
class EquationRow:
    """One statement of an equation function.

    Attributes:
        node: the statement.
        definition: the function definition in the file that contains the statement: for a row that a variant changes or
            adds, that of the variant.
        is_added: whether a variant adds the row; otherwise, the row is original or replaces an original row.
    """

    node: ast.stmt
    definition: ast.FunctionDef
    is_added: bool = False


def equation_rows(function: SymbolFunction) -> tuple[EquationRow, ...]:
    """Return the statements of a function without its docstring; for a variant, the rows after the changes.

    Raises:
        KinematicsError: the function has no source (a lambda, a built-in, a decorated wrapper), or its variant has a
            row that changes none.
    """
    origin = _origin(function)
    if origin is not None:
        base, change = origin
        return _merged_rows(base, change)
    node = function_definition(function)
    body = node.body
    if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
        body = body[1:]  # without the docstring
    return tuple(EquationRow(statement, node) for statement in body)


def function_definition(function: SymbolFunction) -> ast.FunctionDef:
    """Return the syntax tree of a function in its file; for a variant, the tree of the function with the changed rows.

    Raises:
        KinematicsError: the function has no source (a lambda, a built-in, a decorated wrapper).
    """
    plain_function = inspect.unwrap(function)
    origin = _origin(function)
    if origin is not None:
        _, change = origin
        plain_function = inspect.unwrap(change)
    code = getattr(plain_function, "__code__", None)
    if code is None or not Path(code.co_filename).is_file():
        raise KinematicsError(f"{function!r} has no source file; the text of an equation must be readable")
    path = Path(code.co_filename)
    definitions = _definitions(path, text_of(path, plain_function.__globals__))
    node = definitions.get((code.co_name, code.co_firstlineno))
    if node is None:
        raise KinematicsError(f"{code.co_filename}:{code.co_firstlineno}: '{code.co_name}' is not a plain function")
    return node


def assigned_symbols(node: ast.stmt) -> tuple[str, ...]:
    """Return the names that a plain assignment assigns; an empty result for any other statement."""
    if not isinstance(node, ast.Assign) or len(node.targets) != 1:
        return ()
    names = _names(node.targets[0])
    if not all(names):
        return ()
    return tuple(names)


def _origin(function: SymbolFunction) -> tuple[FunctionType, SymbolFunction] | None:
    """Return (base, change) of the function of a variant; None for a function that is as in its file."""
    return getattr(inspect.unwrap(function), _ORIGIN, None)


@lru_cache(maxsize=64)
def _definitions(path: Path, data: bytes) -> dict[tuple[str, int], ast.FunctionDef]:
    """Return the function definitions in a file's text, by name and line of the first decorator or `def`."""
    definitions = {}
    unvisited: list[ast.AST] = [ast.parse(data, path)]
    while unvisited:  # ast.walk would also visit all expressions, which contain no definitions
        for node in ast.iter_child_nodes(unvisited.pop()):
            if isinstance(node, ast.stmt | ast.excepthandler | ast.match_case):
                unvisited.append(node)
            if isinstance(node, ast.FunctionDef):
                first_line = node.lineno
                for decorator in node.decorator_list:
                    first_line = min(first_line, decorator.lineno)
                definitions[node.name, first_line] = node
    return definitions


def _merged_rows(base: SymbolFunction, change: SymbolFunction) -> tuple[EquationRow, ...]:
    """Return the rows of `base` after the changes of a variant; `Equations.variant` says where each row goes.

    Raises:
        KinematicsError: a statement is not an assignment, or changes only part of a row, or assigns a symbol that the
            variant does not return; or there is no statement.
    """
    merged = list(equation_rows(base))
    base_symbols: set[str] = set()
    for row in merged:
        base_symbols.update(assigned_symbols(row.node))
    base_arguments = set(inspect.signature(base).parameters)
    rows = equation_rows(change)
    if not rows:  # Python accepts a docstring as the whole body
        text = "has no rows: assign the symbols that this variant changes, and return them"
        raise _row_error(change, function_definition(change), text)
    *assignments, last_row = rows
    waiting: list[EquationRow] = []  # rows with symbols that `base` does not have, until the next changed row
    changed_symbols: list[str] = []
    for row in assignments:
        symbols = assigned_symbols(row.node)
        if not symbols:
            text = "is a variant: its rows must be assignments of symbols, as in `q1 = ...`"
            raise _row_error(change, row.node, text)
        if not base_symbols.isdisjoint(symbols):
            start = _replaced_row(merged, row, change)
            end = start + 1
        elif not base_arguments.isdisjoint(symbols):
            start = end = 0  # before all rows that use the changed argument
        else:
            waiting.append(replace(row, is_added=True))
            continue
        merged[start:end] = [*waiting, row]
        waiting = []
        changed_symbols += symbols
    returned_symbols = _names(getattr(last_row.node, "value", None))
    is_return = isinstance(last_row.node, ast.Return)
    if not is_return or waiting or sorted(returned_symbols) != sorted(changed_symbols):
        text = f"must end by returning the symbols that it changes: return {', '.join(changed_symbols)}"
        raise _row_error(change, last_row.node, text)
    return tuple(merged)


def _replaced_row(rows: Sequence[EquationRow], row: EquationRow, change: SymbolFunction) -> int:
    """Return the index of the row that a row of `change` replaces: the one that assigns the same symbols.

    Raises:
        KinematicsError: no row assigns exactly these symbols, or several do.
    """
    symbols = assigned_symbols(row.node)
    places = []
    for i, existing_row in enumerate(rows):
        if set(assigned_symbols(existing_row.node)) == set(symbols):
            places.append(i)
    if len(places) != 1:
        raise _row_error(
            change,
            row.node,
            f"changes {', '.join(symbols)}: {len(places)} rows of the equation assign exactly these symbols, not one "
            "row",
        )
    return places[0]


def _row_error(change: SymbolFunction, node: ast.stmt, text: str) -> KinematicsError:
    """Return an error that names file and line of a statement in the function `change`."""
    path = inspect.unwrap(change).__code__.co_filename
    return KinematicsError(f"{path}:{node.lineno}: {change.__name__}() {text}")


def _names(expression: ast.expr | None) -> list[str]:
    """Return the name of each entry of a tuple, or of a single expression; "" for an entry that is not a name."""
    entries = [expression]
    if isinstance(expression, ast.Tuple):
        entries = list(expression.elts)
    names = []
    for entry in entries:
        # only a plain name has an `id`; x[0] and x.y have none
        names.append(getattr(entry, "id", ""))
    return names


def _compiled(base: SymbolFunction, change: SymbolFunction) -> FunctionType:
    """Return `base` with the rows of `change`, as a function whose line numbers are those of the file."""
    if not isinstance(base, FunctionType) or base.__closure__ or not isinstance(change, FunctionType):
        raise KinematicsError(f"{change!r} changes {base!r}: both must be functions at the top level of one file")
    body = []
    for row in _merged_rows(base, change):
        body.append(row.node)
    # a copy: the tree of a file is cached and stays that of the text
    node = copy.copy(function_definition(change))
    node.args = _arguments(base, node, body)
    node.body = body
    node.decorator_list = []
    module = ast.fix_missing_locations(ast.Module([node], []))
    scope: ModuleNames = {}
    exec(compile(module, base.__code__.co_filename, "exec"), base.__globals__, scope)
    function = scope[change.__name__]
    function.__defaults__ = base.__defaults__
    function.__kwdefaults__ = base.__kwdefaults__
    function.__doc__ = change.__doc__
    setattr(function, _ORIGIN, (base, change))
    return function


def _arguments(base: FunctionType, change: ast.FunctionDef, body: Sequence[ast.stmt]) -> ast.arguments:
    """Return the arguments of `base` and, as keyword arguments, the symbols that only the changed rows need."""
    root = base  # the function in the file: `base` can itself be a variant, of a variant, ...
    origin = _origin(root)
    while origin is not None:
        root, _ = origin
        origin = _origin(root)
    arguments = copy.copy(function_definition(root).args)
    code = base.__code__
    known_names = set(code.co_varnames)
    for statement in body:
        known_names.update(assigned_symbols(statement))
    # a variant as `base` has keyword arguments that the function in the file does not have
    needed_names = list(code.co_varnames[code.co_argcount : code.co_argcount + code.co_kwonlyargcount])
    for argument in change.args.args:
        if argument.arg not in known_names:
            needed_names.append(argument.arg)
    existing_names = set()
    for argument in arguments.kwonlyargs:
        existing_names.add(argument.arg)
    added_arguments = []
    for name in needed_names:
        if name not in existing_names:
            added_arguments.append(ast.arg(name))
    no_defaults: list[ast.expr | None] = [None] * len(added_arguments)
    arguments.kwonlyargs = [*arguments.kwonlyargs, *added_arguments]
    arguments.kw_defaults = [*arguments.kw_defaults, *no_defaults]
    return arguments
