"""The edits of a statement that its text suggests."""

from __future__ import annotations

import pytest

from made.explain_seeds import misprinted
from twin.validation.explain.name_pool import NamePool
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.statement_edits import statement_edits

_ROW = "(l_1 + l_2) * q5 + 2 * l_1 * sqrt(-X_S3**2 - l_0**2 + (l_1 + l_2)**2 - (L_H - Y_S3)**2"


@pytest.mark.parametrize("parenthesis", ["(l_1 + l_2)", "(L_H - Y_S3)"])
def test_a_missing_square_of_a_parenthesis_is_one_edit(parenthesis, tmp_path):
    wrong = _ROW.replace(f"{parenthesis}**2", parenthesis)
    case, formula = misprinted("sils", _ROW, wrong, tmp_path)
    source = Judge(formula, None, case.reference).step("eq2").source
    statement = source.statements[5]
    found = statement_edits(
        source, statement, NamePool(frozenset(), {}, frozenset(), frozenset(), frozenset()), ("exponent",)
    )
    right = source.data.decode()
    assert case.path.read_text(encoding="utf-8") in [right[: e.start] + e.new + right[e.end :] for e in found]
