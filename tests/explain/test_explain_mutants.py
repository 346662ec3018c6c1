"""Mutants of eight robots, among them missing terms, factors, squares and signs: are they found and undone, in time?

`TWIN_MUTANTS=300` and `TWIN_MUTANT_PAIRS=60` are the long counts, `TWIN_MUTANTS_SEED` other mutants.
`TWIN_SWAPS=7` swaps the arguments of every atan2 of the Raven.
"""

from __future__ import annotations

import ast
import os
import time
from pathlib import Path

import numpy as np
import pytest

from made import explain_campaign as campaign
from made import explain_seeds as seeds
from made.explain_seeds import misprinted
from twin import api
from twin.robots import _raven
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.explain import explain
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge

COUNT = int(os.environ.get("TWIN_MUTANTS", "8"))
PAIRS = int(os.environ.get("TWIN_MUTANT_PAIRS", "1"))
SWAPS = int(os.environ.get("TWIN_SWAPS", "1"))
SEED = int(os.environ.get("TWIN_MUTANTS_SEED", "7"))
SECONDS = campaign.SEARCH


def check(count, kind, folder, capsys):
    """Return (share of mutants with an exact or tied cure, processor times in s).

    No cure may make a row worse, or fail when equal or assumed parameters are varied.
    """
    judged = []
    for entry in campaign.outcomes(kind, SEED, folder):
        if entry["outcome"] not in campaign.NO_MUTANTS:
            judged.append(entry)
        if len(judged) == count:
            break
    with capsys.disabled():
        print("", *campaign.summary(kind, judged), sep="\n")
    assert not campaign.harmful(judged)
    found = [entry for entry in judged if entry["outcome"] in campaign.FOUND]
    return len(found) / count, [entry["seconds"] for entry in judged]


@pytest.mark.slow
def test_mutants_of_one_token_are_undone_in_time(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(time, "monotonic", time.process_time)  # the time of a machine that does nothing else
    share, times = check(COUNT, "one", tmp_path, capsys)
    assert share >= (0.95 if COUNT >= 100 else 0.85)
    assert np.quantile(times, 0.95) <= 10
    assert max(times) <= 20


@pytest.mark.nightly
def test_the_time_of_mutants_of_two_tokens_is_bounded(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(time, "monotonic", time.process_time)
    _, times = check(PAIRS, "two", tmp_path, capsys)
    assert max(times) <= 20


def test_repairs_of_two_groups_that_undo_each_other_are_not_proposed(tmp_path):
    """One of two edits that repair q4 has no effect on it, but makes q1 and q2 wrong."""
    second = ("atan2(sqrt(w[0] ** 2 + w[1] ** 2), w[2])", "atan2(sqrt(w[1] ** 2), w[2])")
    first = ("P_c[0] * P_m[0] + P_c[1] * P_m[1]", "P_c[0] * P_m[0] - P_c[1] * P_m[1]")
    case, formula = misprinted("pa10", *first, tmp_path, second)
    assert seeds.outcome(case, formula, tmp_path, 4.0) in ("rank 1", "tie")


@pytest.mark.parametrize(
    ("right", "old", "new"),
    [
        ("return X_S1, Y_S1, Z_S1, X_S2, Y_S2, Z_S2, X_S3, Y_S3, Z_S3", "Z_S1", "Z_S2"),
        pytest.param("return q1, q2, q3, q4, q5, q6", "q5", "q3", marks=pytest.mark.slow),
    ],
    ids=["explicit", "implicit"],
)
def test_a_wrong_name_in_a_return_statement_is_found(right, old, new, tmp_path):
    """The returned symbol has a row of its own above, so that the cured return is right for every value."""
    case, formula = misprinted("sils", right, right.replace(old, new), tmp_path)
    assert seeds.outcome(case, formula, tmp_path, 4.0) == "rank 1"


def test_cures_of_two_rows_hold_together_for_other_values_of_the_swivel(tmp_path):
    """q3 is 180 deg or zero at swivel 0, so that a multiple of it agrees there as well."""
    second = ("P_m[1] < 0, -1, 1)", "P_m[1] < 0, 1, 1)")
    case, formula = misprinted("pa10", "q2, atan2(w[1], w[0])", "q2, atan2(w[0], w[1])", tmp_path, second)
    assert seeds.outcome(case, formula, tmp_path, 16.0) in ("rank 1", "tie")


@pytest.mark.slow
def test_a_cure_that_needs_another_swivel_than_that_of_the_formula_is_none(tmp_path):
    """With a fitted swivel, the elbow row agrees without its cross product, but the pose does not follow from it."""
    second = ("sqrt(RL3**2 - a**2)", "sqrt(RL5**2 - a**3)")
    case, formula = misprinted("pa10", *second, tmp_path)
    found, lost = RepairSearch(Judge(formula, None, case.reference), deadline=Deadline(8.0)).run(0.0)
    assert lost
    assert not found[0].cures


@pytest.mark.slow
@pytest.mark.parametrize("site", [*range(0, 7, 6), *range(1, 6)][:SWAPS])
def test_swapped_arguments_in_a_slow_function_are_found_in_time(site, tmp_path, monkeypatch):
    """The inverse of the Raven has eight candidates, so that one edit takes some milliseconds."""
    monkeypatch.setattr(time, "monotonic", time.process_time)
    home = Path(_raven.__file__)
    text = home.read_text(encoding="utf-8")
    calls = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Call) and getattr(n.func, "id", "") == "atan2"]
    calls.sort(key=lambda n: (n.lineno, n.col_offset))
    assert len(calls) == 7
    call = calls[site]
    first, second = (ast.get_source_segment(text, argument) for argument in call.args)
    right = ast.get_source_segment(text, call)
    lines = text.splitlines(keepends=True)
    line = lines[call.lineno - 1]
    wrong = f"atan2({second}, {first})"
    lines[call.lineno - 1] = line[: call.col_offset] + wrong + line[call.col_offset + len(right) :]
    robot = api.load("raven_left")
    case = seeds.Case("raven_left", home.with_name("raven_left.py"), robot.formula, None)
    formula = tmp_path / "formula.py"
    formula.write_text(case.path.read_text(encoding="utf-8"), encoding="utf-8")
    with seeds.in_place_of(home, "".join(lines), tmp_path):
        faulty = case.load(formula)
        began = time.process_time()
        x = explain("raven_left", faulty, robot.reference())
        seconds = time.process_time() - began
    assert (x.verdict, x.lead, len(x.repairs)) == ("disagree", "edits", 1)
    change = x.repairs[0].cures[0][0].changes[0]
    assert (change.line, change.kind) == (call.lineno, "order")
    assert change.after == text.splitlines()[call.lineno - 1].strip()
    assert seconds <= 10
