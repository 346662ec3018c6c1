"""Pairs of edits that are tried together at one pose, and edits of functions that are equations themselves."""

from __future__ import annotations

import time

import numpy as np
import pytest

from made import explain_seeds as seeds
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.function_source import Edit
from twin.validation.explain.rebuilt_functions import unguarded
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge, trial_residuals
from twin.validation.explain.swivel import at_best_swivel

TROCAR = "u = W - vertcat(trocar_x, trocar_y, trocar_z)"
OUTER = (
    ("hibou", (TROCAR, TROCAR.replace("-", "+")), ("return u / if_else", "return u * if_else")),
    ("+ -> -", "* -> /"),
)
WRIST = (
    "pa10",
    ("R04.T @ T_base_tool", "R04.T @ R_yaw"),
    ("atan2(R_yaw[1, 0], R_yaw[0, 0])", "atan2(R_yaw[0, 0], R_yaw[1, 0])"),
)


def changed(name, folder, *changes):
    case = seeds.built_in(name)
    text = case.path.read_text(encoding="utf-8")
    for right, wrong in changes:
        assert text.count(right) == 1
        text = text.replace(right, wrong)
    path = folder / "formula.py"
    path.write_text(text, encoding="utf-8")
    return case, case.load(path)


def searched(name, folder, *changes):
    case, formula = changed(name, folder, *changes)
    return RepairSearch(Judge(formula, None, case.reference), deadline=Deadline(30.0))


@pytest.mark.slow
def test_two_edits_of_one_token_are_the_first_pair(tmp_path):
    """The rows of another equation show them: the mechanism has no value of what `outer` returns."""
    search = searched("hibou", tmp_path, *OUTER[0][1:])
    one, other = next(search.pair_search.statement_pairs(search.judge.step("outer")).in_two_statements(Deadline(30.0)))
    assert (one.text, other.text) == OUTER[1]


def test_values_of_many_pairs_are_those_of_each_pair(tmp_path):
    search = searched("hibou", tmp_path, *OUTER[0][1:])
    crossed = search.pair_search.statement_pairs(search.judge.step("outer"))
    first, second = (crossed.sites[i].statement for i in (1, 3))
    trials = [(edit,) for edit in crossed._tokens[first.index][::9]]
    compared = 0
    with unguarded(), np.errstate(all="ignore"):
        parts = list(crossed._run(first, second, trials, crossed._tokens[second.index][::9], None, Deadline(30.0)))
        for others, firsts, found in parts:
            (row,) = found
            for n, residual in enumerate(found[row]):
                i, j = divmod(n, len(firsts))
                alone = trial_residuals(crossed.judge, crossed.step, [*firsts[j], *others[i]])
                (expected,) = (r for place, r in alone.items() if place.key == row)
                np.testing.assert_allclose(residual, expected[0], rtol=1e-6, atol=1e-3)
                compared += 1
    assert compared > 5


def test_the_best_swivel_is_found_where_a_row_can_agree():
    rng = np.random.default_rng(1)
    along, across = rng.standard_normal((2, 50, 3)) * 1e8
    angle = rng.uniform(-np.pi, np.pi, 50)
    mean = -along * np.cos(angle)[:, None] - across * np.sin(angle)[:, None]
    mean[25:] += 1e7
    values = [mean + along * np.cos(a) + across * np.sin(a) for a in (0.0, 2 * np.pi / 3, -2 * np.pi / 3)]
    largest = np.abs(at_best_swivel(*values)).max(axis=1)
    assert (largest[:25] <= 1).all()
    assert (largest[25:] > 1e3).all()


def test_a_swivel_that_moves_a_row_on_a_line_is_found():
    along = np.array([[1e8, 2e8, 0.0]])
    values = [np.cos(a) * along - np.cos(0.7) * along for a in (0.0, 2 * np.pi / 3, -2 * np.pi / 3)]
    assert np.abs(at_best_swivel(*values)).max() <= 1


def test_an_edit_of_a_scalar_to_a_vector_may_be_a_repair(tmp_path):
    """No value of the scalar a * RL3 makes the row agree, but the vector a * n does."""
    search = searched("pa10", tmp_path, ("return a * n + sqrt", "return a * RL3 + sqrt"))
    crossed = search.pair_search.statement_pairs(search.judge.step("elbow"))
    site = crossed.sites[-1]
    edits = [e for e in site.edits if e.old == "RL3"]
    likely = crossed.likely_edits(site.statement, edits, Deadline(30.0))
    assert {e.text for e in likely} == {"RL3 -> n"}


def test_an_edit_of_an_equation_that_others_call_is_judged_in_its_own_rows(tmp_path):
    """chain calls gimbal: another angle there makes the pose right, and the angle q6 of gimbal wrong."""
    search = searched("lapbot", tmp_path, ("-pi / 2 + q6", "q6"))
    step = search.judge.step("gimbal")
    chain = search.judge.step("chain")
    search.singles.until = search.deadline
    source = step.source
    start = source.data.index(b"asin(-u[1])")
    last = source.statements[-1]
    end = start + len(b"asin(-u[1])")
    new = "asin(-u[1]) - pi / 2"
    edit = Edit(source.path, source.line_of(start), start, end, "asin(-u[1])", new, "missing", last.index, source.name)
    with np.errstate(all="ignore"):
        candidate = search.candidate_for([chain], [edit])
    assert candidate.worst_residuals["chain", 1, 0] <= 1
    assert candidate.breaks_row
    assert search.choice.states.after([edit]).is_worse


SLOW = (
    OUTER[0],
    WRIST,
    ("lapbot", (TROCAR, "u = W"), ("a * cos(q2) + b", "a * cos(q3) + b")),
    (
        "pa10",
        ("RL3**2 - RL5**2 + D", "RL3**2 + D"),
        ("n) * n\n    e1 = e1 / norm_2(e1)\n    return", "n) / n\n    e1 = e1 / norm_2(e1)\n    return"),
    ),
    ("sher", ("norm_2(c3 - c1 - i * e_x)", "norm_2(c3 - c1 - e_x)"), ("H * cross(e_x", "cross(e_x")),
    ("lapbot", ("-pi / 2 + q6", "q6")),
    ("sils", ("(l_2 - l_1) * (q6 - q5)", "(l_2 - l_1)")),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change", SLOW, ids=["outer", "unknown name", "vector", "swivel", "factors", "four rows", "difference"]
)
def test_faults_in_several_statements_are_found(change, tmp_path, monkeypatch):
    monkeypatch.setattr(time, "monotonic", time.process_time)
    name, *changes = change
    case, formula = changed(name, tmp_path, *changes)
    assert seeds.outcome(case, formula, tmp_path, 16.0) in ("rank 1", "tie")
