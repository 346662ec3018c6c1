"""`twin explain --prove`: what a proof says of repairs, and repairs that are proved to be one function."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import pytest

import twin
from twin.api.repair_prover import EquationsRepairProver, _verdict
from twin.formula import variant_choice
from twin.proof.equality import equal_outputs
from twin.robots import load_formula
from twin.validation.explain.candidate import Candidate, GroupResult
from twin.validation.explain.formula_state import edited_formula, source_path
from twin.validation.explain.function_source import Edit
from twin.validation.explain.proved_repairs import with_proofs

RIGHT = "a**2 - b**2) / (2 * a * b)"
WRONG = "a**2 - b**2) / (2 * a * 1)"


@pytest.fixture(scope="module")
def lapbot():
    """Return Lapbot, whose lengths a and b are equal."""
    return twin.load("lapbot")


@pytest.fixture
def wrong(lapbot, tmp_path):
    """Return its equations with 1 in place of b."""
    text = source_path(lapbot.formula).read_text(encoding="utf-8")
    assert text.count(RIGHT) == 1
    path = tmp_path / "formula.py"
    path.write_text(text.replace(RIGHT, WRONG), encoding="utf-8")
    return load_formula(path, "lapbot")


def cure(formula, new):
    """Return the cure that writes a text in place of the 1."""
    path = source_path(formula)
    data = path.read_bytes()
    start = data.index(WRONG.encode()) + len(WRONG) - len("1)")
    line = data[:start].count(b"\n") + 1
    edit = Edit(path, line, start, start + 1, "1", new, "name", 0, "arm")
    return [Candidate(SimpleNamespace(), [edit], {}, {}, breaks_row=False)]


def judged(lapbot, formula, *news):
    found = GroupResult([], [cure(formula, new) for new in news], None, 0.0, 1.0, len(news))
    (result,) = with_proofs(formula, [found], EquationsRepairProver(lapbot, None))
    return result


@pytest.mark.slow
def test_cures_that_are_one_function_are_merged(lapbot, wrong):
    result = judged(lapbot, wrong, "b", "a", "(b + 0.0000001)")
    assert [[c.edits[0].new for c in group] for group in result.result.cures] == [["b", "a"], ["(b + 0.0000001)"]]
    assert result.merged == (True, False)
    identity, close = result.proofs
    assert identity == "identity, proved: 8 claims at all poses"
    # 0.1 um: the claims have roots, whose exact values do not tell an error from another sign
    assert close.startswith("open: ")
    assert "it is not so" not in close
    assert "um at one of 4096 poses within the ranges of q1, q2, q3, q7, q8, q9" in close


@pytest.mark.parametrize(
    ("status", "roots", "text"),
    [
        ("refuted", 0, "only close: 2 um at one of 64 poses within the ranges of q1; it is not so that a = b"),
        ("unproved", 0, "only close: 2 um at one of 64 poses within the ranges of q1; not proved that a = b: no luck"),
        ("unproved", 3, "open: 2 um at one of 64 poses within the ranges of q1; not proved that a = b: no luck"),
    ],
)
def test_what_is_not_refuted_is_not_called_wrong(status, roots, text):
    claim = SimpleNamespace(
        status=status, may_differ=status != "refuted", roots=roots, largest=2e-6, sentence="a = b", reason="no luck"
    )
    assert _verdict(SimpleNamespace(claims=[claim], ranges={"q1": ()}, states=64)) == text


def test_an_edit_of_another_file_or_of_a_left_side_is_not_judged(lapbot, wrong):
    (edit,) = cure(wrong, "b")[0].edits
    for other in (replace(edit, kind="left side"), replace(edit, path=Path("other.py"))):
        with edited_formula(wrong, [other]) as edited:
            assert edited is None


def test_without_a_prover_nothing_is_said(wrong):
    found = GroupResult([], [cure(wrong, "b")], None, 0.0, 1.0, 1)
    (result,) = with_proofs(wrong, [found], None)
    assert (result.result, result.proofs) == (found, ())


@pytest.mark.slow
def test_equal_outputs_of_different_texts_are_proved(lapbot, wrong):
    variants = variant_choice.choose(lapbot.formula, None)
    same = equal_outputs(lapbot.formula, lapbot.formula, variants, lapbot.mechanism)
    assert {claim.status for claim in same} == {"proved"}
    other = equal_outputs(lapbot.formula, wrong, variants, lapbot.mechanism)
    assert {claim.status for claim in other} >= {"refuted"}
    assert next(claim for claim in other if claim.name == "forward: pose").status == "proved"


@pytest.mark.slow
def test_outputs_that_differ_more_than_half_a_turn_from_the_middle_are_not_equal():
    """Joint 5 of PA-10 makes 255 degrees to both sides; within half a turn, the difference is 0."""
    robot = twin.load("pa10")
    (forward,) = [equation for equation in robot.formula.equations if equation.stage == "forward"]
    function = forward.variants[forward.default]

    def changed(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
        T = ca.SX(function(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8))
        T[0, 3] += 1 - ca.cos((q5 - ca.atan2(ca.sin(q5), ca.cos(q5))) / 2)
        return T

    other = replace(forward, variants={forward.default: changed})
    equations = tuple(other if equation is forward else equation for equation in robot.formula.equations)
    variants = variant_choice.choose(robot.formula, None)
    claims = equal_outputs(robot.formula, replace(robot.formula, equations=equations), variants, robot.mechanism)
    assert next(claim for claim in claims if claim.name == "forward: pose").status == "refuted"


@pytest.mark.slow
def test_each_repair_of_printed_equations_is_an_identity():
    found = twin.explain(twin.load("sils"), {"eq1": "printed"}, prove=True)
    assert [repair.proofs for repair in found.repairs] == [("identity, proved: 15 claims at all poses",)] * 4
    assert "        identity, proved: 15 claims at all poses" in "\n".join(map(str, found.text()))
