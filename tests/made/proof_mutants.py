"""Mutants of the equations of a robot for `twin prove`: slips, equivalent rewrites, and hidden errors."""

from __future__ import annotations

import ast
import inspect
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from made import explain_mutants
from twin.formula import variant_choice
from twin.kinematics.compile import compile_formula
from twin.proof import formula_side
from twin.validation.explain.tokens import line_starts, span

POSES = 300


def functions(formula):
    """Return the functions in files of robots that the equations use, in their default variants."""
    found = []
    waiting = [inspect.unwrap(e.variants[e.default]) for e in formula.equations]
    while waiting:
        function = waiting.pop(0)
        if function in found or not function.__module__.startswith("twin.robots."):
            continue
        if not function.__code__.co_freevars and "." not in function.__qualname__:
            found.append(function)
        home = function.__globals__
        waiting += [home[name] for name in function.__code__.co_names if inspect.isfunction(home.get(name))]
    return found


@contextmanager
def with_text(function, text):
    """Let a function compute what a changed text of its file says."""
    module = compile(text, function.__code__.co_filename, "exec")
    (code,) = [c for c in module.co_consts if inspect.iscode(c) and c.co_name == function.__name__]
    before = function.__code__
    function.__code__ = code
    try:
        yield
    finally:
        function.__code__ = before


def slips(function):
    """Yield (what, changed text) of each slip in a function."""
    text = _text(function)
    for kind, found in explain_mutants.changes(text, function).items():
        for start, end, new in found:
            yield _changed(text, kind, start, end, new)


def rewrites(function):
    """Yield (what, changed text) of each rewriting that computes the same."""
    text = _text(function)
    for node, said in _expressions(text, function):
        news = []
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            news.append(f"({said(node.right)} + {said(node.left)})")
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub):
            news.append(f"(-({said(node.right)} - ({said(node.left)})))")
        if isinstance(node, ast.Call) and said(node.func) == "cos" and len(node.args) == 1:
            news.append(f"(2 * cos(({said(node.args[0])}) / 2) ** 2 - 1)")
            news.append(f"sin({said(node.args[0])} + pi / 2)".replace("pi", repr(np.pi)))
        if isinstance(node, ast.Call) and said(node.func) == "sin" and len(node.args) == 1:
            news.append(f"cos({said(node.args[0])} - {np.pi!r} / 2)")
        if isinstance(node, ast.Call) and said(node.func) == "atan2":
            news.append(f"atan2(3 * ({said(node.args[0])}), 3 * ({said(node.args[1])}))")
        if isinstance(node, ast.Call) and said(node.func) == "sqrt":
            news.append(f"(sqrt(4 * ({said(node.args[0])})) / 2)")
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and said(node.right) == "2":
            news.append(f"(({said(node.left)}) * ({said(node.left)}))")
        for new in news:
            yield _changed(text, "rewrite", *_place(text, node), new)


def hidden(function, generator, ranges):
    """Yield (what, changed text) of errors that show in a small box."""
    for text, node, said, name, value, width in _drawn_places(function, generator, ranges):
        near = f"(abs({name} - {value!r}) < {width!r})"
        new = f"(({said(node)}) + 0.001 * {near})"
        yield _changed(text, "box", *_place(text, node), new)


def guards(function, generator, ranges):
    """Yield (what, changed text) of guards that refuse a small box, or what is beyond a value of an argument."""
    if "if_else" not in function.__globals__:
        return
    for text, node, said, name, value, width in _drawn_places(function, generator, ranges):
        refused = f"{name} > {value!r}"
        if generator.integers(2):
            refused = f"abs({name} - {value!r}) < {width!r}"
        new = f"if_else({refused}, float('nan'), {said(node)})"
        yield _changed(text, "guard", *_place(text, node), new)


def _drawn_places(function, generator, ranges):
    """Yield (text, node, said, argument, value in its range, width of a small box) of each operation of a function."""
    text = _text(function)
    arguments = inspect.signature(function).parameters
    names = [name for name in ranges if name in arguments]
    if not names:
        return
    for node, said in _expressions(text, function):
        if not isinstance(node, ast.BinOp) or isinstance(node.op, ast.MatMult | ast.Pow):
            continue
        name = names[generator.integers(len(names))]
        _, low, high = ranges[name]
        value = generator.uniform(low, high)
        width = (high - low) * 10 ** generator.uniform(-7, -4)
        yield text, node, said, name, value, width


def _text(function):
    return Path(function.__code__.co_filename).read_text(encoding="utf-8")


def _expressions(text, function):
    tree = next(n for n in ast.parse(text).body if isinstance(n, ast.FunctionDef) and n.name == function.__name__)
    for statement in tree.body:
        if isinstance(statement, ast.Expr):
            continue
        for node in ast.walk(statement):
            yield node, lambda n: ast.get_source_segment(text, n)


def _place(text, node):
    return span(node, line_starts(text.encode()))


def _changed(text, kind, start, end, new):
    data = text.encode()
    old = data[start:end].decode()
    line = data[:start].count(b"\n") + 1
    return f"{kind} in line {line}: {old} -> {new}", (data[:start] + new.encode() + data[end:]).decode()


class Oracle:
    """The right equations at random states, computed with double precision.

    An inverse may choose another solution than the right one: its joints must give the pose, and its points be there.
    """

    def __init__(self, robot, ranges, uncovered=(), count=POSES, seed=77):
        """Draw the states; `ranges` are those of the proof, without parameters, `uncovered` the points it names."""
        generator = np.random.default_rng(seed)
        self.formula = robot.formula
        self.uncovered = uncovered
        low, high = np.array([[r[1], r[2]] for r in ranges.values()]).T
        self.state = generator.uniform(low, high, (count, len(low)))
        self.right = compile_formula(robot.formula)
        # functions are compiled when they are first needed: before a mutant changes what they say
        if self.formula.has("forward"):
            self.poses = self.right.forward_many(self.state)
        else:
            one = self.right.program.pose_of_coordinates.one
            self.poses = np.array([one(x) for x in self.state]).reshape(-1, 4, 4)
        self.joints = None
        if self.formula.has("inverse"):
            self.joints = self.right.inverse_many(self.poses)
            if not self.formula.has("forward"):
                self.points = self._columns(self.right.points_many(Ts=self.poses))
        if self.formula.has("forward"):
            self._at_joints = formula_side.from_joints(self.formula, variant_choice.choose(self.formula, None))

    def _points_at(self, joints):
        """Return the points (k, 3 m) of the right equations at joints, which need not be those of their inverse."""
        function, names = self._at_joints.function, self._at_joints.names
        numbers = [float(p.value) for p in self.formula.parameters]
        found = function.map(len(joints))(joints.T, np.tile(np.array(numbers)[:, None], len(joints)))
        named = {n.removeprefix("point "): f.full().T for n, f in zip(names, found, strict=True) if "point " in n}
        return self._columns(named)

    def _columns(self, named):
        """Return the points that a claim covers, as columns."""
        kept = [p for name, p in named.items() if name not in self.uncovered]
        return np.column_stack([np.asarray(p).reshape(len(self.state), -1) for p in kept])

    def wrong(self):
        """Return the largest error of the equations as they are now, and the number of values that are missing."""
        with np.errstate(all="ignore"):
            now = compile_formula(self.formula)
            pairs = []
            if self.formula.has("forward"):
                pairs.append((now.forward_many(self.state), self.poses))
            if self.joints is not None:
                pairs += self._of_inverse(now)
        errors, missing = zip(*[_compared(found, expected) for found, expected in pairs], strict=True)
        return max(errors), sum(missing)

    def _of_inverse(self, now):
        """Return pairs of found and expected values of the inverse."""
        joints = now.inverse_many(self.poses)
        inside = np.isfinite(self.joints).all(axis=1)
        if not self.formula.has("forward"):
            points = self._columns(now.points_many(Ts=self.poses))
            return [(joints[inside], self.joints[inside]), (points[inside], self.points[inside])]
        pairs = [(self.right.forward_many(joints)[inside], self.poses[inside])]
        if len(self.formula.joints) > 6:
            return pairs  # the points of a redundant arm are not those of the right inverse
        points = self._columns(now.points_many(Ts=self.poses))
        return [*pairs, (points[inside], self._points_at(joints)[inside])]


def _compared(found, expected):
    """Return the largest difference of values, and the number of those that are missing where one is expected."""
    known = np.isfinite(expected)
    there = known & np.isfinite(found)
    missing = int(known.sum() - there.sum())
    return float(np.abs(found[there] - expected[there]).max(initial=0.0)), missing
