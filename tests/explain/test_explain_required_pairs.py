"""Two edits follow from the values that scalar expressions must have, within the time that is given."""

from __future__ import annotations

import ast
from types import SimpleNamespace

import pytest

from made import explain_campaign as campaign
from made.explain_seeds import ELEMENTS, WHOLE_ELSEWHERE, misprinted, require_repair
from twin.validation.explain import required_pairs
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge

SECONDS = campaign.SEARCH


TWO = (
    ("davinci_psm_si", ("row(-pi / 2, 0, q5", "row(pi / 2, 0, q5"), ("q6 - pi / 2", "q6")),
    ("davinci_psm", ("q6 - pi / 2, 0)", "q6, 0)"), ("row(0, 0, q4, shaft_long)", "row(0, 0, q4, q1)")),
    (
        "sils",
        (
            "sqrt(-X_S1**2 - Y_S1**2 - l_0**2 + (l_1 + l_2)**2 + 2",
            "sqrt(-X_S1**2 + Y_S1**2 - l_0 + (l_1 + l_2)**2 + 2",
        ),
    ),
    (
        "lapbot",
        ("a * cos(q2) + b", "a * cos(q3) + b"),
        ("a * sin(q2) + b * sin(q2 + q3)", "a * sin(q2) + b * sin(q2 + q2)"),
    ),
    ("lapbot", ("trocar_z) - P_in\n    length", "trocar_z) + P_in\n    length"), ("P_in + r7 * u", "P_in")),
    ("sher", ("rotation_x(0), vertcat(r_x, r_y, r_z)", "rotation_x(1), vertcat(r_y, r_y, r_z)")),
    ("pa10", ("(RL3**2 - RL5**2 + D", "(RL3**2 - RL3**2 + D"), ("sqrt(RL3**2 - a**2)", "(RL3**2 - a**2)")),
    (
        "sils",
        (
            "l_p * s_psi * c_theta - l_p / 2 * s_psi * s_theta * s_phi - l_p / 2 * c_psi * c_phi",
            "Y_S1 * s_psi * c_theta - l_p / 2 * s_psi * s_theta * s_phi - l_p / 2 * c_psi * c_phi",
        ),
        ("l_p / 2 * s_phi * c_theta  # (1)\n    X_S2", "l_p / 2 * s_phi * Z_S2  # (1)\n    X_S2"),
    ),
    (
        "hibou",
        ("row(0, 0, q1, h) @ row(-pi / 2, 0, q2, 0)", "row(0, 0, q1, h) @ row(-pi / 2, 0, q1, 0)"),
        ("row(0, a, q3, 0)\n\n\n@", "row(0, a, q2, 0)\n\n\n@"),
    ),
    (
        "sils",
        (" + 2 * l_0 * sqrt((L_V - Z_S2)**2 + X_S2**2)))", "))"),
        (
            "((l_1 + l_2) * q5 + 2 * l_1 * sqrt(-X_S3**2 - l_0**2 + (l_1 + l_2)**2 - (",
            "((l_1 + l_2) * q2 + 2 * l_1 * sqrt(-X_S3**2 - l_0**2 + (l_1 + l_2)**2 - (",
        ),
    ),
    ("lapbot", *ELEMENTS),
    (
        "pa10",
        ("(RL3**2 - RL5**2 + D", "(RL5**2 - RL5**2 + D"),
        ("return a * n + sqrt(RL3**2 - a**2) * (", "return sqrt(RL3**2 - a**2) * ("),
    ),
    (
        "lapbot",
        ("vertcat(a * cos(q2) + b * cos(q2 + q3), a * sin(q2)", "vertcat(a + b * cos(q2 + q3), a * sin(q3)"),
    ),
    ("pa10", ("return a * n + sqrt(RL3**2 - a**2)", "return a + sqrt(RL3**2 - up**2)")),
    ("sher", WHOLE_ELSEWHERE),
    (
        "sher",
        (
            "acos((L_AR**2 + AQ**2 - QR**2) / (2 * L_AR * AQ)) + atan2(y_AR",
            "acos((AQ**2 - QR**2) / (2 * L_AR * AQ)) + atan2(x_AR",
        ),
    ),
)


@pytest.mark.parametrize(
    "change",
    TWO,
    ids=[
        "angles",
        "angle and length",
        "one expression",
        "without a value",
        "vector beside a sign",
        "must be zero",
        "radius of either sign",
        "names without a value",
        "function called twice",
        "term of another row",
        "elements of a return",
        "product with a vector",
        "cosine that stands nowhere else",
        "operands of a sum",
        "whole elsewhere",
        "function without a value",
    ],
)
@pytest.mark.slow
def test_two_faults_in_scalar_expressions_are_found(change, tmp_path, monkeypatch):
    """Each takes 3 s. What is found is judged here, not when: a busy computer may need three times as long."""
    require_repair(change, tmp_path, monkeypatch, 4 * SECONDS)


@pytest.mark.slow
def test_an_error_that_the_swivel_hides_is_found_beside_one_that_shows(tmp_path, monkeypatch):
    """At swivel 0, w[1] is zero: without its square, only the index is seen, whose repair holds for swivel 0 only."""
    first = ("side * sqrt(P_c[0] ** 2 + P_c[1] ** 2), P_c[2])", "side * sqrt(P_c[2] ** 2 + P_c[1] ** 2), P_c[2])")
    second = ("sqrt(w[0] ** 2 + w[1] ** 2), w[2])", "sqrt(w[0] ** 2 + w[1]), w[2])")
    require_repair(("pa10", first, second), tmp_path, monkeypatch, SECONDS)


def test_an_expression_in_a_function_with_several_calls_is_not_refuted(tmp_path):
    """All calls of row() have a matrix of the same form, but an edit may change an entry by other amounts in each."""
    case, formula = misprinted("lapbot", "-pi / 2 + q6", "pi / 2 + q6", tmp_path)
    search = RepairSearch(Judge(formula, None, case.reference), deadline=Deadline(30.0))
    search.singles.find_refuted()
    (row,) = {h.source.path for s in search.judge.steps for h in search.judge.helpers(s) if h.source.name == "row"}
    assert search.singles.refuted
    assert row not in {path for path, _, _ in search.singles.refuted}


def test_expressions_with_a_swivel_are_unknowns(tmp_path):
    case, formula = misprinted("pa10", "sqrt(RL3**2 - a**2)", "sqrt(RL3**2 - a**3)", tmp_path)
    judge = Judge(formula, None, case.reference)
    assert judge.step("elbow").swivel
    search = RepairSearch(judge, deadline=Deadline(30.0))
    (double,) = (d for d in search.pair_search.required_pairs if d.step.equation.name == "elbow")
    scalars = double.scalars(search.failing, Deadline(30.0))
    assert "sqrt(RL3**2 - a**3)" in {ast.unparse(scalar.node).replace(" ** ", "**") for scalar in scalars}


class Late:
    """A deadline that passes when it has been asked `times` times."""

    def __init__(self, times):
        self.times = times

    @property
    def passed(self):
        self.times -= 1
        return self.times < 0


@pytest.fixture
def search():
    return required_pairs.RequiredPairs.__new__(required_pairs.RequiredPairs)


def test_no_first_edit_is_tried_after_the_time(search, monkeypatch):
    tried = []

    def required(judge, step, rows, deadline, fixed):
        tried.append(fixed)

    monkeypatch.setattr(required_pairs, "RequiredValues", required)
    monkeypatch.setattr(required_pairs.RequiredPairs, "judge", None)
    search.step = None
    search.sites = []
    assert list(search.with_required_value(["a", "b", "c"], [], Late(2))) == []
    assert tried == [["a"], ["b"]]


def test_no_pair_of_expressions_is_compared_after_the_time(search):
    compared = []
    search.scalars = lambda rows, deadline: [SimpleNamespace(function="f") for _ in range(5)]
    search._unexplained = lambda a, b, rows: compared.append((a, b)) or 1.0
    assert list(search.in_two_expressions([], Late(3))) == []
    assert len(compared) == 3


def test_no_part_of_the_choices_is_solved_after_the_time(search):
    solved = []

    def solve(equation, fixed, choices, deadline):
        solved.append(len(choices))
        return []

    search.step = SimpleNamespace(equation=SimpleNamespace(name="e"))
    search.coarse = SimpleNamespace(solved=solve)
    search.full = SimpleNamespace(solved=lambda *_: [])
    search._binding = lambda scalars, rows: ()
    choices = [(n,) for n in range(3 * required_pairs._CHOICES_AT_ONCE)]
    assert list(search._solutions((), choices, [], Late(2))) == []
    assert solved == [required_pairs._CHOICES_AT_ONCE] * 2
