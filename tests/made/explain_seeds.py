"""Seeded faults for `twin explain`: robots, changed tokens of their equations, and the judgement of a repair."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import io
import re
import sys
import time
import tokenize
from contextlib import ExitStack, contextmanager
from pathlib import Path

import casadi as ca
import numpy as np

SWAPS = {"sin": "cos", "cos": "sin", "acos": "asin", "asin": "acos", "+": "-", "-": "+", "*": "/", "/": "*"}
STRANGERS = Path(__file__).parents[1] / "data/strangers"


class Case:
    """A correct formula, the mechanism's values of its symbols (`reference`), and a loader of changed files."""

    def __init__(self, name, path, formula, reference):
        self.name, self.path, self.formula, self.reference = name, path, formula, reference

    def load(self, path):
        from twin.robots import load_formula

        joints = [(j.name, j.kind == "revolute") for j in self.formula.joints]
        return load_formula(path, self.name, lambda: (joints, np.eye(4), None), trial=True)

    def changed(self, **by):
        """Return values of another mechanism: its parameters are larger by `by` in SI than those of the formula."""
        symbols = self.reference.symbols
        return self.reference.with_values({n: symbols[n] + d for n, d in by.items()})


def built_ins():
    """Return a case for each built-in robot whose equations are in a file of their own."""
    from twin.robots import names

    return [case for case in map(built_in, names()) if case.path.stem == case.name]


def built_in(name):
    from twin import api
    from twin.robots import load_formula
    from twin.validation.explain.judged_states import sampled_values

    formula = load_formula(name)
    return Case(name, _file_of(formula), formula, sampled_values(formula, api.load(name).reference()))


def stranger(path):
    """Return the case of a plain formula that is not built in; its reference values are what it returns for numbers."""
    from twin.validation.explain.judged_states import SAMPLES
    from twin.validation.explain.rebuilt_functions import Matrix, Rebuilder
    from twin.validation.explain.reference_values import ReferenceValues

    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    poses, joints = POSES[path.stem]
    case = Case(path.stem, path, _Joints(joints), None)
    formula = case.load(path)
    values = {p.name: float(p.value) for p in formula.parameters}
    Ts = poses(np.random.default_rng(3), SAMPLES)
    q = np.array([module.inverse(T, **values) for T in Ts])
    assert np.isfinite(q).all()
    symbols = {**values, "T_base_tool": Matrix(Ts)}
    kinds = {"T_base_tool": "pose"}
    c = formula.coordinates
    for name, unit, x in zip(c.names, c.units, Rebuilder().function(c.from_pose)(Matrix(Ts)), strict=True):
        symbols[name], kinds[name] = x, "angle" if unit == "rad" else "length"
    for i, (name, angle) in enumerate(joints):
        symbols[name], kinds[name] = q[:, i], "angle" if angle else "length"
    reference = ReferenceValues(symbols, kinds, SAMPLES, Ts, None, tuple(zip(c.names, c.units, strict=True)), {})
    return Case(path.stem, path, formula, reference)


class _Joints:
    """Replacement of a formula that has only joints, to load a file with these joints."""

    def __init__(self, joints):
        from twin.formula.contract import ActiveJoint

        self.joints = [ActiveJoint(n, "revolute" if angle else "prismatic") for n, angle in joints]


def _poses(centre, spread, tilt=0.0):
    def draw(rng, k):
        from scipy.spatial.transform import Rotation

        T = np.tile(np.eye(4), (k, 1, 1))
        T[:, :3, 3] = np.array(centre) + np.array(spread) * rng.uniform(-1, 1, (k, 3))
        T[:, :3, :3] = Rotation.from_rotvec(tilt * rng.uniform(-1, 1, (k, 3))).as_matrix()
        return T

    return draw


POSES = {
    "delta": (_poses((0, 0, -0.45), (0.08, 0.08, 0.05)), [(f"q{i}", True) for i in (1, 2, 3)]),
    "five_bar": (_poses((0.02, 0.2, 0), (0.05, 0.04, 0)), [("q1", True), ("q2", True)]),
    "stewart": (_poses((0, 0, 0.6), (0.05, 0.05, 0.05), 0.2), [(f"q{i}", False) for i in range(1, 7)]),
}


# ------------------------------------------------------------------------------------------------------ faults


def functions(formula):
    """Return the functions in a formula's file that its equations use, in their default variants."""
    found, todo = [], [inspect.unwrap(e.variants[e.default]) for e in formula.equations if e.stage != "helper"]
    home = _own(formula).__globals__
    while todo:
        f = todo.pop(0)
        if f not in found and f.__globals__ is home:
            found.append(f)
            todo += [home[n] for n in f.__code__.co_names if inspect.isfunction(home.get(n))]
    return found


def faults(f, rng, count):
    """Return `count` random changes of tokens of a function, [(line, column, old, new)]; None if there are too few."""
    source, first = inspect.getsourcelines(f)
    tree = ast.parse("".join(source)).body[0]
    start = tree.body[1].lineno if isinstance(tree.body[0], ast.Expr) else tree.body[0].lineno
    arguments = f.__code__.co_varnames[: f.__code__.co_argcount]
    names = sorted({*arguments, *re.findall(r"\b([A-Za-z_]\w*) = ", "".join(source))})
    tokens = [
        t
        for t in tokenize.generate_tokens(io.StringIO("".join(source)).readline)
        if t.start[0] >= start and t.type in (tokenize.NAME, tokenize.OP, tokenize.NUMBER)
    ]
    stored = (n for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store))
    assigned = {(n.lineno, n.col_offset) for n in stored}
    usable = []
    for i, t in enumerate(tokens):
        s = t.string
        if t.start in assigned:
            continue
        if s in SWAPS:
            if not (s in "+-" and tokens[i - 1].string in ("(", ",", "=", "return", "*", "/", "[")):
                usable.append((t, [SWAPS[s]]))
            else:
                usable.append((t, [" "]))  # a missing sign
        elif t.type == tokenize.NUMBER:
            n = ast.literal_eval(s)
            usable.append((t, [str(x) for x in (n + 1, 2 * n, max(n - 1, 0)) if x != n]))
        elif s in names and tokens[min(i + 1, len(tokens) - 1)].string != "(":
            alike = [n for n in names if n != s and re.sub(r"\d", "", n) == re.sub(r"\d", "", s)]
            usable.append((t, alike or [n for n in names if n != s]))
    if len(usable) < count:
        return None
    out = []
    for i in rng.choice(len(usable), count, replace=False):
        t, news = usable[i]
        if not news:
            return None
        out.append((first + t.start[0] - 1, t.start[1], t.string, news[rng.integers(len(news))]))
    return sorted(out)


def seeded(case, path, rng, count=1):
    """Write a file with `count` random faults in one function; return the faults as text.

    Return None if no faults were found, or if one of several faults has no effect alone.
    """
    from twin.core.errors import TwinError
    from twin.validation.explain.row_deviations import Judge

    choices = functions(case.formula)
    f = choices[rng.integers(len(choices))]
    done = faults(f, rng, count)
    if done is None:
        return None
    text = Path(f.__code__.co_filename).read_text(encoding="utf-8")

    def write(some):
        lines = text.splitlines(keepends=True)
        for line, column, old, new in reversed(some):
            row = lines[line - 1]
            lines[line - 1] = row[:column] + new + row[column + len(old) :]
        return "".join(lines)

    for i, one in enumerate(done if count > 1 else ()):  # each of several faults must have an effect alone
        alone = path.with_name(f"alone{i}_{path.name}")
        alone.write_text(write([one]), encoding="utf-8")
        try:
            if not Judge(case.load(alone), None, case.reference).failing():
                return None
        except TwinError:
            return None
    path.write_text(write(done), encoding="utf-8")
    return "; ".join(f"{f.__name__}:{line}: {old} -> {new.strip() or '(nothing)'}" for line, _, old, new in done)


# ------------------------------------------------------------------------------------------------------ verdicts


def same_function(formula, other, reference):
    """Return whether two formulas give equal residuals at perturbed values, which no mechanism has."""
    from twin.validation.explain.row_deviations import Judge, worst

    shaken = reference.perturbed(5)
    a, b = (
        {(p.equation, p.symbol): r for p, r in Judge(x, None, shaken).residuals.items() if worst(r) != 0}
        for x in (formula, other)
    )
    if a.keys() != b.keys():
        return False
    for k in a:
        if not np.array_equal(np.isfinite(a[k]), np.isfinite(b[k])):
            return False
        size = np.nanmax(np.abs(a[k]), initial=1.0)
        if not np.nanmax(np.abs(a[k] - b[k]), initial=0.0) <= 1e-7 * size:
            return False
    return True


def _worse(judge, key, score):
    """Whether a residual exceeds the tolerance and the residual of the same row before."""
    before = max((np.abs(r).max() for p, r in judge.residuals.items() if p.key == key), default=np.inf)
    return np.isfinite(before) and score > max(1.0, 1.01 * before)


BY_CHANCE = "the cure holds by chance"


def _kept(pick):
    """Return the edits of (result, candidate) pairs that change what the functions compute."""
    return [e for _, c in pick for e in c.edits if e.kind != "left side"]


def outcome(case, faulty, folder, budget):
    """Return how a fault was explained: "rank 1", "tie", or why it was not.

    "no fault": no row is wrong. "no formula": an equation cannot be run. `BY_CHANCE`: the cure at rank 1 fails if equal
    parameters become different, or if assumed ones have another value.
    """
    from twin.validation.explain.deadline import Deadline
    from twin.validation.explain.parameter_coincidences import coincidences
    from twin.validation.explain.repair_search import RepairSearch
    from twin.validation.explain.row_deviations import Judge

    reference = case.reference
    judge, whole = Judge(faulty, None, reference), Judge(case.formula, None, reference)
    if {s.equation.name for s in judge.steps if s.missing} != {s.equation.name for s in whole.steps if s.missing}:
        return "no formula"  # Python itself reports this error
    if not judge.failing():
        return "no fault"
    found, lost = RepairSearch(judge, deadline=Deadline(max(budget, 4.0))).run(budget)
    cures = [c for f in found for way in f.cures for c in way]
    worse = [c.edits[0].text for c in cures if any(_worse(judge, k, s) for k, s in c.worst_residuals.items())]
    assert not worse, f"a cure makes a row worse: {worse}"
    if lost:
        return f"nothing exact found for {lost}"

    def repaired(pick, name):
        edits = _kept(pick)
        if not edits:
            return False
        with _edited(case, _file_of(faulty), edits, folder / f"{name}.py") as cured:
            return same_function(case.formula, cured, reference)

    best = [(f, f.cures[0][0]) for f in found]
    with _edited(case, _file_of(faulty), _kept(best), folder / "varied.py") as cured:
        if coincidences(Judge(cured, None, reference)):
            return BY_CHANCE
    single = all(len(f.cures) == 1 for f in found)
    if repaired(best, "best"):
        return "rank 1" if single else "tie"
    if single:
        return "another function fits: " + "; ".join(e.text for _, c in best for e in c.edits)
    for i in range(1, max(len(f.cures) for f in found)):
        if repaired([(f, f.cures[min(i, len(f.cures) - 1)][0]) for f in found], f"way{i}"):
            return "tie"
    return "a tie without the truth in it: " + "; ".join(e.text for _, c in best for e in c.edits)


# ------------------------------------------------------------------------------------------------------ tautologies


class Slopes:
    """Derivatives of a row with respect to the symbols that it uses, by CasADi; shares no code with the search."""

    def __init__(self, formula, equation, values):
        """Evaluate an equation on symbols; `values` are the values (k, ...) of its arguments, by name."""
        e = next(e for e in formula.equations if e.name == equation)
        f = e.variants[e.default]
        self.outputs = list(e.outputs)
        self.symbols, self.at = {}, {}
        for name in inspect.signature(f).parameters:
            if name in values:
                a = np.atleast_1d(np.asarray(getattr(values[name], "a", values[name]), float))
                self.symbols[name] = ca.SX.sym(name, *a.shape[1:])
                self.at[name] = a
        self.values = f(**self.symbols)
        if not isinstance(self.values, tuple | list):
            self.values = [self.values]

    def of(self, output, left=""):
        """Return {symbol: largest slope} of a row; for an implicit row, of its right side minus its left side."""
        row = ca.vec(ca.SX(self.values[self.outputs.index(output)]))
        unknown = left or output
        if unknown in self.symbols:
            row = row - ca.vec(self.symbols[unknown])
        names = list(self.symbols)
        J = [ca.densify(ca.jacobian(row, ca.vec(self.symbols[n]))) for n in names]
        fun = ca.Function("J", [self.symbols[n] for n in names], J)
        out = dict.fromkeys(names, 0.0)
        k = max(len(a) for a in self.at.values())
        for i in range(0, k, max(k // 6, 1)):
            got = fun(*(self.at[n][min(i, len(self.at[n]) - 1)] for n in names))
            for n, g in zip(names, got if isinstance(got, tuple | list) else [got], strict=True):
                g = np.abs(np.array(g))
                g = g[np.isfinite(g)]
                out[n] = max(out[n], float(g.max(initial=0.0)))
        return out


def _read(faulty, equation, values, output, left=""):
    """Return the slopes of a row of a faulty formula; empty if it uses a name or an index that does not exist."""
    try:
        return Slopes(faulty, equation, values).of(output, left)
    except (NameError, IndexError, RuntimeError):
        return {}


def _own(formula):
    """Return a function of the formula's own file; the first equation may be in a file that several robots share."""
    made = [inspect.unwrap(e.variants[e.default]) for e in formula.equations]
    return next((f for f in made if "FORMULA" in f.__globals__), made[0])


def _file_of(formula):
    """Return the formula's own file."""
    return Path(inspect.getfile(_own(formula)))


@contextmanager
def in_place_of(home, text, folder):
    """Replace the text of a file that built-in formulas share, during the block."""
    name = f"twin.robots.{home.stem}"
    path = folder / home.name
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(name, path)
    module, true = importlib.util.module_from_spec(spec), sys.modules[name]
    spec.loader.exec_module(module)
    sys.modules[name] = module
    try:
        yield
    finally:
        sys.modules[name] = true


@contextmanager
def _edited(case, own, edits, path):
    """Yield a formula after edits of its own file and of files that it shares with other formulas."""
    from twin.validation.explain.function_source import patched

    texts = {home: patched([e for e in edits if e.path == home]) for home in {e.path for e in edits}}
    path.write_text(texts.pop(own, None) or own.read_text(encoding="utf-8"), encoding="utf-8")
    with ExitStack() as shared:
        for home, text in texts.items():
            shared.enter_context(in_place_of(home, text, path.parent))
        yield case.load(path)


def empty(case, judge, faulty, candidate, rows, folder):
    """Return which symbol a repaired row no longer depends on, if the candidate does not report it; "" if none.

    The symbol is one that the row used before, or the row's own unknown.
    """
    from twin.validation.explain.function_source import patched

    edits = [e for e in candidate.edits if e.kind != "left side"]
    own = _file_of(faulty)
    if edits and {e.path for e in edits} == {own}:
        text, true = patched(edits).splitlines(), case.path.read_text(encoding="utf-8").splitlines()
        if len(text) == len(true) and all(text[e.line - 1] == true[e.line - 1] for e in edits):
            return ""  # the edited lines are correct; other lines may have faults
    with _edited(case, own, edits, folder / "cure.py") as cured:
        pass
    left = {(e.statement, e.old): e.new for e in candidate.edits if e.kind == "left side"}
    for place in judge.residuals:
        if (place.equation, place.statement, place.position) not in rows:
            continue
        step = judge.step(place.equation)
        if not step.before:
            continue
        on, off = ({**step.computed, **t.symbols} for t in (judge.reference, judge.reference.perturbed(11)))
        was, now, far, meant = {}, {}, {}, {}
        for values, into in ((on, now), (off, far)):
            for n, x in _read(faulty, place.equation, values, place.symbol).items():
                was[n] = max(was.get(n, 0.0), x)
            side = left.get((place.statement, place.symbol), "")
            if not was and not _read(cured, place.equation, values, place.symbol, side):
                break  # another fault of the equation prevents its evaluation
            into.update(Slopes(cured, place.equation, values).of(place.symbol, side))
            for n, x in _read(case.formula, place.equation, values, place.symbol).items():
                meant[n] = max(meant.get(n, 0.0), x)
        if not now:
            continue
        lost = {n for n, x in was.items() if x > 1e-9 and max(now.get(n, 0.0), far.get(n, 0.0)) < 1e-12}
        lost -= set(candidate.dropped)
        lost -= {n for n, x in meant.items() if x < 1e-12}  # symbols that only the fault had introduced
        # A dropped output also explains the loss of the symbols on which it depends.
        for output in set(candidate.dropped) & set(step.equation.outputs):
            lost -= {n for n, x in _read(faulty, place.equation, on, output).items() if x}
        # An equation after the faulty one may have no value with its outputs: then no slope can be lost.
        if lost or (max(was.values(), default=1.0) > 1e-12 and max(*now.values(), *far.values()) < 1e-12):
            return f"{place.symbol} lost {sorted(lost)}: " + "; ".join(e.text for e in candidate.edits)
        unknown = [n for n in step.equation.outputs if n in now]
        if place.symbol in unknown and max(now[n] for n in unknown) < 1e-9:
            return f"{place.symbol} does not settle {unknown}: " + "; ".join(e.text for e in candidate.edits)
    return ""


_TILT = """    th2 = theta - pi / 2 + phi4 + phi3
    a = CD * cos(th2) - AB * cos(phi1)
    b = AB * sin(phi1) - CD * sin(th2)
    L = hypot(a, b)
    th1 = pi / 2 - acos((DA**2 + L**2 - BC**2) / (2 * DA * L)) + atan2(a, b)
    al"""


WHOLE_ELSEWHERE = (_TILT, _TILT.replace("theta - pi / 2 + phi4", "phi4").replace("atan2(a, b)", "atan2(b, a)"))


ELEMENTS = (
    ("atan2(M[1, 1], M[0, 1])", "atan2(M[0, 1], M[1, 1])"),
    ("atan2(-M[2, 0], M[2, 2])", "atan2(-q1[2, 0], M[2, 2])"),
)


def misprinted(name, right, wrong, folder, *more):
    """Return (case of a built-in robot, its equations with `wrong` in place of the one `right`, and `more` such)."""
    case = built_in(name)
    text = case.path.read_text(encoding="utf-8")
    for old, new in ((right, wrong), *more):
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = folder / "formula.py"
    path.write_text(text, encoding="utf-8")
    return case, case.load(path)


def require_repair(change, tmp_path, monkeypatch, seconds):
    """Check that the edits of a robot's formula are undone at rank 1 or in a tie, within so much processor time."""
    monkeypatch.setattr(time, "monotonic", time.process_time)
    name, first, *more = change
    case, formula = misprinted(name, *first, tmp_path, *more)
    assert outcome(case, formula, tmp_path, seconds) in ("rank 1", "tie")
