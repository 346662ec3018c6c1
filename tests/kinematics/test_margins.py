"""Reach, singularity measures and aspects: every built-in row holds, and a wrong one is located or named.

`TWIN_MARGINS=40` seeds forty faults in each of three robots.
"""

from __future__ import annotations

import ast
import os
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from casadi import sqrt

from made.formulas import replaced
from made.lanes import contrasting, designs

FAULTS = int(os.environ.get("TWIN_MARGINS", "4"))
SEEDED = {"sher": ("margins",), "pa10": ("margins",), "lapbot": ("margins",)}


@cache
def setting(name):
    """Formula, independent model and states of a robot."""
    from twin import api
    from twin.validation.explain.judged_states import sample_states

    robot = api.load(name)
    return robot.formula, robot.reference(), sample_states(robot.reference())


def rows_of(formula, model, run):
    from twin.kinematics import compile_formula
    from twin.kinematics.margins import Margins

    turns = {j.name: j.is_angle for j in model.mechanism.joints}
    extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
    return Margins(compile_formula(formula, extra_joints=extra_joints), turns, tuple(run.points))


def judged(formula, model, run):
    from twin.reference.margin_zeros import ZeroCheck

    return {(r.name, r.kind): r for r in ZeroCheck(model, rows_of(formula, model, run), run.x).judge()}


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting(designs()))
def test_no_row_of_a_correct_robot_is_accused(name):
    found = judged(*setting(name))
    assert found, name
    assert [r for r in found.values() if r.status == "disagrees"] == []
    assert sum(r.status == "agrees" for r in found.values()) >= 0.7 * len(found)
    assert all(r.why for r in found.values())


def _stretch(more):
    """A function of the arm's helper in which the margin of reach promises `more` metres than there are."""
    from twin.robots.pa10 import margins

    def wrong(q2, q4, q6, P_m, RL3, RL5):
        out = list(margins(q2, q4, q6, P_m, RL3, RL5))
        out[0] = out[0] + more / 0.45 * RL3  # a part of a length: no slip of dimension
        return tuple(out)

    return wrong


@pytest.mark.parametrize("more", [0.004, -0.004])
def test_a_margin_of_reach_is_held_against_the_end_of_the_reach_and_its_error_is_measured(more):
    formula, model, run = setting("pa10")
    found = judged(replaced(formula, "margins", _stretch(more)), model, run)
    assert {k for k, r in found.items() if r.status == "disagrees"} == {("arm", "reach")}
    if more > 0:
        assert found["arm", "reach"].size == pytest.approx(4.0, abs=1e-3)
        assert found["arm", "reach"].unit == "mm"


def test_kinds_of_wrong_measures_are_told_apart():
    from casadi import cos, norm_2, sin

    formula, model, run = setting("pa10")
    D = 0.93

    def wrong(q2, q4, q6, P_m, RL3, RL5):
        aside = sqrt(P_m[0] ** 2 + P_m[1] ** 2)
        margins = RL3 + RL5 - norm_2(P_m), norm_2(P_m) - sqrt((RL3 - RL5) ** 2)
        return *margins, sin(q2) + 0 * P_m[0], -sin(q4), cos(q6), aside * aside / (RL3 + RL5) / D * RL3 / RL3

    found = judged(replaced(formula, "margins", wrong), model, run)
    status = {k: r.status for k, r in found.items()}
    assert status["shoulder", "type1"] == "agrees"  # another way to write the same
    assert status["elbow", "type1"] == "agrees"  # vanishes where it should ...
    assert "preferred sign" in found["s4", "aspect"].why
    assert status["s4", "aspect"] == "disagrees"
    assert "regular" in found["wrist", "type1"].why
    assert status["wrist", "type1"] == "disagrees"
    assert "dimension" in found["swivel_zero", "type1"].why
    assert status["swivel_zero", "type1"] == "disagrees"


@pytest.mark.slow
def test_a_margin_that_accepts_what_no_joint_can_do_is_found():
    from twin.robots.hibou import scope

    formula, model, run = setting("hibou")

    def wrong(T_base_tool, q1, q2, q3, q4, q5, a, b, h):
        q6, q7, within = scope(T_base_tool, q1, q2, q3, q4, q5, a, b, h)
        return q6, q7, 2e-6 - within

    found = judged(replaced(formula, "scope", wrong), model, run)
    assert found["five joints", "reach"].status == "disagrees"
    assert "poses that the mechanism cannot reach" in found["five joints", "reach"].why


def test_a_measure_of_the_formulas_own_angles_is_named_and_not_accused():
    formula, model, _ = setting("pa10")
    from twin.validation.explain.judged_states import sampled_values

    found = judged(formula, model, sampled_values(formula, model).run)
    assert found["swivel_zero", "type1"].status != "disagrees"


# -- faults seeded into the text ---------------------------------------------------------------------------


def seeded(name, rng):
    """Yield formulas with one edit in a helper that gives margins, the rows that it changes, and what was done."""
    import tempfile

    from twin.analysis.mutation.formula import KINDS
    from twin.core.errors import TwinError
    from twin.robots import load_formula
    from twin.validation.explain.function_source import Source, patched
    from twin.validation.explain.name_pool import name_pool
    from twin.validation.explain.statement_edits import statement_edits

    formula, model, run = setting(name)
    sources = [Source(e.variants[e.default]) for e in formula.equations if e.name in SEEDED[name]]
    scope = {e.name: e.variants[e.default].__globals__ for e in formula.equations}[SEEDED[name][0]]
    parameters = {p.name for p in formula.parameters}
    good = rows_of(formula, model, run).values(run)
    seen = set()
    while True:
        source = sources[rng.integers(len(sources))]
        statement = source.statements[rng.integers(len(source.statements))]
        kinds = KINDS[list(KINDS)[rng.integers(len(KINDS))]]
        around = name_pool(source, statement, set(source.arguments), parameters & set(source.arguments), scope)
        some = [e for e in statement_edits(source, statement, around, kinds) if e.define is None]
        if not some:
            continue
        edit = some[rng.integers(len(some))]
        text = patched([edit])
        if text in seen:
            continue
        seen.add(text)
        path = Path(tempfile.mkdtemp(prefix="twin-margins-")) / "formula.py"
        path.write_text(text, encoding="utf-8")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                wrong = load_formula(path)
                rows = rows_of(wrong, model, run)
                values = rows.values(run)
        except TwinError:
            continue
        size = np.abs(good).max(axis=0)
        changed = [i for i in range(len(size)) if not np.abs(values[:, i] - good[:, i]).max() <= 1e-9 * size[i]]
        if changed:
            yield wrong, {(rows.names[i], rows.kinds[i]) for i in changed}, f"{edit.line}: {edit.text}"


@pytest.mark.slow
def test_seeded_faults_are_caught_or_named(capsys):
    """Of a dozen and more, nine in ten are caught; the rest are rows that the answer names as not judged, mostly."""
    counts = {"caught": 0, "named": 0, "missed": 0}
    for name in SEEDED:
        _, model, run = setting(name)
        faults = seeded(name, np.random.default_rng(3))
        for _ in range(FAULTS):
            wrong, changed, what = next(faults)
            found = judged(wrong, model, run)
            mine = {found[k].status for k in changed}
            kind = "caught" if "disagrees" in mine else "named" if "not judged" in mine else "missed"
            counts[kind] += 1
            if kind != "caught":
                with capsys.disabled():
                    print(f"\n  {name} {what}: {kind} ({', '.join(n for n, _ in changed)})", end="")
    with capsys.disabled():
        print(f"\n  {counts}")
    assert counts["caught"] >= 0.8 * sum(counts.values())
    assert counts["missed"] <= 0.15 * sum(counts.values())


class _Rewritten(ast.NodeTransformer):
    """Sums and products the other way round, squares as products: the same functions, with other rounding."""

    def visit_BinOp(self, node):
        self.generic_visit(node)
        if isinstance(node.op, ast.Add | ast.Mult):
            return ast.BinOp(node.right, node.op, node.left)
        if isinstance(node.op, ast.Pow) and isinstance(node.right, ast.Constant) and node.right.value == 2:
            return ast.BinOp(node.left, ast.Mult(), node.left)
        return node


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting(designs()))
def test_the_same_rows_written_otherwise_are_not_accused(name, tmp_path):
    from twin import robots
    from twin.robots import load_formula

    _, model, run = setting(name)
    source = Path(robots.__file__).with_name(f"{name}.py")
    tree = ast.parse(source.read_text(encoding="utf-8"))
    makers = {"margins", "limbs", "type2", "scope", "tilt_angles"}
    tree.body = [_Rewritten().visit(n) if isinstance(n, ast.FunctionDef) and n.name in makers else n for n in tree.body]
    path = tmp_path / "formula.py"
    path.write_text(ast.unparse(ast.fix_missing_locations(tree)), encoding="utf-8")
    found = judged(load_formula(path), model, run)
    assert [r for r in found.values() if r.status == "disagrees"] == []
    assert sum(r.status == "agrees" for r in found.values()) >= 0.7 * len(found)


# -- what people are told ----------------------------------------------------------------------------------


def test_validate_reports_a_wrong_measure_with_row_pose_and_size(tmp_path):
    """The whole way: the formula of a file, judged, with a finding that names the row."""
    from twin.core.findings import verdict
    from twin.kinematics import compile_formula
    from twin.validation.equations_comparison import EquationsComparison
    from twin.validation.margins import check_equations_margins
    from twin.validation.residual_rows import Tolerances

    formula, model, run = setting("pa10")
    for more, expected in ((0.0, "agree"), (0.004, "disagree")):
        out = EquationsComparison(posed=run)
        check_equations_margins(compile_formula(replaced(formula, "margins", _stretch(more))), model, Tolerances(), out)
        assert verdict(out.findings) == expected
        assert "of 8" in out.facts["reach, singularity measures, aspects"]["rows judged"]
    (finding,) = out.findings
    assert finding.code == "margin.reach"
    assert finding.where == "margins.stretch"
    assert "q1" in finding.when
    assert finding.size == pytest.approx(4.0, abs=1e-3)
    assert finding.unit == "mm"


@pytest.mark.slow
def test_explain_counts_what_was_judged_and_locates_a_wrong_measure(tmp_path):
    from twin.cli.show import plain
    from twin.robots import load_formula, pa10
    from twin.validation.explain.explain import ExplainOptions, explain

    formula, model, _ = setting("pa10")
    result = explain("pa10", formula, model)
    said = "\n".join(map(plain, result.text()))
    assert result.verdict == "agree"
    assert f"{result.judged} of {result.rows_of_formula} rows judged" in said
    left = [n for n in result.notes if n.startswith("not judged: ")]
    assert len(left) == result.rows_of_formula - result.judged

    text = Path(pa10.__file__).read_text(encoding="utf-8")
    assert text.count("sin(q2), sin(q4), sin(q6), aside /") == 1
    path = tmp_path / "formula.py"
    path.write_text(
        text.replace("sin(q2), sin(q4), sin(q6), aside /", "sin(q2), cos(q4), sin(q6), aside /"), encoding="utf-8"
    )
    result = explain("pa10", load_formula(path), model, options=ExplainOptions(root=tmp_path))
    assert result.verdict == "disagree"
    assert not result.explained
    assert result.exit_code == 1
    assert {r.symbol for r in result.rows} == {"s4"}
    row = result.rows[0]
    assert row.file == "formula.py"
    assert "cos(q4)" in path.read_text(encoding="utf-8").splitlines()[row.line - 1]
    said = "\n".join(map(plain, result.text()))
    assert "the mechanism is regular" in said
    assert f"formula.py:{row.line}" in said


# -- the machinery ------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting(designs()))
def test_motions_keep_the_loops_closed_and_degeneracy_is_one_at_usual_states(name):
    from twin.reference.degeneracy import Degeneracy

    _, model, run = setting(name)
    motions = Degeneracy(model, run.x[:6])
    assert motions.freedom == model.mobility(run.x[0]).freedom
    steps = 1e-4 * motions.motions(run.x[:6])[:, :, 0]
    there = model.tree.integrate(run.x[:6], steps)
    gaps = model.collect(there).gaps[..., 0].max(initial=0.0)
    assert gaps < 1e-7  # of second order in the step
    closed, good = motions.moved(run.x[:6], 100 * steps)
    assert good.all()
    assert model.collect(closed).gaps[..., 0].max(initial=0.0) < 1e-11
    assert 0.1 < np.median(motions.of(run.x[:6])) < 10


@pytest.mark.slow
def test_the_names_of_margins_are_the_formulas():
    formula, model, run = setting("sils")
    rows = rows_of(formula, model, run)
    assert len(rows.names) == len(formula.reach) + len(formula.measures) + len(formula.aspects)
    values = rows.values(run)
    assert values.shape == (len(run.x), len(rows.names))
    assert np.isfinite(values).all()
    larger = rows.values(run, 2.0)
    lengths = np.array([k == "reach" for k in rows.kinds])
    assert larger[:, lengths] == pytest.approx(2 * values[:, lengths], rel=1e-9)


SIZES = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
TOLERANCES = (1e-6, 5e-6, 1e-5, 5e-5, 2e-4)


def disagreements_of(name, parameter, size, tolerances):
    """Return for each tolerance in m whether the equations, with one length off by `size` in m, disagree."""
    from twin import api
    from twin.validation.case import Case
    from twin.validation.judge import judge
    from twin.validation.residual_rows import Tolerances

    robot = api.load(name)
    protocol = robot.protocol(None)
    bound = robot.bound(protocol)
    moved = bound.with_parameters({parameter: bound.kinematics().parameters[parameter] + size})
    trajectory = api.plan(robot, protocol)
    out = []
    with robot.source.fresh_stage() as stage:
        for tolerance in tolerances:
            used = Tolerances().widened(tolerance, robot.mechanism.link_length)
            case = Case(moved.kinematics(), robot.cad, protocol, trajectory, stage, used, moved.path_kinematics())
            report = judge(case, parts=frozenset(("equations",)))
            out.append(any(f.severity == "disagreement" for f in report.findings))
    return out


@pytest.mark.slow
def test_an_error_far_below_the_tolerance_is_accused_at_no_zero():
    """The zeros of SHER's slider-crank move by the square root of an error."""
    assert disagreements_of("sher", "BC", 1e-8, (1e-6,)) == [False]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "parameter"),
    [("sher", "BC"), ("davinci_psm", "second"), ("sils", "l_1"), ("lapbot", "r10"), ("pa10", "RL8")],
)
def test_the_tolerance_is_monotonic(name, parameter):
    grid = np.array([disagreements_of(name, parameter, size, TOLERANCES) for size in SIZES])
    assert (np.diff(grid.astype(int), axis=0) >= 0).all(), grid  # a larger error is no better
    assert (np.diff(grid.astype(int), axis=1) <= 0).all(), grid  # a larger tolerance is no worse
    tenth = np.array(SIZES)[:, None] <= np.array(TOLERANCES) / 10
    assert not grid[tenth].any(), grid
    assert grid[-1, 0]
