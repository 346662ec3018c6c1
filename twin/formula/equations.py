"""Decorators that register equation functions with their outputs, sources and variants."""

from __future__ import annotations

import ast
import copy
import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from types import FunctionType
from typing import TypeVar, get_args

from twin.core.errors import KinematicsError
from twin.formula.contract import Equation, Rows, Stage
from twin.formula.loader import ModuleNames, text_of
from twin.formula.scalar import Value

_Function = TypeVar("_Function", bound=Rows)

_CHANGES = "_changes"
"""Attribute of a variant's function: (original function, decorated function that contains the changed rows)."""


class Equations:
    """The equations of one file, to be passed to `Formula` as `equations`; a decorator registers each function.

    Iteration yields inverse equations, then forward equations, then helpers, each in file order. In a formula file:

        equation = Equations()

        @equation("inverse", "ball -> carriages", gives="q1 q2", source="paper, eq. (2)", why="as in Fig. 3")
        def eq2(x, y, l_1, l_2):
            q1 = x + l_2
            q2 = y - l_1
            return q1, q2

        @equation.variant("printed", of=eq2, why="the row of q1 has the wrong length")
        def eq2_printed(x, l_1):
            q1 = x + l_1
            return q1

    Attributes:
        source: default source (document and equation number).
        variant_name: default name of the first variant (reading) of an equation; for a helper always "corrected".
    """

    def __init__(self, source: str = "DERIVED", variant: str = "corrected") -> None:
        self.source = source
        self.variant_name = variant
        self._registered: list[Equation] = []

    def __call__(
        self,
        stage: Stage,
        title: str,
        gives: str | Sequence[str],
        source: str = "",
        variant: str = "",
        name: str = "",
        why: str = "",
    ) -> Callable[[_Function], _Function]:
        """Return a decorator that registers a function as an equation, in its default variant.

        Args:
            stage: "inverse", "forward" or "helper"; see `Stage`.
            title: inputs and outputs in words, "ball -> carriages".
            gives: symbols that the function returns, in order: a sequence, or a text with spaces between the symbols.
            source: document and equation number.
            variant: name of this variant; not used for a helper, whose first variant is "corrected".
            name: name of the equation; default: the name of the function.
            why: reason why this variant is correct; only needed if there are other variants.

        Raises:
            KinematicsError: an equation of this name is already registered (raised by the decorator).
        """
        if isinstance(gives, str):
            gives = gives.split()
        outputs = tuple(gives)
        if stage == "helper":
            variant_name = "corrected"
        else:
            variant_name = variant or self.variant_name
        reasons = {}
        if why:
            reasons[variant_name] = why

        def register(function: _Function) -> _Function:
            equation_name = name or function.__name__
            if equation_name in [equation.name for equation in self._registered]:
                raise KinematicsError(
                    f"two equations are named '{equation_name}': register the second as a variant of the first"
                )
            equation = Equation(
                equation_name,
                title,
                source=source or self.source,
                stage=stage,
                outputs=outputs,
                variants={variant_name: function},
                reasons=reasons,
                default=variant_name,
            )
            self._registered.append(equation)
            return function

        return register

    def variant(self, name: str, of: Rows, why: str) -> Callable[[Rows], Variant]:
        """Return a decorator that registers a variant of an equation: a function with only the rows that differ.

        A row is one assignment. Each row of the variant replaces the row of `of` that assigns the same symbols. If `of`
        has these symbols only as arguments, the row is inserted at the beginning. A row with other symbols is inserted
        before the next changed row of the variant. The arguments of the decorated function are symbols of the flow, or
        names that `of` assigns. The decorated function returns the changed symbols.

        Args:
            name: name of the variant.
            of: the function to change: the function of the equation, or of another variant.
            why: the change in this variant, and its reason.

        Raises:
            KinematicsError: `of` is not an equation of this file, or the equation already has a variant of this name.
                The file is parsed when the variant is first used; only then, an error with file and line is raised for
                a row that does not exist in `of`.
        """
        place = self._place_of(of)
        if place is None:
            raise KinematicsError(f"variant '{name}' changes {of!r}, which is not an equation of this file")

        def register(function: Rows) -> Variant:
            equation = self._registered[place]
            if name in equation.variants:
                raise KinematicsError(
                    f"two variants of equation '{equation.name}' are named '{name}': give the second another name"
                )
            variant = Variant(of, function)
            variants = {**equation.variants, name: variant}
            reasons = {**equation.reasons, name: why}
            self._registered[place] = replace(equation, variants=variants, reasons=reasons)
            return variant

        return register

    def _place_of(self, function: Rows) -> int | None:
        """Return the index of the equation of which the function is a variant; None if there is none."""
        for i, equation in enumerate(self._registered):
            for variant in equation.variants.values():
                if variant is function:  # not `in`, which would compare by equality
                    return i
        return None

    def __iter__(self) -> Iterator[Equation]:
        stages = get_args(Stage)
        return iter(sorted(self._registered, key=lambda equation: stages.index(equation.stage)))


class Variant:
    """The function `base` with the rows changed by the function `change`."""

    def __init__(self, base: Rows, change: Rows) -> None:
        self.base = base
        self.change = change

    def __call__(self, *args: Value, **kwargs: Value) -> Value:
        """Return the outputs of `base`, computed with the changed rows."""
        return self.__wrapped__(*args, **kwargs)

    @cached_property
    def __wrapped__(self) -> FunctionType:
        return _changed(inspect.unwrap(self.base), self.change)


@dataclass(frozen=True)
class EquationRow:
    """One statement of a function of symbols.

    Attributes:
        node: the statement.
        home: function definition that contains the statement: that of the variant, or that of the original function.
        new: whether a variant adds the row; otherwise, the row is original or replaces an original row.
    """

    node: ast.stmt
    home: ast.FunctionDef
    new: bool = False


def rows(function: Rows) -> tuple[EquationRow, ...]:
    """Return the statements of a function without its docstring; for a variant, the rows after the changes.

    Raises:
        KinematicsError: the function has no source (a lambda, a built-in, a decorated wrapper).
    """
    function = inspect.unwrap(function)
    if hasattr(function, _CHANGES):
        base, change = getattr(function, _CHANGES)
        return _merged(base, change)
    node = definition(function)
    body = node.body
    if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
        body = body[1:]  # without the docstring
    return tuple(EquationRow(statement, node) for statement in body)


def definition(function: Rows) -> ast.FunctionDef:
    """Return the syntax tree of a function in its file; for a variant, the tree of the function with the changed rows.

    Raises:
        KinematicsError: the function has no source (a lambda, a built-in, a decorated wrapper).
    """
    plain_function = inspect.unwrap(function)
    if hasattr(plain_function, _CHANGES):
        _, change = getattr(plain_function, _CHANGES)
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


def _merged(base: Rows, change: Rows) -> tuple[EquationRow, ...]:
    """Return the rows of a function after the changes of a variant.

    Raises:
        KinematicsError: a statement is not an assignment, or changes only part of a row, or assigns a symbol that the
            variant does not return; or there is no statement.
    """
    path = inspect.unwrap(change).__code__.co_filename

    def fail(node: ast.stmt, text: str) -> KinematicsError:
        return KinematicsError(f"{path}:{node.lineno}: {change.__name__}() {text}")

    merged = list(rows(base))
    symbols_of_base: set[str] = set()
    for row in merged:
        symbols_of_base.update(assigned(row.node))
    arguments_of_base = set(inspect.signature(base).parameters)
    rows_of_change = rows(change)
    if not rows_of_change:  # Python accepts a docstring as the whole body
        raise fail(definition(change), "has no rows: assign the symbols that this variant changes, and return them")
    *changed_rows, last_row = rows_of_change
    added: list[EquationRow] = []  # rows with symbols that `base` does not have, until their place is known
    changed: list[str] = []
    for row in changed_rows:
        names = set(assigned(row.node))
        if not names:
            raise fail(row.node, "is a variant: its rows must be assignments of symbols, as in `q1 = ...`")
        if not symbols_of_base & names:
            if arguments_of_base & names:
                merged[:0] = [*added, row]
                added = []
                changed += assigned(row.node)
            else:
                added.append(replace(row, new=True))
            continue
        places = []
        for i, existing_row in enumerate(merged):
            if set(assigned(existing_row.node)) == names:
                places.append(i)
        if len(places) != 1:
            symbols = ", ".join(assigned(row.node))
            raise fail(
                row.node,
                f"changes {symbols}: {len(places)} rows of the equation assign exactly these symbols, not one row",
            )
        place = places[0]
        merged[place : place + 1] = [*added, row]
        added = []
        changed += assigned(row.node)
    last = last_row.node
    returned = _names(getattr(last, "value", None))
    if not isinstance(last, ast.Return) or added or sorted(returned) != sorted(changed):
        raise fail(last, f"must end by returning the symbols that it changes: return {', '.join(changed)}")
    return tuple(merged)


def assigned(node: ast.stmt) -> tuple[str, ...]:
    """Return the names that a plain assignment assigns; an empty result for any other statement."""
    if not isinstance(node, ast.Assign) or len(node.targets) != 1:
        return ()
    names = _names(node.targets[0])
    if not all(names):
        return ()
    return tuple(names)


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


def _changed(base: Rows, change: Rows) -> FunctionType:
    """Return `base` with the rows of `change`, as a function whose line numbers are those of the file."""
    if not isinstance(base, FunctionType) or base.__closure__ or not isinstance(change, FunctionType):
        raise KinematicsError(f"{change!r} changes {base!r}: both must be functions at the top level of one file")
    body = []
    for row in _merged(base, change):
        body.append(row.node)
    # a copy: the tree of a file is cached and stays that of the text
    node = copy.copy(definition(change))
    node.args = _arguments(base, node, body)
    node.body = body
    node.decorator_list = []
    module = ast.fix_missing_locations(ast.Module([node], []))
    scope: ModuleNames = {}
    exec(compile(module, base.__code__.co_filename, "exec"), base.__globals__, scope)
    changed = scope[change.__name__]
    changed.__defaults__ = base.__defaults__
    changed.__kwdefaults__ = base.__kwdefaults__
    changed.__doc__ = change.__doc__
    setattr(changed, _CHANGES, (base, change))
    return changed


def _arguments(base: FunctionType, change: ast.FunctionDef, body: Sequence[ast.stmt]) -> ast.arguments:
    """Return the arguments of `base` and, as keyword arguments, the symbols that only the changed rows need."""
    root: Rows = base
    while hasattr(root, _CHANGES):
        root, _ = getattr(root, _CHANGES)
    arguments = copy.copy(definition(root).args)
    code = base.__code__
    assigned_names = set(code.co_varnames)
    for statement in body:
        assigned_names.update(assigned(statement))
    # `base` can itself be a variant with keyword arguments that the function in the file does not have
    needed_names = list(code.co_varnames[code.co_argcount : code.co_argcount + code.co_kwonlyargcount])
    for argument in change.args.args:
        if argument.arg not in assigned_names:
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
