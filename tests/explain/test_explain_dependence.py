"""No cure may empty a row: the search never offers q1 = q1, a copy of the row beside it, or content times zero."""

from __future__ import annotations

import os
import shutil
import time

import casadi as ca
import numpy as np
import pytest

from made import explain_seeds as seeds
from made.lanes import nightly
from twin.core.errors import TwinError
from twin.validation.explain import determined_unknowns, rebuilt_functions
from twin.validation.explain.candidate import Candidate, edited_residuals
from twin.validation.explain.function_source import Edit
from twin.validation.explain.rebuilt_functions import Matrix
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge

SEARCHES = int(os.environ.get("TWIN_SEARCHES", "4"))
"""Searches whose cures are checked; `TWIN_SEARCHES=2000` takes an hour, `TWIN_SEARCHES_SEED` splits it."""


@pytest.fixture(scope="module")
def sils(sils_model):
    from twin.robots import load_formula
    from twin.validation.explain.judged_states import sampled_values

    formula = load_formula("sils")
    return formula, sampled_values(formula, sils_model)


def edit(search, row, old, new, nth=0, kind="name"):
    """An edit of the statement that assigns a symbol of eq. (2)."""
    place = next(p for p in search.judge.residuals if p.equation == "eq2" and p.symbol == row)
    source = search.judge.step("eq2").source
    s = source.statements[place.statement]
    text = source.text(s.start, s.end)
    at = -1
    for _ in range(nth + 1):
        at = text.index(old, at + 1)
    return Edit(source.path, s.line, s.start + at, s.start + at + len(old), old, new, kind, s.index, source.name)


TAUTOLOGIES = (
    ("q1", [("Z_S1", "q1"), ("q2", "q1")]),  # a difference taken from itself
    ("q1", [("Z_S1", "q1"), ("(l_2 - l_1)", "(l_2 - l_2)")]),  # the same, by a factor of zero
    ("q2", [("* q1", "* q2"), ("2 * l_1 * sqrt", "0 * l_1 * sqrt")]),  # content times zero, then itself
    ("q4", [("(l_1 + l_2) * q3 - 2 *", "(l_1 + l_2) * q4 - 0 *")]),  # one edit that does both
    ("q2", [("2 * l_1 * sqrt", "0 * l_1 * sqrt"), ("q2", "q1", "left side")]),  # by way of the left side
    ("q4", [("1 / (l_1 + l_2)", "q3 + 2 * l_1 / (l_2 - l_1) * (q3 - Y_S2) + 0 / (l_1 + l_2)")]),  # the row of q3 again
)


@pytest.mark.slow
@pytest.mark.parametrize(("row", "changes"), nightly(TAUTOLOGIES, every=3))
def test_a_row_that_says_nothing_is_no_cure(row, changes, sils):
    """It agrees at every pose, whatever the dimensions are, and is refused all the same."""
    formula, reference = sils
    search = RepairSearch(Judge(formula, None, reference.with_values({"l_0": reference.symbols["l_0"] + 1e-4})))
    k = next(
        (p.equation, p.statement, p.position) for p in search.judge.residuals if (p.equation, p.symbol) == ("eq2", row)
    )
    search.failing = [k]
    made = [edit(search, row, old, new, kind=kind[0] if kind else "name") for old, new, *kind in changes]
    with np.errstate(all="ignore"):
        c = search.attempt(search.judge.step("eq2"), made)
    assert c is not None
    assert c.worst_residuals[k] <= 1
    assert c.is_trivial
    assert not c.may_be_proposed


@pytest.mark.parametrize("lost", ["q1", "q2"])
def test_a_row_without_residual_beside_the_poses_has_no_gradient(lost, sils, monkeypatch):
    """An equation may be evaluated at the poses and fail beside them: only the row itself must have a gradient."""
    formula, reference = sils
    search = RepairSearch(Judge(formula, None, reference))
    keys = {}
    for place in search.judge.residuals:
        if place.equation == "eq2":
            keys.setdefault(place.symbol, place.key)
    change = [edit(search, "q1", "q2", "q1")]
    candidate = Candidate(search.judge.step("eq2"), change, {}, {}, False)

    def residuals(judge, equation, edits):
        rows = edited_residuals(judge, equation, edits)
        rows.pop(keys[lost], None)
        return rows

    monkeypatch.setattr(determined_unknowns, "edited_residuals", residuals)
    unknowns = determined_unknowns.DeterminedUnknowns(search.judge)
    assert unknowns.determines(candidate, keys["q1"]) is (lost != "q1")


@pytest.mark.nightly
def test_a_changed_dimension_is_not_explained_by_edits(sils):
    formula, reference = sils
    for name, d in (("L_V", 2e-4), ("l_2", 3e-4)):
        search = RepairSearch(Judge(formula, None, reference.with_values({name: reference.symbols[name] + d})))
        search.targets, search.failing = search.targets[-1:], search.failing[-1:]
        found, lost = search.run(budget=0.3)
        assert lost == search.failing
        best = [f.cures[0][0] for f in found if f.cures]
        assert not any(len(c.edits) == 1 and not c.dropped for c in best)


@pytest.mark.slow
def test_what_a_repair_drops_is_said(sils, tmp_path):
    """A row with a name too many: the cure names the symbol that it takes out."""
    import inspect

    from twin.robots import load_formula

    formula, reference = sils
    text = inspect.getsource(inspect.getmodule(formula.equations[0].variants["corrected"]))
    head, rest = text.split("def eq2_corrected", 1)
    right = "(l_2 - l_1) * (q2 - q1) + Z_S1"
    (tmp_path / "formula.py").write_text(head + "def eq2_corrected" + rest.replace(right, right.replace("q1", "X_S2")))
    (found,), lost = RepairSearch(Judge(load_formula(tmp_path / "formula.py", trial=True), None, reference)).run()
    assert not lost
    assert found.cures[0][0].edits[0].text == "X_S2 -> q1"
    assert found.cures[0][0].dropped == ("X_S2",)


@pytest.mark.slow
def test_an_index_of_a_scalar_is_no_cure(tmp_path):
    """w[1] is zero at these poses, so any positive number would do beside it: q1[1] is the second pose's q1."""
    case = seeds.built_in("pa10")
    text, right = case.path.read_text(encoding="utf-8"), "atan2(w[1], w[0])"
    assert text.count(right) == 1
    (tmp_path / "formula.py").write_text(text.replace(right, "atan2(w[1], w[1])"), encoding="utf-8")
    search = RepairSearch(Judge(case.load(tmp_path / "formula.py"), None, case.reference))
    found, lost = search.run(budget=2.0)
    assert not lost
    texts = [e.text for f in found for cure in f.cures for c in cure for e in c.edits]
    assert "1 -> 0" in texts
    assert not [t for t in texts if t.startswith("w -> ")]


@pytest.mark.parametrize("name", ["dot", "cross"])
def test_products_of_a_scalar_and_a_vector_are_refused_as_by_casadi(name):
    vector = Matrix(np.ones((4, 3, 1)))
    with pytest.raises(ValueError, match="vectors have 1 and 3 entries"):
        rebuilt_functions._FUNCTIONS[name](np.ones(4), vector)
    with pytest.raises(RuntimeError):
        getattr(ca, name)(ca.SX.sym("s"), ca.SX.sym("v", 3))
    rebuilt_functions._FUNCTIONS[name](vector, vector)


@pytest.mark.nightly
def test_no_search_offers_a_tautology(tmp_path, capsys, monkeypatch):
    """Slips of one and of two tokens, and changed dimensions, over all robots; derivatives are CasADi's own."""

    monkeypatch.setattr(time, "monotonic", time.process_time)  # the budget does not depend on what else runs
    cases = [*seeds.built_ins(), *map(seeds.stranger, sorted(seeds.STRANGERS.glob("*.py")))]
    rng, done, checked = np.random.default_rng(int(os.environ.get("TWIN_SEARCHES_SEED", "1"))), 0, 0
    while done < SEARCHES:
        case, kind = cases[done % len(cases)], int(rng.integers(4))
        folder = tmp_path / "one"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        faulty, reference, what = case.formula, case.reference, ""
        if kind == 0:
            p = case.formula.parameters[rng.integers(len(case.formula.parameters))].name
            reference = case.changed_residuals(**{p: float(rng.uniform(5e-5, 5e-4))})
        else:
            path = tmp_path / f"formula{rng.integers(10**9)}.py"
            what = seeds.seeded(case, path, rng, 2 if kind == 3 else 1)
            try:
                faulty = case.load(path) if what else None
            except TwinError:
                continue
        judge = Judge(faulty, None, reference) if faulty is not None else None
        if judge is None or not judge.failing():
            continue
        search = RepairSearch(judge)
        i = int(rng.integers(len(search.failing)))
        search.targets, search.failing = [search.targets[i]], [search.failing[i]]
        done += 1
        if done % 100 == 0:
            with capsys.disabled():
                print(f"{done} searches begun, {checked} cures checked", flush=True)
        found, _ = search.run(budget=0.7)
        for f in found:
            for c in (c for way in f.cures for c in way):
                checked += 1
                assert not seeds.empty(case, judge, faulty, c, f.rows, folder), f"{case.name}: {what}"
    with capsys.disabled():
        print(f"\n{done} searches, {checked} cures, none of them empty")
    assert checked
