"""Equations that hold only for the present values of equal or assumed parameters are told from right ones."""

from __future__ import annotations

from dataclasses import replace

import pytest

from made import explain_seeds as seeds
from made.explain_seeds import misprinted
from twin import api
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.explain import explain
from twin.validation.explain.parameter_coincidences import coincidences
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge


@pytest.mark.parametrize("name", ["pa10", "sher", "hibou", "davinci_psm"])
def test_right_equations_hold_for_other_values_of_equal_and_assumed_parameters(name):
    case = seeds.built_in(name)
    assert coincidences(Judge(case.formula, None, case.reference)) == []


def test_a_term_that_is_zero_for_the_assumed_value_is_found_out(tmp_path):
    """The trocar's y is zero: this term shows only if a length of zero is varied as well."""
    case, formula = misprinted("hibou", "P_7 + r6 * u", "P_7 + r6 * u + trocar_y", tmp_path)
    judge = Judge(formula, None, case.reference)
    assert not judge.failing()
    assert [p.name for group in coincidences(judge) for p in group] == ["trocar_y"]


def test_a_length_of_the_trocar_for_one_of_the_arm_is_found_out(tmp_path):
    """The trocar's z is equal to a. With other values, no pose has its shaft through the trocar: no value is left."""
    right = "(_to_elbow(q1, q2, q3, a, h) @ vertcat(b"
    case, formula = misprinted("hibou", right, right.replace("a, h", "trocar_z, h"), tmp_path)
    judge = Judge(formula, None, case.reference)
    assert not judge.failing()
    assert ("a",) in [tuple(p.name for p in group) for group in coincidences(judge)]


def test_a_cure_that_holds_only_for_equal_parameters_is_counted(tmp_path, monkeypatch):
    """Lapbot's a and b are equal: without the check of other values, b for a, given as a cure, would be a tie."""
    right = "acos((W[0] ** 2 + W[1] ** 2 - a**2 - b**2) / (2 * a * b))"
    case, formula = misprinted("lapbot", right, right.replace("b**2", "a"), tmp_path)
    monkeypatch.setattr("twin.validation.explain.formula_state.coincidences", lambda judge: [])
    assert seeds.outcome(case, formula, tmp_path, 4.0) == seeds.BY_CHANCE


def test_a_cure_holds_for_other_values_if_a_derived_parameter_follows(tmp_path):
    """`square` is a**2 + b**2. If a or b is varied alone, right equations do not close; they do with another square."""
    right = ("W[1] ** 2 - a**2 - b**2)", "W[1] ** 2 - square)")
    arguments = ("def arm(W, a, b):", "def arm(W, a, b, square):")
    parameter = (
        "        *trocar(400, 0, 300),",
        '        mm("square", 180, "DERIVED", "squares"),\n        *trocar(400, 0, 300),',
    )
    case, formula = misprinted("lapbot", *right, tmp_path, arguments, parameter)
    reference = replace(case.reference, symbols={**case.reference.symbols, "square": 0.18})
    assert coincidences(Judge(formula, None, reference)) == []
    wrong = ("W[1] ** 2 - a**2 - b**2) / (2 * a * b)", "W[1] ** 2 - square) / (2 * a * a)")
    case, formula = misprinted("lapbot", *wrong, tmp_path, arguments, parameter)
    assert not Judge(formula, None, reference).failing()
    assert coincidences(Judge(formula, None, reference)) != []


@pytest.mark.parametrize("part", [0.2, 0.0], ids=["at once", "late"])
def test_the_search_goes_on_after_a_cure_that_holds_by_chance(part, tmp_path, monkeypatch):
    """`a**2` for `a` agrees because a = b: no stage of the search is left out because of it, also if found out late."""
    right = "acos((W[0] ** 2 + W[1] ** 2 - a**2 - b**2) / (2 * a * b))"
    case, formula = misprinted("lapbot", right, right.replace("b**2", "a"), tmp_path)
    monkeypatch.setattr("twin.validation.explain.single_search._CHANCE_PART", part)
    search = RepairSearch(Judge(formula, None, case.reference), deadline=Deadline(30.0))
    run = search.single_search._try_stage
    stages = []

    def try_stage(stage, *rest):
        stages.append(stage)
        return run(stage, *rest)

    search.single_search._try_stage = try_stage
    search.run(0.0)
    assert any("a = b" in condition for _, condition in search.by_chance)
    assert len(stages) == len(set(stages)) == 7


@pytest.mark.slow
def test_an_error_that_a_swivel_of_zero_hides_is_found(tmp_path):
    """At swivel 0, w[1] is zero at every pose: an elbow row without its square agrees there, and only there."""
    right = "atan2(sqrt(w[0] ** 2 + w[1] ** 2), w[2])"
    _, formula = misprinted("pa10", right, "atan2(sqrt(w[0] ** 2), w[2])", tmp_path)
    x = explain("pa10", formula, api.load("pa10").reference())
    assert (x.verdict, x.explained) == ("disagree", True)
    assert [r.symbol for r in x.rows] == ["q4"]
    assert x.repairs[0].cures[0][0].changes[0].edit == "w[0] ** 2 -> w[0] ** 2 + w[1]**2"
    assert any("only for swivel = 0 deg" in n for n in x.notes)
