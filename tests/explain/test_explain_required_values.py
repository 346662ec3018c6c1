"""A missing term, factor, square or root follows from the value that an expression must have."""

from __future__ import annotations

import time

import pytest

from made import explain_campaign as campaign
from made import explain_seeds as seeds
from made.explain_seeds import misprinted, require_repair

SECONDS = campaign.SEARCH


MISSING = (
    ("pa10", "sqrt(P_c[0] ** 2 + P_c[1] ** 2), P_c[2])", "sqrt(P_c[0] ** 2 + P_c[1]), P_c[2])"),
    ("pa10", "(RL7 + RL8) * T_base_tool", "RL7 * T_base_tool"),
    ("pa10", "(RL7 + RL8) * T_base_tool[0:3, 2]", "(RL7 + RL8)"),
    ("lapbot", "return P_in, u, P_in + r7 * u", "return P_in, u, P_in"),
    (
        "sils",
        "X_E + sqrt(3) / 6 * l_p * c_psi * c_theta - l_p / 2 * c_psi * s_theta * s_phi + l_p / 2 * s_psi * c_phi  #",
        "l_p / 2 * s_psi * c_phi  #",
    ),
)


@pytest.mark.parametrize(
    ("name", "right", "wrong"), MISSING, ids=["square", "term", "vector", "sum of vectors", "several terms"]
)
def test_a_missing_square_term_or_vector_is_found(name, right, wrong, tmp_path):
    case, formula = misprinted(name, right, wrong, tmp_path)
    assert seeds.outcome(case, formula, tmp_path, 4.0) in ("rank 1", "tie")


LEFT_OVER = (
    (
        "sils",
        " * sqrt(-X_S3**2 - l_0**2 + (l_1 + l_2)**2 - (L_H - Y_S3)**2 + 2 * l_0 * sqrt((L_H - Y_S3)**2 + X_S3**2))",
        "",
    ),
    ("sher", "acos((L_AR**2 + AQ**2 - QR**2) / (2 * L_AR * AQ)) + atan2(y_AR, x_AR)", "atan2(y_AR, x_AR)"),
    ("sher", "AQ * cos(al) + sqrt(QR**2 - (AQ * sin(al) - y_AR) ** 2)", "AQ * cos(al)"),
    ("sher", " - (r_x - rho * cos(a)) ** 2 - (r_y - rho * sin(a)) ** 2)", " - (r_y - rho * sin(a)) ** 2)"),
)


@pytest.mark.parametrize(("name", "right", "wrong"), LEFT_OVER, ids=["row", "function", "name of a term", "loop"])
@pytest.mark.slow
def test_a_missing_term_is_found_by_the_names_that_nobody_reads(name, right, wrong, tmp_path):
    """A similar expression stands elsewhere in the file, with other names."""
    case, formula = misprinted(name, right, wrong, tmp_path)
    assert seeds.outcome(case, formula, tmp_path, SECONDS) in ("rank 1", "tie")


_AZIMUTHS = "for a, q in zip(_AZIMUTHS, (q1, q2, q3), strict=True))\n    d = "


LOOP = (f"(vertcat(rho * cos(a), rho * sin(a), q) {_AZIMUTHS}", f"(vertcat(rho * cos(a), rho / sin(a), q) {_AZIMUTHS}")
"""The slip makes a length of 1e15 m, so that nothing is found without its repair."""


IN_PARTS = (
    ("sher", (" - (r_y - rho * sin(a)) ** 2)", " - (r_y - rho) ** 2)")),
    ("pa10", ("atan2(sqrt(w[0] ** 2 + w[1] ** 2), w[2])", "atan2(sqrt(w[1] ** 2), w[2])")),
    ("sher", ("(r_x - rho * cos(a)) ** 2 - (r_y - rho * sin(a)) ** 2)", "(r_x - cos(a)) ** 2 - (r_y - rho) ** 2)")),
    ("sher", ("H = sqrt(l**2 - X**2 - Y**2)\n    r = c1", "H = sqrt(l**2 - X**2 - Y)\n    r = c1"), LOOP),
    (
        "sils",
        (
            "Y_E + sqrt(3) / 6 * l_p * s_psi * c_theta + l_p / 2 * s_psi * s_theta * s_phi + l_p / 2 * c_psi * c_phi",
            "Y_E + sqrt(3) / 6 * Z_S1 * s_psi * c_theta + l_p / 2 * c_psi * c_phi",
        ),
    ),
    (
        "davinci_psm",
        ("q1, q2, q3, origin)\n    T_36", "q1, q2, q3, q1)\n    T_36"),
        ("T_03 @ T_36 @ row(-", "T_36 @ T_36 @ row(-"),
    ),
)


@pytest.mark.parametrize(
    "change",
    IN_PARTS,
    ids=[
        "either root of a square",
        "root of zero",
        "two factors in a loop",
        "edit in a loop",
        "name and term",
        "result that nobody reads",
    ],
)
@pytest.mark.slow
def test_what_a_part_of_an_expression_must_be_is_found(change, tmp_path, monkeypatch):
    require_repair(change, tmp_path, monkeypatch, 2 * SECONDS)


@pytest.mark.slow
def test_a_missing_term_in_a_function_that_rows_call_is_found(tmp_path, monkeypatch):
    """There are many edits of these rows, so that the values required of expressions come first."""
    monkeypatch.setattr(time, "monotonic", time.process_time)
    right = "row(pi / 2, 0, pi / 2 + q5, 0)"
    case, formula = misprinted("lapbot", right, "row(pi / 2, 0, pi / 2, 0)", tmp_path)
    assert seeds.outcome(case, formula, tmp_path, SECONDS) == "rank 1"


@pytest.mark.slow
def test_a_missing_root_in_a_function_of_many_rows_is_found(tmp_path, monkeypatch):
    """Each call of the function has other arguments, so that no single value is required of its result."""
    monkeypatch.setattr(time, "monotonic", time.process_time)
    case, formula = misprinted("sher", "return sqrt(a**2 + b**2)", "return a**2 + b**2", tmp_path)
    assert seeds.outcome(case, formula, tmp_path, SECONDS) == "rank 1"
