"""Write similar expressions of a file with other names: a missing term or factor often stands in a similar row.

Formulas often have rows or functions of the same form, with other names. If a term is missing, the names that only this
term used have no reader any more. Each expression of the file is therefore evaluated with these names instead of its
own. Expressions of other rows are also evaluated with the names that only the row itself has, instead of those that
only the other row has. The values, at many poses, then decide whether an expression is what is missing.
"""

from __future__ import annotations

import ast
import copy
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations
from types import CodeType
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Scalar
from twin.validation.explain.function_source import Edit, Source, Statement, apply, comprehension_targets
from twin.validation.explain.shifts import Shift
from twin.validation.explain.term_texts import Atom

_LONGEST = 240
"""Maximum length of an expression that is written with other names."""

_MOST_NAMES = 8
"""Maximum number of names of such an expression."""

_MOST_UNREAD = 4
"""Maximum number of names without a reader; with more of them, the function is not one with a missing term."""

_MOST_TRIED = 2500
"""Maximum number of expressions that are evaluated for one statement, of each kind."""

_MOST_FOREIGN = 3
"""Maximum number of names that only another row has."""


_OF_VECTORS = {"norm_2", "sumsqr", "dot", "cross", "vertcat"}
"""Functions of vectors: an expression with one is no formula of scalars."""


@dataclass(frozen=True)
class _Template:
    """An expression of the file: its text, its code, the names that may be replaced, and all names of its row."""

    text: str
    code: CodeType
    names: tuple[str, ...]
    row: frozenset[str] = frozenset()


def scalar_values(code: CodeType, shift: Shift) -> Array | None:
    """Return the values (k,) of an expression in the scopes of a shift; None if it is no scalar, or zero everywhere."""
    each = len(shift.shift) // len(shift.scopes)
    parts = []
    for scope in shift.scopes:
        values = _evaluated(code, scope, {}, each)
        if values is None:
            return None
        parts.append(values)
    values = np.concatenate(parts)
    return values if _is_something(values) else None


def _evaluated(code: CodeType, scope: Mapping[str, Any], names: Mapping[str, Any], k: int) -> Array | None:
    """Return the values (k,) of an expression in a scope, in which `names` have other values; None if no scalar."""
    try:
        value = eval(code, dict(scope), names)
    except Exception:  # a name that is not in scope, a matrix, an index out of range
        return None
    x = value.x if isinstance(value, Scalar) else value
    if not isinstance(x, int | float | np.number | np.ndarray) or isinstance(x, bool):
        return None
    if np.shape(x) not in ((), (k,)) or np.asarray(x).dtype == object:
        return None
    return np.broadcast_to(np.asarray(x, float), (k,))


def _is_something(values: Array) -> bool:
    return bool(np.isfinite(values).any()) and bool(np.nanmax(np.abs(values)) > 0)


def _of_replacements(
    template: _Template, replacements: Sequence[Mapping[str, str]], shift: Shift
) -> Iterator[tuple[str, Array]]:
    """Yield (text, values (k,)) of an expression for each choice of other names, by one evaluation for all."""
    count = len(replacements)
    each = len(shift.shift) // len(shift.scopes)
    parts = []
    for scope in shift.scopes:
        names: dict[str, Any] = {}
        objects = next((type(value) for value in scope.values() if isinstance(value, Scalar)), None)
        for name in template.names:
            columns = []
            for replaced in replacements:
                value = scope.get(replaced.get(name, name))
                x = value.x if isinstance(value, Scalar) else value
                if not isinstance(x, int | float | np.number | np.ndarray) or np.shape(x) not in ((), (each,)):
                    return
                columns.append(np.broadcast_to(np.asarray(x, float), (each,)))
            joined = np.concatenate(columns)
            names[name] = joined if objects is None else objects(joined)  # in plain functions, scalars are objects
        values = _evaluated(template.code, scope, names, count * each)
        if values is None:
            return
        parts.append(values.reshape(count, each))
    for replaced, values in zip(replacements, np.hstack(parts), strict=True):
        if _is_something(values):
            yield _written(template, replaced), values


def unread_names(source: Source, statement: Statement, fixed: Sequence[Edit] = ()) -> set[str]:
    """Return the arguments, and names assigned before a statement, that no statement of the function reads.

    `fixed` are edits of the function that are made in any case: what they insert is read.
    """
    read: set[str] = set()
    for s in source.statements:
        read |= s.reads
    for edit in fixed:
        read.update(re.findall(r"[A-Za-z_]\w*", edit.new))
    _, usable = source.names_at(statement)
    return usable - read


def analogies(source: Source, statement: Statement, shift: Shift, fixed: Sequence[Edit] = ()) -> list[Atom]:
    """Return expressions of the file, written with other names, with their values (k,) at the poses.

    Expressions with names that nobody reads come first, those that use all these names before the others; then those
    of other rows, with the names of this row. `shift` has the values of the names, `fixed` are edits of the file that
    are made in any case.
    """
    unread = []
    for name in sorted(unread_names(source, statement, fixed)):
        if scalar_values(compile(name, "<explain>", "eval"), shift) is not None:
            unread.append(name)
    if len(unread) > _MOST_UNREAD:
        unread = []
    _, usable = source.names_at(statement)
    usable = usable | comprehension_targets(statement.node).keys()
    text = apply(source.data, [edit for edit in fixed if edit.path == source.path], 0, len(source.data))
    atoms: dict[str, Atom] = {}
    with np.errstate(all="ignore"):
        for choices in (
            _replacements(_templates(text, source.name), unread, usable),
            _of_other_rows(_row_templates(text, source.name), statement.reads & usable),
        ):
            tried = 0
            for template, replacements in choices:
                tried += len(replacements)
                if tried > _MOST_TRIED:
                    break
                for written, values in _of_replacements(template, replacements, shift):
                    atoms.setdefault(written, Atom(written, values))
    return list(atoms.values())


def _of_other_rows(templates: Sequence[_Template], own: Set[str]) -> Iterator[tuple[_Template, list[dict[str, str]]]]:
    """Yield expressions of other rows and choices of names {old: new} to write in them.

    Names that only the other row has are replaced by names that only this row has; `own` are the names of this row.
    """
    for template in templates:
        foreign = [name for name in template.names if name not in own]
        instead = sorted(own - template.row)
        if not 0 < len(foreign) <= min(len(instead), _MOST_FOREIGN):
            continue
        yield template, [dict(zip(foreign, places, strict=True)) for places in permutations(instead, len(foreign))]


def _replacements(
    templates: Sequence[_Template], unread: Sequence[str], usable: set[str]
) -> Iterator[tuple[_Template, list[dict[str, str]]]]:
    """Yield expressions and choices of names {old: new} to write in them; as many unread names as possible first."""
    for size in range(len(unread), 0, -1):
        for some in combinations(unread, size):
            for template in templates:
                foreign = {name for name in template.names if name not in usable}
                if len(foreign) > size or len(template.names) < size:
                    continue
                choices = []
                for places in permutations(template.names, size):
                    if foreign <= set(places):
                        choices.append(dict(zip(places, some, strict=True)))
                if choices:
                    yield template, choices


def _written(template: _Template, replaced: Mapping[str, str]) -> str:
    return re.sub(r"[A-Za-z_]\w*", lambda match: replaced.get(match[0], match[0]), template.text)


@lru_cache(maxsize=16)
def _templates(text: str, own: str) -> tuple[_Template, ...]:
    """Return the different expressions of the functions of a file, those of the function `own` first, then the longest.

    The last ones are written with the expressions that their names are assigned, as they may be in another function.
    """
    of_own: dict[str, ast.expr] = {}
    of_others: dict[str, ast.expr] = {}
    inlined: dict[str, ast.expr] = {}
    for function in ast.parse(text).body:
        if not isinstance(function, ast.FunctionDef):
            continue
        found = of_own if function.name == own else of_others
        assigned = _Inlined(_assigned_once(function))
        for statement in function.body:
            for node in ast.walk(statement):
                if isinstance(node, ast.BinOp | ast.Call):
                    found.setdefault(ast.unparse(node), node)
                    whole = assigned.visit(copy.deepcopy(node))
                    inlined.setdefault(ast.unparse(whole), whole)
    out: dict[str, _Template] = {}
    for texts in (of_own, of_others, inlined):
        for written in sorted(texts, key=lambda t: (-len(t), t)):
            names = _own_names(texts[written])
            if names and len(names) <= _MOST_NAMES and len(written) <= _LONGEST:
                out.setdefault(written, _Template(written, compile(written, "<explain>", "eval"), names))
    return tuple(out.values())


@lru_cache(maxsize=16)
def _row_templates(text: str, own: str) -> tuple[_Template, ...]:
    """Return the expressions of the rows of the function `own` in a file, the longest first, each once."""
    templates: dict[str, _Template] = {}
    for function in ast.parse(text).body:
        if not isinstance(function, ast.FunctionDef) or function.name != own:
            continue
        for statement in function.body:
            row = frozenset(
                n.id for n in ast.walk(statement) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)
            )
            for node in ast.walk(statement):
                if not isinstance(node, ast.BinOp | ast.Call):
                    continue
                written = ast.unparse(node)
                names = _own_names(node)
                if names and len(names) <= _MOST_NAMES and len(written) <= _LONGEST:
                    templates.setdefault(written, _Template(written, compile(written, "<explain>", "eval"), names, row))
    return tuple(sorted(templates.values(), key=lambda template: (-len(template.text), template.text)))


class _Inlined(ast.NodeTransformer):
    """Writes expressions instead of the names that they are assigned to."""

    def __init__(self, assigned: Mapping[str, ast.expr]) -> None:
        self.assigned = assigned

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Return the expression that is assigned to a name, or the name."""
        return copy.deepcopy(self.assigned.get(node.id, node))


def _assigned_once(function: ast.FunctionDef) -> dict[str, ast.expr]:
    """Return the sums, products and calls that a function assigns to a name, if to no other value."""
    values: dict[str, ast.expr] = {}
    stored = [n.id for n in ast.walk(function) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
    for statement in function.body:
        if not isinstance(statement, ast.Assign) or len(statement.targets) != 1:
            continue
        target = statement.targets[0]
        value = statement.value
        if isinstance(target, ast.Name) and isinstance(value, ast.BinOp | ast.Call) and stored.count(target.id) == 1:
            values[target.id] = value
    return values


def _own_names(node: ast.expr) -> tuple[str, ...]:
    """Return the names of an expression that may stand for values, in the order of the text; () if it is no formula."""
    called: set[str] = set()
    for n in ast.walk(node):
        if isinstance(n, ast.GeneratorExp | ast.ListComp | ast.Lambda | ast.Starred | ast.Attribute):
            return ()
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Name):
            called.add(n.func.id)
    if called & _OF_VECTORS:
        return ()
    names = [n.id for n in ast.walk(node) if isinstance(n, ast.Name) and n.id not in called and n.id != "pi"]
    return tuple(dict.fromkeys(names))
