"""Generate small edits of a row: names, functions, signs, operators, numbers, indices, parentheses, terms.

An edit replaces text of the file. An edit that results in invalid Python, or in code that cannot be evaluated, is
dropped when it is tried.
"""

from __future__ import annotations

import ast
import builtins
import re
import tokenize
from collections.abc import Container, Iterator
from dataclasses import dataclass

from twin.validation.explain.source import Edit, Source, Statement, comprehension_targets
from twin.validation.explain.tokens import cut, shape, tokens_of

_FUNCTIONS = (
    ("sin", "cos", "tan"),
    ("asin", "acos", "atan"),
    ("arcsin", "arccos", "arctan"),
    ("atan2", "arctan2"),
    ("rotation_x", "rotation_y", "rotation_z"),
    ("dot", "cross"),
    ("norm_2", "sumsqr"),
    ("fmin", "fmax"),
)
_OPERATORS: dict[type[ast.operator], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-", "*")),
    ast.Sub: ("-", ("+", "*")),
    ast.Mult: ("*", ("/", "+", "-")),
    ast.Div: ("/", ("*",)),
}
_LONG = 48
"""Maximum number of tokens by which a parenthesis is moved."""


@dataclass(frozen=True)
class Pool:
    """Names that an edit may insert: existing `names`, and new `aliases`, each with the expression that defines it."""

    names: frozenset[str]
    aliases: dict[str, str]
    parameters: frozenset[str]
    arguments: frozenset[str]
    unknown: frozenset[str]  # used by the statement but computed by no equation: probably misspelt


def pool(
    source: Source, statement: Statement, available: set[str], parameters: set[str], scope: Container[str]
) -> Pool:
    """Return the names that a statement could use: known symbols, earlier local variables, and aliases."""
    local, readable = source.names_at(statement)
    if isinstance(statement.node, ast.For):  # its lines may use names assigned by earlier lines of the loop
        local |= set(statement.writes)
        readable |= set(statement.writes)
    inner = set(comprehension_targets(statement.node))
    local |= inner
    readable |= inner
    names = {n for n in available if n.isidentifier()} | local
    aliases: dict[str, str] = {}
    angles: set[str] = set()
    styles: set[tuple[str, str]] = set()
    for s in (s for s in source.statements[: statement.index] if s.home is statement.home):
        for name, call in _assigned(s.node):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in ("sin", "cos"):
                argument = ast.unparse(call.args[0]) if call.args else ""
                if argument.isidentifier() and name.endswith(argument):
                    styles.add((call.func.id, name.removesuffix(argument)))
                    angles.add(argument)
    for function, prefix in styles:
        other = "cos" if function == "sin" else "sin"
        for angle in angles:
            aliases[prefix + angle] = f"{function}({angle})"
            for o, p in styles:
                if o == other:
                    aliases[p + angle] = f"{other}({angle})"
    return Pool(
        frozenset(names),
        {n: e for n, e in aliases.items() if n not in names},
        frozenset(parameters),
        frozenset(readable),
        frozenset(n for n in statement.reads - names - set(dir(builtins)) if n not in scope),
    )


def _assigned(node: ast.stmt) -> list[tuple[str, ast.expr]]:
    if not isinstance(node, ast.Assign):
        return []
    target, value = node.targets[0], node.value
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
        pairs = zip(target.elts, value.elts, strict=True)
    else:
        pairs = iter([(target, value)])
    return [(t.id, v) for t, v in pairs if isinstance(t, ast.Name)]


def edits(source: Source, statement: Statement, pool: Pool, kinds: Container[str]) -> Iterator[Edit]:
    """Yield the edits of a statement that have one of the given kinds."""
    seen: set[tuple[int, int, str]] = set()
    writer = _Writer(source, statement, pool)
    for make in (_names, _calls, _quotients, _signs, _operators, _numbers, _sides, _terms, _factors):
        for edit in make(writer, statement.node):
            key = (edit.start, edit.end, edit.new)
            if edit.kind in kinds and key not in seen and edit.new != edit.old:
                seen.add(key)
                yield edit
    if "parenthesis" in kinds:
        yield from _parentheses(writer, statement.node)


class _Writer:
    def __init__(self, source: Source, statement: Statement, pool: Pool) -> None:
        self.source, self.statement, self.pool = source, statement, pool
        self.parent = {c: p for p in ast.walk(statement.node) for c in ast.iter_child_nodes(p)}.get

    def replace(self, node: ast.AST, new: str, kind: str, define: tuple[str, str] | None = None) -> Edit:
        return self.between(*self.source.span(node), new, kind, define)

    def between(self, start: int, end: int, new: str, kind: str, define: tuple[str, str] | None = None) -> Edit:
        s = self.source
        return Edit(
            s.path,
            s.line_of(start),
            start,
            end,
            s.text(start, end),
            new,
            kind,
            self.statement.index,
            s.name,
            define,
        )

    def text(self, node: ast.AST) -> str:
        return self.source.text(*self.source.span(node))

    def need(self, name: str) -> tuple[str, str] | None:
        """Return the definition (name, expression) that an inserted name requires; None if it requires none."""
        if name in self.pool.aliases:
            return name, self.pool.aliases[name]
        return None if name in self.pool.arguments else (name, "")


def _expressions(root: ast.AST) -> Iterator[ast.expr]:
    for node in ast.walk(root):
        if isinstance(node, ast.expr) and not isinstance(getattr(node, "ctx", None), ast.Store):
            yield node


def _is_called(w: _Writer, node: ast.AST) -> bool:
    parent = w.parent(node)
    return isinstance(parent, ast.Call) and parent.func is node


def _stem(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def kind_of_name(old: str, new: str, parameters: frozenset[str], aliases: dict[str, str] | None = None) -> str:
    """Return the kind of the edit that replaces name `old` by `new`: "index", "trig", "parameter" or "name"."""
    if _stem(old) == _stem(new):
        return "index"
    if new in (aliases or {}) or (old[:2] in ("c_", "s_") and new[:2] in ("c_", "s_")):
        return "trig"
    return "parameter" if old in parameters and new in parameters else "name"


def _names(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    choices = sorted(w.pool.names | set(w.pool.aliases))
    for node in _expressions(root):
        if not isinstance(node, ast.Name) or _is_called(w, node):
            continue
        old = node.id  # a module, as in symbolic.pose, is not a symbol
        if old not in w.pool.names | w.pool.arguments | w.pool.unknown:
            continue
        for new in choices:
            if new != old:
                kind = kind_of_name(old, new, w.pool.parameters, w.pool.aliases)
                yield w.replace(node, new, kind, w.need(new))


def _calls(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    for node in _expressions(root):
        if isinstance(node, ast.Attribute):
            for group in _FUNCTIONS:
                if node.attr in group:
                    base = w.text(node.value)
                    for other in group:
                        yield w.replace(node, f"{base}.{other}", "function")
            if node.attr == "T":
                yield w.replace(node, w.text(node.value), "transpose")
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Name):
                for group in _FUNCTIONS:
                    if node.func.id in group:
                        for other in group:
                            kind = "trig" if "cos" in group or "acos" in group else "function"
                            yield w.replace(node.func, other, kind)
            for a, b in zip(node.args, node.args[1:], strict=False):
                start, end = w.source.span(a)[0], w.source.span(b)[1]
                between = w.source.text(w.source.span(a)[1], w.source.span(b)[0])
                yield w.between(start, end, f"{w.text(b)}{between}{w.text(a)}", "order")
            if len(node.args) == 1 and isinstance(node.func, ast.Name):
                yield w.replace(node, f"({w.text(node.args[0])})", "surplus")
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield w.replace(node, f"{w.text(node.right)} @ {w.text(node.left)}", "order")
            for side in (x for x in (node.left, node.right) if getattr(x, "attr", "") != "T"):
                yield w.replace(side, f"({w.text(side)}).T", "transpose")


def _quotients(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield `atan2(n, d)` instead of `atan(n / d)`, which has angles of two quadrants only."""
    for node in _expressions(root):
        if not isinstance(node, ast.Call) or len(node.args) != 1:
            continue
        function, quotient = w.text(node.func), node.args[0]
        if function.rpartition(".")[2] not in ("atan", "arctan"):
            continue
        if isinstance(quotient, ast.BinOp) and isinstance(quotient.op, ast.Div):
            new = f"{function}2({w.text(quotient.left)}, {w.text(quotient.right)})"
            yield w.replace(node, new, "function")


def _signs(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    for node in _expressions(root):
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield w.replace(node, w.text(node.operand), "sign")
            continue
        if isinstance(node, ast.Constant) and isinstance(w.parent(node), ast.Subscript | ast.Slice):
            continue
        parent = w.parent(node)
        first = isinstance(parent, ast.Call) and node in parent.args
        first |= isinstance(parent, ast.Tuple | ast.List | ast.Return | ast.Assign | ast.GeneratorExp | ast.AugAssign)
        first |= isinstance(parent, ast.BinOp) and parent.left is node
        if isinstance(parent, ast.Tuple) and isinstance(w.parent(parent), ast.Subscript):
            continue
        if first and isinstance(node, ast.Name | ast.Call | ast.Subscript | ast.Constant | ast.BinOp | ast.Attribute):
            start, end = w.source.span(node)
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
                yield w.between(start, end, f"-({w.text(node)})", "sign")
            elif isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add) and _plain(parent.right):
                yield w.replace(parent, f"{w.text(parent.right)} - {w.text(node)}", "sign")
            elif not isinstance(node, ast.BinOp):
                yield w.between(start, start, "-", "sign")
            else:
                yield w.between(start, end, f"-{w.text(node)}", "sign")


def _plain(node: ast.AST) -> bool:
    return isinstance(node, ast.Name | ast.Call | ast.Subscript)


def _operators(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    for node in _expressions(root):
        if not isinstance(node, ast.BinOp) or type(node.op) not in _OPERATORS:
            continue
        sign, others = _OPERATORS[type(node.op)]
        start, end = w.source.span(node.left)[1], w.source.span(node.right)[0]
        gap = w.source.text(start, end)
        at = gap.find(sign)  # there may be parentheses before or after the sign
        if at < 0:
            continue
        at += len(gap[:at].encode()) - at
        for other in others:
            kind = "sign" if {sign, other} == {"+", "-"} else "operator"
            yield w.between(start + at, start + at + 1, other, kind)


def _numbers(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    for node in _expressions(root):
        if (
            not isinstance(node, ast.Constant)
            or isinstance(node.value, bool)
            or not isinstance(node.value, int | float)
        ):
            continue
        parent, n = w.parent(node), node.value
        index = isinstance(parent, ast.Subscript | ast.Slice)
        index |= isinstance(parent, ast.Tuple) and isinstance(w.parent(parent), ast.Subscript)
        if index:
            for i in range(4):
                yield w.replace(node, str(i), "index")
            continue
        if isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Pow) and parent.right is node:
            yield w.replace(parent, w.text(parent.left), "exponent")
            for i in (1, 2, 3, 4):
                yield w.replace(node, str(i), "exponent")
            continue
        values = {n + 1, n - 1, 2 * n, n / 2, 0, 1, 2, 3, 4, 6}
        for value in sorted(values - {n}):
            if value >= 0:
                yield w.replace(node, f"{value:g}", "number")
        if n in (0, 1):
            for name in sorted(w.pool.names):
                yield w.replace(node, name, "missing", w.need(name))
            yield from (w.replace(node, t, "number") for t in ("pi", "pi / 2", "-pi / 2"))
    for node in _expressions(root):
        if isinstance(node, ast.Name) and node.id == "pi":
            for text in ("(pi / 2)", "(2 * pi)", "0"):
                yield w.replace(node, text, "number")
            parent = w.parent(node)
            if isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Div):
                yield w.replace(parent, "pi", "number")
                yield w.replace(parent, "0", "number")


def _sides(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits of the index of the symbol on the left side of an implicit row."""
    s = w.statement
    if root is not s.node or not isinstance(s.node, ast.Assign) or not isinstance(s.node.targets[0], ast.Name):
        return
    target = s.node.targets[0]
    if target.id not in w.source.arguments:
        return
    for other in sorted(w.pool.names):
        if other != target.id and _stem(other) == _stem(target.id) and other in w.source.arguments:
            yield w.replace(target, other, "left side")


def _terms(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits that remove a term or factor, or add a square, a root or a term."""
    for node in _expressions(root):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub | ast.Mult | ast.Div | ast.MatMult):
            yield w.replace(node, w.text(node.left), "surplus")
            if not isinstance(node.op, ast.Div):
                text = w.text(node.right)
                yield w.replace(node, f"-{text}" if isinstance(node.op, ast.Sub) else text, "surplus")
        parent = w.parent(node)
        at = _end_of_base(w, node)
        if at is not None and not (isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Pow)):
            yield w.between(at, at, "**2", "exponent")
        whole = isinstance(parent, ast.Assign | ast.Return) and not isinstance(node, ast.Tuple)
        whole |= isinstance(parent, ast.Call) and node in parent.args
        whole |= isinstance(parent, ast.Tuple) and isinstance(w.parent(parent), ast.Return | ast.Assign)
        if whole:
            end = w.source.span(node)[1]
            if _has_square(node):
                yield from _squares(w, node)
            for name in sorted(w.pool.names):
                for sign in "+-":
                    yield w.between(end, end, f" {sign} {name}", "missing", w.need(name))
        elif _is_inner_sum(w, node) and _has_square(node):
            yield from _roots(w, node)
        elif isinstance(node, ast.Name) and _is_multiplied(w, node):
            for name in sorted(w.pool.names - {node.id}):
                for sign in "+-":
                    yield w.replace(node, f"({node.id} {sign} {name})", "missing", w.need(name))


def _end_of_base(w: _Writer, node: ast.expr) -> int | None:
    """Return the byte after a name, an entry or a parenthesis that may be squared; None for other expressions."""
    parent = w.parent(node)
    start, end = w.source.span(node)
    if isinstance(parent, ast.Attribute) or _is_called(w, node):
        return None
    if isinstance(node, ast.Name):
        return end
    if not isinstance(parent, ast.BinOp):
        return None
    if isinstance(node, ast.Subscript):
        is_entry = not any(isinstance(n, ast.Slice) for n in ast.walk(node.slice))
        return end if is_entry else None
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        enclosed = w.source.text(start - 1, start) == "(" and w.source.text(end, end + 1) == ")"
        return end + 1 if enclosed else None
    return None


def _squares(w: _Writer, node: ast.expr) -> Iterator[Edit]:
    """Yield edits of an expression with squares: its square root, and one more square."""
    end = w.source.span(node)[1]
    yield from _roots(w, node)
    for name in sorted(w.pool.names):
        for sign in "+-":
            yield w.between(end, end, f" {sign} {name}**2", "missing", w.need(name))


def _roots(w: _Writer, node: ast.expr) -> Iterator[Edit]:
    """Yield the edits that put an expression under a square root, as the file writes it."""
    names = re.findall(r"(?:\w+\.)?\bsqrt(?=\()", w.source.data.decode())
    for name in sorted(set(names)):
        yield w.replace(node, f"{name}({w.text(node)})", "missing")


def _has_square(node: ast.AST) -> bool:
    return any(isinstance(n, ast.BinOp) and isinstance(n.op, ast.Pow) for n in ast.walk(node))


def _is_multiplied(w: _Writer, node: ast.AST) -> bool:
    """Return whether a node is what a matrix is multiplied by."""
    parent = w.parent(node)
    return isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.MatMult) and parent.right is node


def _is_inner_sum(w: _Writer, node: ast.AST) -> bool:
    """Return whether a node is a sum in parentheses inside a sum or product."""
    parent = w.parent(node)
    if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub) and isinstance(parent, ast.BinOp)):
        return False
    return not (isinstance(parent.op, ast.Add | ast.Sub | ast.Pow) and parent.left is node)


def _factors(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    for node in _expressions(root):
        parent = w.parent(node)
        sums = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add | ast.Sub)
        sums |= isinstance(parent, ast.Call) and node in parent.args
        sums |= isinstance(parent, ast.Tuple) and isinstance(w.parent(parent), ast.Return | ast.Assign)
        sums |= isinstance(parent, ast.Assign | ast.Return)
        if isinstance(parent, ast.Tuple) and isinstance(w.parent(parent), ast.Subscript):
            continue
        if not sums or isinstance(node, ast.Tuple | ast.UnaryOp):
            continue
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            continue
        start = w.source.span(node)[0]
        for name in sorted(w.pool.names | set(w.pool.aliases)):
            yield w.between(start, start, f"{name} * ", "missing", w.need(name))
        yield w.between(start, start, "2 * ", "missing")
        yield w.between(start, start, "0.5 * ", "missing")


def _parentheses(w: _Writer, root: ast.AST) -> Iterator[Edit]:
    """Yield edits of parentheses: move one end, remove a pair, add a pair."""
    start, end = w.source.span(root)
    if isinstance(root, ast.Return) and root.value is not None:
        start, end = w.source.span(root.value)
    text = w.source.text(start, end)
    if not text.isascii():
        return
    tokens = tokens_of(text)
    done = {shape(text)}
    level: list[int] = []
    pairs: list[tuple[int, int]] = []
    for i, (kind, string, _, _) in enumerate(tokens):
        if kind == tokenize.OP and string == "(":
            level.append(i)
        elif kind == tokenize.OP and string == ")" and level:
            pairs.append((level.pop(), i))

    def made(new: str, kind: str = "parenthesis") -> Iterator[Edit]:
        form = shape(new)
        if form and form not in done:
            done.add(form)
            # The shortest replaced text that contains both ends.
            a = next((i for i in range(min(len(text), len(new))) if text[i] != new[i]), 0)
            b = next((i for i in range(min(len(text), len(new)) - a) if text[-1 - i] != new[-1 - i]), 0)
            while a and (text[a - 1].isalnum() or text[a - 1] == "_"):
                a -= 1
            yield w.between(start + a, start + len(text) - b, new[a : len(new) - b], kind)

    for opening, closing in pairs:
        o, c = tokens[opening], tokens[closing]
        called = opening > 0 and tokens[opening - 1][0] == tokenize.NAME
        if not called:
            yield from made(text[: o[2]] + text[o[3] : c[2]] + text[c[3] :])
        for j, (kind, string, _, finish) in enumerate(tokens):
            if abs(j - closing) > _LONG or j <= opening or j in (closing, closing - 1):
                continue
            if kind in (tokenize.NAME, tokenize.NUMBER) or string == ")":
                parts = sorted([(c[2], c[3], ""), (finish, finish, ")")])
                yield from made(cut(text, parts))
        if not called:
            for j, (kind, string, begin, _) in enumerate(tokens):
                if abs(j - opening) > _LONG or j >= closing or j == opening:
                    continue
                if kind in (tokenize.NAME, tokenize.NUMBER) or string in ("(", "-"):
                    parts = sorted([(o[2], o[3], ""), (begin, begin, "(")])
                    yield from made(cut(text, parts))
    ends = [i for i, t in enumerate(tokens) if t[0] in (tokenize.NAME, tokenize.NUMBER) or t[1] in ")]"]
    begins = [i for i, t in enumerate(tokens) if t[0] in (tokenize.NAME, tokenize.NUMBER) or t[1] == "("]
    for i in begins:
        for j in ends:
            if i < j <= i + _LONG // 2:
                yield from made(cut(text, [(tokens[i][2], tokens[i][2], "("), (tokens[j][3], tokens[j][3], ")")]))
