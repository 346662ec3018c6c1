"""Names that an edit of a statement may insert: known symbols, local variables, and aliases such as c_phi."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Container
from dataclasses import dataclass

from twin.validation.explain.function_source import Source, Statement, comprehension_targets


@dataclass(frozen=True)
class NamePool:
    """Names that an edit of a statement may insert.

    Attributes:
        names: names that have a value there.
        aliases: {new name: expression that defines it}.
        parameters: names of parameters of the formula.
        arguments: names that the function of the statement can read without a new argument.
        unknown: names that the statement uses but no equation computes: probably misspelt.
    """

    names: frozenset[str]
    aliases: dict[str, str]
    parameters: frozenset[str]
    arguments: frozenset[str]
    unknown: frozenset[str]


def name_pool(
    source: Source, statement: Statement, available: set[str], parameters: set[str], scope: Container[str]
) -> NamePool:
    """Return the names that a statement could use: known symbols, earlier local variables, and aliases.

    `available` are the symbols of the formula with a value there, `parameters` its parameters, `scope` the globals of
    the function.
    """
    local, readable = source.names_at(statement)
    inner = set(comprehension_targets(statement.node))
    if isinstance(statement.node, ast.For):  # its lines may use names assigned by earlier lines of the loop
        inner |= set(statement.writes)
    local |= inner
    readable |= inner
    symbols = {name for name in available if name.isidentifier()}
    names = symbols | local
    aliases: dict[str, str] = {}
    for name, definition in _aliases(source, statement).items():
        if name not in names:
            aliases[name] = definition
    unknown: set[str] = set()
    for name in statement.reads - names - set(dir(builtins)):
        if name not in scope:
            unknown.add(name)
    return NamePool(
        names=frozenset(names),
        aliases=aliases,
        parameters=frozenset(parameters),
        arguments=frozenset(readable),
        unknown=frozenset(unknown),
    )


def _aliases(source: Source, statement: Statement) -> dict[str, str]:
    """Return {name: definition} of sines and cosines that the statement's function could name as it names others.

    After `s_theta = sin(theta)` and `c_phi = cos(phi)`, these are also `s_phi` and `c_theta`.
    """
    angles: set[str] = set()
    styles: set[tuple[str, str]] = set()  # (function, prefix of the names of its values)
    for earlier in source.statements[: statement.index]:
        if earlier.home is not statement.home:
            continue
        for name, call in _assigned_value(earlier.node):
            if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name):
                continue
            function = call.func.id
            if function not in ("sin", "cos") or not call.args:
                continue
            argument = ast.unparse(call.args[0])
            if argument.isidentifier() and name.endswith(argument):
                prefix = name.removesuffix(argument)
                styles.add((function, prefix))
                angles.add(argument)
    aliases: dict[str, str] = {}
    for function, prefix in styles:
        for angle in angles:
            aliases[prefix + angle] = f"{function}({angle})"
    return aliases


def _assigned_value(node: ast.stmt) -> list[tuple[str, ast.expr]]:
    """Return (name, value) of each name that an assignment sets; `a, b = x, y` sets two."""
    if not isinstance(node, ast.Assign):
        return []
    target = node.targets[0]
    value = node.value
    targets = [target]
    values = [value]
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
        targets = target.elts
        values = value.elts
    pairs: list[tuple[str, ast.expr]] = []
    for assigned, assigned_value in zip(targets, values, strict=True):
        if isinstance(assigned, ast.Name):
            pairs.append((assigned.id, assigned_value))
    return pairs
