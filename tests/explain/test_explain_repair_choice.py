"""Repairs that make rows agree only by chance: they are not proposed, found only once, and told for each row."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from twin.validation.explain import repair_choice, trials
from twin.validation.explain.candidate import Candidate, GroupResult
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.edited_functions import EditedFunctions
from twin.validation.explain.equation_steps import RowPlace
from twin.validation.explain.formula_state import FormulaState
from twin.validation.explain.function_source import Edit
from twin.validation.explain.repair_search import RepairSearch

A = ("e", 0, 0)
B = ("e", 1, 0)

STEP = SimpleNamespace(source=SimpleNamespace(name="f", path=Path("x")), equation=SimpleNamespace(name="e"))

BY_CHANCE = FormulaState(0, "because a = b")


def edit(start):
    return Edit(Path("x"), 1, start, start + 1, "a", "b", "name", 0, "f")


def candidate(*starts, scores):
    return Candidate(STEP, [edit(start) for start in starts], {}, scores, False)


def starts(c):
    return [e.start for e in c.edits]


@pytest.fixture
def search():
    """A search that evaluates nothing: `states` has the state after edits at some places."""
    judge = SimpleNamespace(residuals={}, failing=list, formula=SimpleNamespace(parameters=()))
    out = RepairSearch(judge)
    out.states = {}
    out.failing = [A, B]
    out.worst_before = {A: 9.0, B: 9.0}
    out._runs_at_one_sample = lambda c: True
    out.functions = EditedFunctions(judge, judge)
    out.functions.perturbed_residuals = lambda c, rows: None
    out.functions.text = lambda c: str(starts(c))
    out.choice.states._evaluated = lambda change: out.states[tuple(e.start for e in change)]
    return out


def pairs_found(search, *found):
    """Let the search find these pairs for row B each time, as new candidates; return the list of its searches."""
    searches = []

    def double(k, singles, shared, deadline):
        searches.append(deadline)
        return [candidate(*places, scores={B: 0.0}) for places in found], True

    search.pair_search.pairs_for = double
    search.position_pairs.pairs_for = lambda k, singles, shared, deadline: ([], True)
    return searches


def single(search):
    c = candidate(0, scores={A: 0.0})
    search.single_search.candidates = [c]
    return GroupResult([A], [[c]], None, 0.0, 9.0, 1)


def test_a_pair_that_is_refused_is_not_found_again(search):
    """The pair repairs row B, and holds by chance together with the only repair of row A."""
    search.states = {(10, 20): FormulaState(0, ""), (0, 10, 20): BY_CHANCE}
    searches = pairs_found(search, (10, 20))
    found, left = search._pairs_of([single(search)], [B], 8.0)
    assert left == [B]
    assert [f.rows for f in found if f.cures] == [[A]]
    assert len(searches) == 2
    assert [(starts(c), chance) for c, chance in search.by_chance] == [([10, 20], "because a = b")]


def test_a_pair_that_holds_together_with_other_repairs_comes_first(search):
    general = FormulaState(0, "")
    search.states = {(10, 20): general, (30, 40): general, (0, 10, 20): BY_CHANCE, (0, 30, 40): general}
    searches = pairs_found(search, (10, 20), (30, 40))
    found, left = search._pairs_of([single(search)], [B], 8.0)
    assert left == []
    assert [starts(f.cures[0][0]) for f in found] == [[0], [30, 40]]
    assert len(searches) == 1


def test_all_searches_for_pairs_have_one_deadline(search):
    search.states = {(10, 20): FormulaState(0, ""), (0, 10, 20): BY_CHANCE}
    searches = pairs_found(search, (10, 20))
    search._pairs_of([single(search)], [B], 8.0)
    first, second = searches
    assert second is first


def test_a_refused_pair_is_refused_when_it_is_tried_again(search, monkeypatch):
    monkeypatch.setattr(trials, "alias_values", lambda judge, step, change: {})
    monkeypatch.setattr(
        trials, "trial_residuals", lambda judge, step, change, extra: {RowPlace("e", "printed", 0, 0, "x", 1): 0.0}
    )
    monkeypatch.setattr(trials, "worst", lambda r: r)
    monkeypatch.setattr(RepairSearch, "dependence", SimpleNamespace(judge_dependence=lambda c, rows: None))
    search.residuals_before = {}
    assert search.attempt(STEP, [edit(10), edit(20)]).may_be_proposed
    search.rejected.add(frozenset([edit(10), edit(20)]))
    assert not search.attempt(STEP, [edit(20), edit(10)]).may_be_proposed
    assert search.attempt(STEP, [edit(10)]).may_be_proposed


def chosen(search, *ways):
    cures = []
    for way in ways:
        cures.append([candidate(start, scores={A: 0.0}) for start in way])
    return [[c.edits[0].start for c in way] for way in search.choice.best(cures)]


def test_no_reading_that_holds_by_chance_is_chosen(search):
    """The first readings are left out because more rows are wrong; the others hold only by chance."""
    general = FormulaState(0, "")
    search.states = {(0,): FormulaState(1, ""), (10,): BY_CHANCE, (20,): general, (30,): BY_CHANCE}
    assert chosen(search, [0, 10], [20, 30]) == [[20]]
    assert chosen(search, [10, 0]) == [[0]]
    assert chosen(search, [10], [30]) == []


def test_what_is_chosen_agrees_with_whether_there_is_a_repair(search):
    """The only general reading is the last of many."""
    many = range(repair_choice._MOST_CHECKED_READINGS + 2)
    for start in many:
        search.states[start,] = BY_CHANCE
    search.states[many[-1],] = FormulaState(0, "")
    candidates = [candidate(start, scores={A: 0.0}) for start in many]
    assert search.choice.has_repair(A, candidates)
    assert search.choice.best([candidates]) == [[candidates[-1]]]


def test_a_repair_confirmed_before_the_time_was_over_is_chosen(search):
    search.states = {(0,): BY_CHANCE, (10,): FormulaState(0, "")}
    candidates = [candidate(start, scores={A: 0.0}) for start in (0, 10)]
    assert search.choice.has_repair(A, candidates)
    search.choice.deadline = Deadline(-1.0)
    assert search.choice.best([candidates]) == [[candidates[1]]]


def test_a_remark_is_told_for_each_row_that_agrees_by_chance(search):
    """The second candidate also changes row A, which stays wrong after it."""
    search.states = {(0,): BY_CHANCE, (10,): BY_CHANCE, (20,): BY_CHANCE}
    search.choice.exclude(candidate(0, scores={A: 0.0}))
    search.choice.exclude(candidate(10, scores={A: 5.0, B: 0.0}))
    search.choice.exclude(candidate(20, scores={B: 0.0}))
    assert [starts(c) for c, _ in search.by_chance] == [[0], [10]]
