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
from typing import Any, TypeVar, get_args

from twin.core.errors import KinematicsError
from twin.formula.contract import Equation, Stage
from twin.formula.loader import text_of

_Function = TypeVar("_Function", bound=Callable[..., Any])

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
        self.source, self.variant_name = source, variant
        self._made: list[Equation] = []

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
            variant: name of this variant.
            name: name of the equation; default: the name of the function.
            why: reason why this variant is correct; only needed if there are other variants.
        """
        outputs = tuple(gives.split() if isinstance(gives, str) else gives)

        def note(function: _Function) -> _Function:
            own = name or function.__name__
            if any(e.name == own for e in self._made):
                raise KinematicsError(f"two equations are named '{own}': register the second as a variant of the first")
            reading = "corrected" if stage == "helper" else variant or self.variant_name
            reasons = {reading: why} if why else {}
            source_ = source or self.source
            self._made.append(Equation(own, title, source_, stage, outputs, {reading: function}, reasons, reading))
            return function

        return note

    def variant(self, name: str, of: Callable[..., Any], why: str) -> Callable[[Callable[..., Any]], Variant]:
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
            KinematicsError: `of` is not an equation of this file. The file is parsed when the variant is first used;
                only then, an error with file and line is raised for a row that does not exist in `of`.
        """
        found = [i for i, e in enumerate(self._made) if any(f is of for f in e.variants.values())]
        if not found:
            raise KinematicsError(f"variant '{name}' changes {of!r}, which is not an equation of this file")

        def note(function: Callable[..., Any]) -> Variant:
            e = self._made[found[0]]
            made = Variant(of, function)
            self._made[found[0]] = replace(e, variants={**e.variants, name: made}, reasons={**e.reasons, name: why})
            return made

        return note

    def __iter__(self) -> Iterator[Equation]:
        return iter(sorted(self._made, key=lambda e: get_args(Stage).index(e.stage)))


class Variant:
    """The function `base` with the rows changed by the function `change`."""

    def __init__(self, base: Callable[..., Any], change: Callable[..., Any]) -> None:
        self.base, self.change = base, change

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Return the outputs of `base`, computed with the changed rows."""
        return self.__wrapped__(*args, **kwargs)

    @cached_property
    def __wrapped__(self) -> FunctionType:
        return _changed(inspect.unwrap(self.base), self.change)


@dataclass(frozen=True)
class Row:
    """One statement of a function of symbols.

    Attributes:
        node: the statement.
        home: function definition that contains the statement: that of the variant, or that of the original function.
        new: whether a variant adds the row; otherwise, the row is original or replaces an original row.
    """

    node: ast.stmt
    home: ast.FunctionDef
    new: bool = False


def rows(function: Callable[..., Any]) -> tuple[Row, ...]:
    """Return the statements of a function without its docstring; for a variant, the rows after the changes.

    Raises:
        KinematicsError: the function has no source (a lambda, a built-in, a decorated wrapper).
    """
    function = inspect.unwrap(function)
    if hasattr(function, _CHANGES):
        return _merged(*getattr(function, _CHANGES))
    node = definition(function)
    body = node.body
    if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
        body = body[1:]
    return tuple(Row(s, node) for s in body)


def definition(function: Callable[..., Any]) -> ast.FunctionDef:
    """Return the syntax tree of a function in its file; for a variant, the tree of the function with the changed rows.

    Raises:
        KinematicsError: the function has no source (a lambda, a built-in, a decorated wrapper).
    """
    f = inspect.unwrap(function)
    f = inspect.unwrap(getattr(f, _CHANGES, (None, f))[1])
    code = getattr(f, "__code__", None)
    if code is None or not Path(code.co_filename).is_file():
        raise KinematicsError(f"{function!r} has no source file; the text of an equation must be readable")
    path = Path(code.co_filename)
    node = _definitions(path, text_of(path, f.__globals__)).get((code.co_name, code.co_firstlineno))
    if node is None:
        raise KinematicsError(f"{code.co_filename}:{code.co_firstlineno}: '{code.co_name}' is not a plain function")
    return node


@lru_cache(maxsize=64)
def _definitions(path: Path, data: bytes) -> dict[tuple[str, int], ast.FunctionDef]:
    """Return the function definitions in a file's text, by name and line of the first decorator or `def`."""
    found = {}
    waiting: list[ast.AST] = [ast.parse(data, path)]
    while waiting:  # ast.walk would also visit all expressions, which contain no definitions
        for node in ast.iter_child_nodes(waiting.pop()):
            if isinstance(node, ast.stmt | ast.excepthandler | ast.match_case):
                waiting.append(node)
            if isinstance(node, ast.FunctionDef):
                found[node.name, min([node.lineno, *(d.lineno for d in node.decorator_list)])] = node
    return found


def _merged(base: Callable[..., Any], change: Callable[..., Any]) -> tuple[Row, ...]:
    """Return the rows of a function after the changes of a variant.

    Raises:
        KinematicsError: a statement is not an assignment, or changes only part of a row, or assigns a symbol that the
            variant does not return.
    """
    path = inspect.unwrap(change).__code__.co_filename

    def fail(node: ast.stmt, text: str) -> KinematicsError:
        return KinematicsError(f"{path}:{node.lineno}: {change.__name__}() {text}")

    out, own, waiting, changes = list(rows(base)), rows(change), [], []
    there, given = {n for r in out for n in assigned(r.node)}, set(inspect.signature(base).parameters)
    for row in own[:-1]:
        names = assigned(row.node)
        if not names:
            raise fail(row.node, "is a variant: its rows must be assignments of symbols, as in `q1 = ...`")
        if not there & set(names) and given & set(names):
            out[:0], waiting = [*waiting, row], []
            changes += names
            continue
        if not there & set(names):
            waiting.append(replace(row, new=True))
            continue
        at = [i for i, r in enumerate(out) if set(assigned(r.node)) == set(names)]
        if len(at) != 1:
            raise fail(
                row.node,
                f"changes {', '.join(names)}: {len(at)} rows of the equation assign exactly these symbols, not one row",
            )
        out[at[0] : at[0] + 1] = [*waiting, row]
        waiting = []
        changes += names
    last = own[-1].node
    value = getattr(last, "value", None)
    said = [getattr(e, "id", "") for e in (value.elts if isinstance(value, ast.Tuple) else [value])]
    if not isinstance(last, ast.Return) or waiting or sorted(said) != sorted(changes):
        raise fail(last, f"must end by returning the symbols that it changes: return {', '.join(changes)}")
    return tuple(out)


def assigned(node: ast.stmt) -> tuple[str, ...]:
    """Return the names that a plain assignment assigns; an empty result for any other statement."""
    if not isinstance(node, ast.Assign) or len(node.targets) != 1:
        return ()
    target = node.targets[0]
    names = [getattr(t, "id", "") for t in (target.elts if isinstance(target, ast.Tuple) else [target])]
    return tuple(names) if all(names) else ()


def _changed(base: Callable[..., Any], change: Callable[..., Any]) -> FunctionType:
    """Return `base` with the rows of `change`, as a function whose line numbers are those of the file."""
    if not isinstance(base, FunctionType) or base.__closure__ or not isinstance(change, FunctionType):
        raise KinematicsError(f"{change!r} changes {base!r}: both must be functions at the top level of one file")
    body = [r.node for r in _merged(base, change)]
    root: Callable[..., Any] = base
    while hasattr(root, _CHANGES):
        root = getattr(root, _CHANGES)[0]
    node, given = copy.copy(definition(change)), copy.copy(definition(root).args)
    code = base.__code__
    known = {*code.co_varnames, *(n for s in body for n in assigned(s))}
    asked = code.co_varnames[code.co_argcount : code.co_argcount + code.co_kwonlyargcount]
    asked = [*asked, *(a.arg for a in node.args.args if a.arg not in known)]
    more = [ast.arg(n) for n in asked if n not in {a.arg for a in given.kwonlyargs}]
    given.kwonlyargs = [*given.kwonlyargs, *more]
    given.kw_defaults = [*given.kw_defaults, *(None for _ in more)]
    node.args, node.body, node.decorator_list = given, body, []
    scope: dict[str, Any] = {}
    path = code.co_filename
    exec(compile(ast.fix_missing_locations(ast.Module([node], [])), path, "exec"), base.__globals__, scope)
    made = scope[change.__name__]
    made.__defaults__, made.__kwdefaults__ = base.__defaults__, base.__kwdefaults__
    made.__doc__ = change.__doc__
    setattr(made, _CHANGES, (base, change))
    return made
