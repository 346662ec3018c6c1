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

import numpy as np

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.expression_shifts import Shift
from twin.validation.explain.function_source import Edit, Source, Statement, comprehension_targets, text_after_edits
from twin.validation.explain.plain_values import scalar_form, unwrapped
from twin.validation.explain.term_texts import Atom

_LONGEST_EXPRESSION_TEXT = 240
"""Maximum length of an expression that is written with other names."""

_MOST_NAMES = 8
"""Maximum number of names of such an expression."""

_MOST_UNREAD_NAMES = 4
"""Maximum number of names without a reader; with more of them, the function is not one with a missing term."""

_MOST_EVALUATIONS = 2500
"""Maximum number of expressions that are evaluated for one statement, of each kind."""

_MOST_FOREIGN_NAMES = 3
"""Maximum number of names that only another row has."""


_VECTOR_FUNCTIONS = {"norm_2", "sumsqr", "dot", "cross", "vertcat"}
"""Functions of vectors: an expression with one is no formula of scalars."""


@dataclass(frozen=True)
class _Template:
    """An expression of the file: its text, its code, the names that may be replaced, and all names of its row."""

    text: str
    code: CodeType
    names: tuple[str, ...]
    row: frozenset[str] = frozenset()


_Renamings = tuple[_Template, list[dict[str, str]]]
"""An expression, and choices of names {old: new} to write in it."""


def scalar_values(code: CodeType, shift: Shift) -> Array | None:
    """Return the values (k,) of an expression in the scopes of a shift; None if it is no scalar, or zero everywhere."""
    each = len(shift.added) // len(shift.scopes)
    parts: list[Array] = []
    for scope in shift.scopes:
        values = _scalar_in_scope(code, scope, {}, each)
        if values is None:
            return None
        parts.append(values)
    all_values = np.concatenate(parts)
    if not _has_nonzero_value(all_values):
        return None
    return all_values


def _scalar_in_scope(code: CodeType, scope: Mapping[str, Value], names: Mapping[str, Value], k: int) -> Array | None:
    """Return the values (k,) of an expression in a scope, in which `names` have other values; None if no scalar."""
    try:
        value = eval(code, dict(scope), names)
    except Exception:  # a name that is not in scope, a matrix, an index out of range
        return None
    x = unwrapped(value)
    if not isinstance(x, int | float | np.number | np.ndarray) or isinstance(x, bool):
        return None
    # NumPy makes an array of objects of a list of matrices, without an error.
    if np.shape(x) not in ((), (k,)) or np.asarray(x).dtype == object:
        return None
    return np.broadcast_to(np.asarray(x, float), (k,))


def _has_nonzero_value(values: Array) -> bool:
    """Return whether values are finite somewhere, and not zero everywhere."""
    if not np.isfinite(values).any():
        return False
    return bool(np.nanmax(np.abs(values)) > 0)


def _values_of_renamings(
    template: _Template, replacements: Sequence[Mapping[str, str]], shift: Shift
) -> Iterator[tuple[str, Array]]:
    """Yield (text, values (k,)) of an expression for each choice of other names, by one evaluation for all."""
    count = len(replacements)
    each = len(shift.added) // len(shift.scopes)
    parts: list[Array] = []
    for scope in shift.scopes:
        names: dict[str, Value] = {}
        as_scalar = scalar_form(scope)
        for name in template.names:
            columns: list[Array] = []
            for replaced in replacements:
                x = unwrapped(scope.get(replaced.get(name, name)))
                is_number = isinstance(x, int | float | np.number | np.ndarray)
                # One choice with a vector or a matrix makes the evaluation of all choices together impossible.
                if not is_number or np.shape(x) not in ((), (each,)):
                    return
                columns.append(np.broadcast_to(np.asarray(x, float), (each,)))
            names[name] = as_scalar(np.concatenate(columns))
        values = _scalar_in_scope(template.code, scope, names, count * each)
        if values is None:
            return
        parts.append(values.reshape(count, each))
    for replaced, values in zip(replacements, np.hstack(parts), strict=True):
        if _has_nonzero_value(values):
            yield _renamed_text(template, replaced), values


def unread_names(source: Source, statement: Statement, fixed: Sequence[Edit] = ()) -> set[str]:
    """Return the arguments, and names assigned before a statement, that no statement of the function reads.

    `fixed` are edits of the function that are made in any case: what they insert is read.
    """
    read: set[str] = set()
    for reader in source.statements:
        read |= reader.reads
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
    unread: list[str] = []
    for name in sorted(unread_names(source, statement, fixed)):
        if scalar_values(compile(name, "<explain>", "eval"), shift) is not None:
            unread.append(name)
    if len(unread) > _MOST_UNREAD_NAMES:
        unread = []  # most of them are unused on purpose, and the number of combinations explodes
    _, usable = source.names_at(statement)
    usable = usable | comprehension_targets(statement.node).keys()
    edits_of_file = [edit for edit in fixed if edit.path == source.path]
    text = text_after_edits(source.data, edits_of_file, 0, len(source.data))
    atoms: dict[str, Atom] = {}
    with np.errstate(all="ignore"):
        for choices in (
            _renamings_to_unread(_templates(text, source.name), unread, usable),
            _renamings_of_other_rows(_row_templates(text, source.name), statement.reads & usable),
        ):
            evaluated_count = 0
            for template, replacements in choices:
                evaluated_count += len(replacements)
                if evaluated_count > _MOST_EVALUATIONS:
                    break
                for written, values in _values_of_renamings(template, replacements, shift):
                    atoms.setdefault(written, Atom(written, values))
    return list(atoms.values())


def _renamings_of_other_rows(templates: Sequence[_Template], row_names: Set[str]) -> Iterator[_Renamings]:
    """Yield expressions of other rows and choices of names {old: new} to write in them.

    Names that only the other row has are replaced by names that only this row has: by `row_names`, those of this row.
    """
    for template in templates:
        foreign = [name for name in template.names if name not in row_names]
        instead = sorted(row_names - template.row)
        # The number of permutations below grows with the factorial of this length.
        if not 0 < len(foreign) <= min(len(instead), _MOST_FOREIGN_NAMES):
            continue
        choices: list[dict[str, str]] = []
        for names in permutations(instead, len(foreign)):
            choices.append(dict(zip(foreign, names, strict=True)))
        yield template, choices


def _renamings_to_unread(
    templates: Sequence[_Template], unread: Sequence[str], usable: set[str]
) -> Iterator[_Renamings]:
    """Yield expressions and choices of names {old: new} to write in them; as many unread names as possible first."""
    for size in range(len(unread), 0, -1):
        for inserted_names in combinations(unread, size):
            for template in templates:
                foreign = set(template.names) - usable
                if len(foreign) > size or len(template.names) < size:
                    continue
                choices: list[dict[str, str]] = []
                for replaced in permutations(template.names, size):
                    if foreign <= set(replaced):
                        choices.append(dict(zip(replaced, inserted_names, strict=True)))
                if choices:
                    yield template, choices


def _renamed_text(template: _Template, replaced: Mapping[str, str]) -> str:
    return re.sub(r"[A-Za-z_]\w*", lambda match: replaced.get(match[0], match[0]), template.text)


@lru_cache(maxsize=16)
def _templates(text: str, function_name: str) -> tuple[_Template, ...]:
    """Return the different expressions of the functions of a file: those of `function_name` first, the longest first.

    The last ones are written with the expressions that their names are assigned, as they may be in another function.
    """
    of_own: dict[str, ast.expr] = {}
    of_others: dict[str, ast.expr] = {}
    inlined: dict[str, ast.expr] = {}
    for function in ast.parse(text).body:
        if not isinstance(function, ast.FunctionDef):
            continue
        of_function = of_own if function.name == function_name else of_others
        assigned = _Inlined(_assigned_once(function))
        for statement in function.body:
            for node in ast.walk(statement):
                if isinstance(node, ast.BinOp | ast.Call):
                    of_function.setdefault(ast.unparse(node), node)
                    inlined_node = assigned.visit(copy.deepcopy(node))
                    inlined.setdefault(ast.unparse(inlined_node), inlined_node)
    templates: dict[str, _Template] = {}
    for texts in (of_own, of_others, inlined):
        for written in sorted(texts, key=lambda text: (-len(text), text)):
            template = _template(written, texts[written])
            if template is not None:
                templates.setdefault(written, template)
    return tuple(templates.values())


def _template(written: str, node: ast.expr, row: frozenset[str] = frozenset()) -> _Template | None:
    """Return the template of an expression; None if it has no names, too many of them, or is too long."""
    names = _value_names(node)
    if not names or len(names) > _MOST_NAMES or len(written) > _LONGEST_EXPRESSION_TEXT:
        return None
    return _Template(written, compile(written, "<explain>", "eval"), names, row)


@lru_cache(maxsize=16)
def _row_templates(text: str, function_name: str) -> tuple[_Template, ...]:
    """Return the expressions of the rows of one function of a file, the longest first, each once."""
    templates: dict[str, _Template] = {}
    for function in ast.parse(text).body:
        if not isinstance(function, ast.FunctionDef) or function.name != function_name:
            continue
        for statement in function.body:
            row: set[str] = set()
            for node in ast.walk(statement):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                    row.add(node.id)
            for node in ast.walk(statement):
                if not isinstance(node, ast.BinOp | ast.Call):
                    continue
                written = ast.unparse(node)
                template = _template(written, node, frozenset(row))
                if template is not None:
                    templates.setdefault(written, template)
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
    stored: list[str] = []
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            stored.append(node.id)
    for statement in function.body:
        if not isinstance(statement, ast.Assign) or len(statement.targets) != 1:
            continue
        target = statement.targets[0]
        value = statement.value
        if isinstance(target, ast.Name) and isinstance(value, ast.BinOp | ast.Call) and stored.count(target.id) == 1:
            values[target.id] = value
    return values


def _value_names(node: ast.expr) -> tuple[str, ...]:
    """Return the names of an expression that may stand for values, in the order of the text; () if it is no formula."""
    called: set[str] = set()
    for part in ast.walk(node):
        if isinstance(part, ast.GeneratorExp | ast.ListComp | ast.Lambda | ast.Starred | ast.Attribute):
            return ()
        if isinstance(part, ast.Call) and isinstance(part.func, ast.Name):
            called.add(part.func.id)
    if called & _VECTOR_FUNCTIONS:
        return ()
    names: dict[str, None] = {}
    for part in ast.walk(node):
        if isinstance(part, ast.Name) and part.id not in called and part.id != "pi":
            names[part.id] = None
    return tuple(names)
