"""`twin explain` on SILS: the printed equations, their invariants, their repairs, their ties."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from twin.robots import load_formula
from twin.validation.explain.explain import ExplainOptions, explain
from twin.validation.explain.function_source import patched
from twin.validation.explain.judged_states import sampled_values
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge

pytestmark = pytest.mark.usefixtures("sampled_once")


@pytest.fixture(scope="module")
def sils():
    return load_formula("sils")


@pytest.fixture(scope="module")
def reference(sils, sils_model):
    return sampled_values(sils, sils_model)


@pytest.fixture(scope="module")
def printed1(sils, sils_model, reference):
    return explain("sils", sils, sils_model, {"eq1": "printed"}, reference=reference)


@pytest.fixture(scope="module")
def printed2(sils, sils_model, reference):
    return explain("sils", sils, sils_model, {"eq2": "printed"}, reference=reference)


@pytest.mark.nightly
def test_the_corrected_equations_need_no_explanation(sils, sils_model, reference):
    x = explain("sils", sils, sils_model, reference=reference)
    assert (x.verdict, x.exit_code, x.rows, x.invariants) == ("agree", 0, (), ())


@pytest.mark.slow
def test_eq1_printed_has_four_rows_off_and_one_repair_each(printed1):
    x = printed1
    assert (x.verdict, x.exit_code, x.explained) == ("disagree", 1, True)
    assert [r.symbol for r in x.rows] == ["X_S1", "Y_S1", "X_S3", "Y_S3"]
    assert [r.rows for r in x.repairs] == [("eq1.X_S1",), ("eq1.Y_S1",), ("eq1.X_S3",), ("eq1.Y_S3",)]
    for row, repair in zip(x.rows, x.repairs, strict=True):
        assert not repair.tie
        ((reading,),) = repair.cures
        (change,) = reading.changes
        assert change.edit == "c_theta -> c_phi"
        assert change.line == row.line
        assert repair.margin > 1e6
        assert f"+    {change.after}" in reading.diff
        assert row.term.endswith("c_theta")
        assert row.means.endswith(f"of point s{row.symbol[-1]}")


def test_eq1_printed_is_no_rigid_platform(printed1):
    codes = [f.code for f in printed1.invariants]
    assert codes.count("invariant.rigid") == 3
    assert all("a rigid body cannot" in f.message for f in printed1.invariants if f.code == "invariant.rigid")


@pytest.mark.slow
def test_the_repair_can_be_applied(sils, reference, tmp_path):
    search = RepairSearch(Judge(sils, {"eq1": "printed"}, reference))
    found, lost = search.run()
    assert not lost
    path = tmp_path / "formula.py"
    path.write_text(patched([e for f in found for e in f.cures[0][0].edits]), encoding="utf-8")
    assert "c_psi, c_theta, c_phi = cos(psi), cos(theta), cos(phi)" in path.read_text(encoding="utf-8")
    assert Judge(load_formula(path), {"eq1": "printed"}, reference).failing() == []


@pytest.mark.slow
def test_eq2_printed_has_no_rigid_crank(printed2):
    rods = [f.message for f in printed2.invariants if f.code == "invariant.rod"]
    assert len(rods) == 6
    assert any("'bar1' would be, from r12 to r13" in m and "182.000 mm" in m for m in rods)


@pytest.mark.slow
def test_eq2_printed_is_a_tie_that_the_paper_cannot_settle(printed2):
    assert [r.rows for r in printed2.repairs] == [("eq2.q1",), ("eq2.q3",), ("eq2.q5",)]
    for repair, odd, even in zip(printed2.repairs, "135", "246", strict=True):
        ((first, second),) = repair.cures  # one function, two readings
        assert first.changes[0].edit == "l_1 + l_2 -> l_2 - l_1"
        assert second.changes[0].edit == f"q{odd} -> q{even}"
        assert "paper does not show" in repair.tie
        assert repair.margin > 1e6


@pytest.mark.nightly
def test_a_root_that_closes_early_is_found(sils, reference):
    found, lost = RepairSearch(Judge(sils, {"eq2": "literal"}, reference)).run()
    assert not lost
    kinds = {f.rows[0][1]: f.cures[0][0].edits[0].kind for f in found}
    assert [kinds[i] for i in (1, 3, 5)] == ["parenthesis"] * 3


@pytest.fixture
def faulty(tmp_path):
    """A formula with some texts replaced in the corrected functions."""

    def make(*changes):
        import inspect

        module = inspect.getmodule(load_formula("sils").equations[0].variants["corrected"])
        text = inspect.getsource(module)
        head, rest = text.split("def eq1_corrected", 1)
        for old, new in changes:
            assert old in rest
            rest = rest.replace(old, new, 1)
        path = tmp_path / "formula.py"
        path.write_text(f"{head}def eq1_corrected{rest}", encoding="utf-8")
        return load_formula(path)

    return make


def test_two_edits_in_one_row(faulty, reference):
    right = "Z_S1 = Z_E - sqrt(3) / 6 * l_p * s_theta - l_p / 2"
    formula = faulty((right, "Z_S1 = Z_E - sqrt(3) / 3 * l_p * s_theta + l_p / 2"))
    (found,), lost = RepairSearch(Judge(formula, None, reference)).run()
    assert not lost
    assert sorted(e.text for e in found.cures[0][0].edits) == ["3 -> 6", "insert `-`"]


def test_a_row_of_mixed_dimensions_is_told(faulty, sils_model, reference):
    formula = faulty(("Z_S2 = Z_E + sqrt(3) / 3 * l_p", "Z_S2 = Z_E + sqrt(3) / 3 * l_p**2"))
    x = explain("sils", formula, sils_model, reference=reference)
    assert [f.where.split(",")[0] for f in x.invariants if f.code == "invariant.dimension"] == ["eq1.Z_S2"]
    assert x.repairs[0].cures[0][0].changes[0].edit == "2 -> 1"


@pytest.mark.slow
def test_one_edit_cures_several_rows(faulty, reference):
    formula = faulty(("c_psi, c_theta, c_phi = cos(psi)", "c_psi, c_theta, c_phi = sin(psi)"))
    (found,), lost = RepairSearch(Judge(formula, None, reference)).run()
    assert not lost
    assert [e.text for e in found.cures[0][0].edits] == ["sin -> cos"]
    assert len(found.rows) == 5


@pytest.mark.slow
def test_a_name_that_is_not_there_is_put_right(faulty, sils_model, reference):
    formula = faulty(("c_psi * s_theta * s_phi", "c_psi * s_theta * s_phy"))
    x = explain("sils", formula, sils_model, reference=reference)
    (repair,) = x.repairs
    assert repair.rows == ("eq1.X_S1",)  # the rows after it are judged with the mechanism's value
    assert (x.verdict, x.exit_code) == ("unchecked", 2)
    assert not repair.tie
    assert repair.cures[0][0].changes[0].edit == "s_phy -> s_phi"
    assert any("name 's_phy' is not defined" in n for n in x.notes)


@pytest.mark.slow
def test_what_no_edit_explains_is_said_to_be_unexplained(faulty, sils_model, reference):
    right = "Z_S2 = Z_E + sqrt(3) / 3 * l_p * s_theta"
    formula = faulty((right, "Z_S2 = Z_E * cos(phi * X_E * 7.3) + psi ** 3 * theta"))
    x = explain("sils", formula, sils_model, reference=reference, options=ExplainOptions(budget=0.5))
    assert (x.verdict, x.explained) == ("disagree", False)
    assert not x.repairs[0].cures
    assert "makes the rows agree" in x.repairs[0].note
    assert x.exit_code == 1


@pytest.mark.nightly
def test_the_search_leaves_the_reference_values_as_it_was(sils, reference):
    """A moved parenthesis makes sin(a, b), which in numpy would write into b."""
    before = {n: np.array(getattr(v, "a", v)) for n, v in reference.symbols.items()}
    RepairSearch(Judge(sils, {"eq2": "literal"}, reference)).run(budget=0.0)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(reference.symbols[name], "a", reference.symbols[name]), value)
    from twin.validation.explain.rebuilt_functions import _FUNCTIONS

    for name in ("sin", "sqrt", "acos"):
        with pytest.raises(TypeError):
            _FUNCTIONS[name](np.zeros(3), np.zeros(3))


def test_a_fault_is_not_seen_where_none_is(sils, reference):
    """The judge must not find fault with one robot's reference values in another sample of it."""
    shifted = reference.with_values({"l_p": 0.1351})
    assert {p.equation for p in Judge(sils, None, shifted).failing()} == {"eq1"}
    assert Judge(sils, None, reference).failing() == []


def test_values_are_those_of_casadi(sils, reference):
    from twin.kinematics import compile_formula

    judge = Judge(sils, {"eq1": "printed"}, reference)
    kin = compile_formula(sils, {"eq1": "printed"})
    mine = {p.symbol: r for p, r in judge.residuals.items() if p.equation == "eq1" and p.statement > 1}
    points = kin.points_many(Ts=reference.Ts)
    for i in (1, 2, 3):
        for j, axis in enumerate("XYZ"):
            symbol = f"{axis}_S{i}"
            true = reference.symbols[symbol]
            place = next(p for p in judge.residuals if p.symbol == symbol)
            np.testing.assert_allclose(true + judge.residuals[place][:, 0] * 1e-9, points[f"s{i}"][:, j], atol=1e-14)
    assert set(mine) == set(sils.equations[0].outputs)


@pytest.mark.slow
def test_command(capsys):
    from twin.cli import main

    assert main(["explain", "sils", "--variant", "eq1=printed", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["explained"]
    assert data["repairs"][0]["cures"][0][0]["changes"][0]["edit"] == "c_theta -> c_phi"
    assert main(["explain", "sils", "--variant", "eq1=typo"]) == 2
    assert "printed" in capsys.readouterr().err
    assert main(["explain", "sils", "--variant", "printed", "--variant", "eq1=printed"]) == 2
    assert main(["explain", "sils", "--seconds", "-1"]) == 2


@pytest.mark.slow
def test_what_is_printed_names_row_place_and_edit(printed1, printed2):
    from twin.cli.show import plain
    from twin.robots.sils import __file__ as sils_file

    file = Path(sils_file).read_text(encoding="utf-8").splitlines()
    first = next(i for i, text in enumerate(file, 1) if text.startswith("def eq1_printed"))
    line = next(i for i, text in enumerate(file, 1) if i > first and text.startswith("    Y_S1 ="))
    text = "\n".join(map(plain, printed1.text()))
    for part in (
        "DISAGREE: 4 rows wrong, explained",
        "x of point s1",
        "c_theta -> c_phi",
        f"sils.py:{line}",
        "worst at X_E",
    ):
        assert part in text
    assert "(TIE)" in "\n".join(map(plain, printed2.text()))
