"""A row without a value counts as wrong, and the others are still judged."""

from __future__ import annotations

import numpy as np
import pytest

from made import explain_seeds as seeds
from made.explain_seeds import ELEMENTS, misprinted
from twin.validation.explain.row_deviations import Judge


def test_each_element_of_a_return_is_judged_although_another_has_no_value(tmp_path):
    """Python reports the wrong index of the third element; the first one is wrong as well, the second one is right."""
    first, second = ELEMENTS
    _, formula = misprinted("lapbot", *first, tmp_path, second)
    case = seeds.built_in("lapbot")
    judge = Judge(formula, None, case.reference)
    assert [(place.symbol, np.isnan(judge.residuals[place]).all()) for place in judge.failing()] == [
        ("q7", False),
        ("q9", True),
    ]
    assert any("fails in line" in note for note in judge.notes)


@pytest.mark.slow
def test_a_row_is_repaired_although_a_later_statement_has_no_value(tmp_path):
    right = "sqrt(R[0, 2] ** 2 + R[1, 2] ** 2), R[2, 2])"
    second = ("atan2(R_yaw[1, 0], R_yaw[0, 0])", "atan2(R_yaw[1, 0], q6[0, 0])")
    case, formula = misprinted("pa10", right, right.replace("R[2, 2]", "R[2, 1]"), tmp_path, second)
    assert seeds.outcome(case, formula, tmp_path, 4.0) == "rank 1"


def test_rows_after_one_without_a_value_are_judged(tmp_path):
    """X_S2 uses a name that is assigned later; a wrong name in the return statement is a fault of its own."""
    right = "X_S2 = X_E - sqrt(3) / 3 * l_p"
    second = ("return X_S1, Y_S1, Z_S1, X_S2,", "return X_S1, Y_S1, Z_S3, X_S2,")
    case, formula = misprinted("sils", right, right.replace("l_p", "Z_S3"), tmp_path, second)
    assert [place.symbol for place in Judge(formula, None, case.reference).failing()] == ["X_S2", "Z_S1"]
