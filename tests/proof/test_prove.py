"""Proofs of the built-in robots: what is right is proved, what is printed wrongly is refuted at a pose."""

from __future__ import annotations

import inspect
import json
import os
import re
from dataclasses import replace
from fractions import Fraction
from functools import wraps
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import twin
from made import explain_mutants as mutants
from made import explain_seeds as seeds
from made import proof_mutants
from made.lanes import robots
from twin.cli import main
from twin.core.errors import TwinError
from twin.core.provenance import Parameter
from twin.core.units import DEG
from twin.formula import equation_values, variant_choice
from twin.kinematics.compile import compile_formula
from twin.proof import prove as prover
from twin.proof.claims import judged
from twin.proof.degree import Degree, RootSignature
from twin.proof.fit_conditions import is_judged_by_others
from twin.proof.precise import certainly_not_zero
from twin.proof.program import ProgramStep
from twin.proof.prove import prove
from twin.proof.random_states import random_states
from twin.proof.values import ExactValue

STATES = 1024
MUTANTS = int(os.environ.get("TWIN_PROOF_MUTANTS", "12"))

OPEN = {"sher": 1, "raven_left": 1, "raven_right": 1}
"""Robots with claims that are not proved, and how many."""


@pytest.mark.parametrize("name", robots(["sils"], slow=[n for n in twin.names() if n != "sils"]))
def test_right_equations_are_proved_or_the_reason_is_named(name):
    found = twin.prove(name, states=4 * STATES)
    count = OPEN.get(name, 0)
    assert found.proof.count("refuted") == 0
    assert found.proof.count("unproved") == count
    assert found.exit_code == (2 if count else 0)
    for claim in found.proof.claims:
        if claim.status == "proved":
            assert claim.log10_odds < -10
            assert claim.largest < 1e-9
        else:
            assert claim.reason


@pytest.mark.parametrize(
    ("name", "variants", "claims"),
    [
        (
            "sils",
            {"eq1": "printed"},
            {
                *("inverse: joint s1", "inverse: joint s3", "inverse: point s1", "inverse: point s3"),
                *("inverse: s1 to s2", "inverse: s1 to s3", "inverse: s2 to s3"),
            },
        ),
        pytest.param(
            *("davinci_psm", {"table1": "printed"}, {"forward: joint q6", "forward of inverse"}), marks=pytest.mark.slow
        ),
        pytest.param(
            *("raven_left", {"table": "davinci_tool"}, {"forward: joint yaw", "forward of inverse"}),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_printed_errors_are_refuted_and_all_else_is_proved(name, variants, claims):
    found = twin.prove(name, variants, states=STATES)
    assert {claim.name for claim in found.proof.claims if claim.status == "refuted"} == claims
    assert found.exit_code == 1


def test_the_error_of_the_printed_platform_is_given_as_a_formula():
    found = twin.prove("sils", {"eq1": "printed"}, states=STATES)
    errors = {claim.name: claim.error for claim in found.proof.claims}
    assert errors["inverse: s1 to s3"] == "l_p^2 (cos(theta)^2 - cos(phi)^2) of the square"
    assert errors["inverse: point s1"] == "0.5 l_p sin(psi) (cos(phi) - cos(theta))"
    assert not errors["inverse: point s2"]
    assert any("the error is l_p^2" in finding.message for finding in found.findings)


@pytest.mark.slow
def test_a_long_error_is_in_the_data_and_not_in_the_finding():
    found = twin.prove("davinci_psm", {"table1": "printed"}, states=STATES)
    (claim,) = [claim for claim in found.content()["claims"] if claim["name"] == "forward: joint q6"]
    assert claim["error_terms"] == 30
    formula = re.sub(r"(\w|\)) (?=[a-z0-9(])", r"\1 * ", claim["error"]).replace("^", "**")
    names = {"cos": np.cos, "sin": np.sin, **{f"sqrt({n})": np.sqrt(n) for n in (2, 3, 6)}}
    names |= {p.name: p.value for p in twin.load("davinci_psm").formula.parameters} | claim["witness"]
    assert abs(eval(formula, names)) > 0.01
    assert any('the error is a polynomial of 30 terms: see "error" with --json' in f.message for f in found.findings)


@pytest.mark.slow
def test_a_witness_in_fractions_has_angles_without_an_exact_form():
    """52 degrees are no fraction of a circle with rational coordinates: the nearest one is part of the witness."""
    robot = twin.load("sher")
    found = twin.prove(robot, {"eq3": "printed"}, states=256)
    published = {p.name: p.value for p in robot.formula.parameters}
    refuted = [claim for claim in found.proof.claims if claim.status == "refuted"]
    assert refuted
    for claim in refuted:
        for name in ("phi2", "phi3", "phi4"):
            half = Fraction(claim.fractions[name].removeprefix("2 atan(").removesuffix(")"))
            assert abs(2 * np.arctan(float(half)) - published[name]) < 1e-6


def test_lengths_that_are_multiples_of_a_root_are_named():
    found = twin.prove("sils", states=256)
    assert found.proof.recognised_lengths["77.9422863 mm"] == "45 sqrt(3) mm"
    notes = [finding for finding in found.findings if finding.code == "prove.number"]
    assert any("77.9422863 mm of the CAD is taken as 45 sqrt(3) mm" in note.message for note in notes)
    assert found.exit_code == 0


def test_a_witness_is_a_pose_where_the_equations_are_wrong():
    """The compiled equations and the independent model of the CAD judge the pose."""
    robot = twin.load("sils")
    found = twin.prove(robot, {"eq1": "printed"}, states=STATES)
    claim = next(claim for claim in found.proof.claims if claim.name == "inverse: joint s1")
    T = robot.kinematics().program.pose_of_coordinates.one(np.array(list(claim.witness.values())))
    q = robot.kinematics({"eq1": "printed"}).inverse(T)
    assembly = robot.reference().solve(robot.kinematics().inverse(T))
    np.testing.assert_allclose(assembly.T_base_tool, T, atol=1e-9)
    assert np.abs(robot.kinematics().inverse(T) - q).max() > 1e-4


def test_an_error_of_a_nanometre_is_no_proof():
    robot = twin.load("pa10")
    formula = robot.formula
    changed = tuple(replace(p, value=p.value + 1e-9) if p.name == "RL3" else p for p in formula.parameters)
    proof = prove(replace(formula, parameters=changed), variant_choice.choose(formula, None), robot.mechanism, STATES)
    wrong = {claim.name: claim.status for claim in proof.claims}
    assert wrong["forward: joint mount"] == "unproved"
    assert wrong["inverse: point elbow"] == "unproved"
    assert wrong["inverse: point shoulder"] == "proved"


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_an_error_in_a_box_that_no_drawn_state_meets_is_found(width):
    """The search for states goes along the gradient of the condition to the edge of the box, and into it."""
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += 0.001 * (ca.fabs(q1 - 0.12345) < width)
        return T

    formula = with_forward(robot.formula, shifted)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    verdicts = {claim.name: claim for claim in proof.claims}
    assert verdicts["forward: joint mount"].status == "refuted"
    assert abs(verdicts["forward: joint mount"].witness["q1"] - 0.12345) <= width


def test_an_error_in_a_box_that_is_a_result_itself_is_found():
    """A comparison is an entry of a point, as it is: no other operation reads it."""
    robot = twin.load("pa10")
    (function,) = [f for f in proof_mutants.functions(robot.formula) if f.__name__ == "places"]
    text = Path(function.__code__.co_filename).read_text(encoding="utf-8")
    changed = text.replace("vertcat(0, 0, 0)", "vertcat((T_base_tool[0, 3] - 0.3) ** 2 < 1e-12, 0, 0)")
    with proof_mutants.with_text(function, changed):
        proof = prove(robot.formula, variant_choice.choose(robot.formula, None), robot.mechanism, 256)
    assert {claim.name: claim.status for claim in proof.claims}["inverse: point shoulder"] == "refuted"


@pytest.mark.slow
@pytest.mark.parametrize("error", ["q5 > 3.6", "1 - cos((q5 - atan2(sin(q5), cos(q5))) / 2)"])
def test_an_error_more_than_half_a_turn_from_the_middle_of_a_range_is_found(error):
    """Joint 5 makes 255 degrees to both sides; the second error is 0 within half a turn, and has no condition."""
    robot = twin.load("pa10")
    (function,) = [f for f in proof_mutants.functions(robot.formula) if f.__name__ == "table1"]
    text = Path(function.__code__.co_filename).read_text(encoding="utf-8")
    with proof_mutants.with_text(function, text.replace("0, q5, RL5", f"0, q5 + 0.001 * ({error}), RL5")):
        proof = prove(robot.formula, variant_choice.choose(robot.formula, None), robot.mechanism)
    assert {claim.name: claim.status for claim in proof.claims}["forward: joint mount"] == "refuted"


@pytest.mark.parametrize(
    ("limits", "expected"),
    [((7.0, np.inf), (7.0, 7.0 + 2 * np.pi)), ((-np.inf, -7.0), (-7.0 - 2 * np.pi, -7.0)), (None, (-np.pi, np.pi))],
)
def test_a_joint_with_one_limit_is_drawn_over_a_full_turn_beside_it(limits, expected):
    robot = twin.load("pa10")
    joints = tuple(replace(joint, limits=limits) if joint.name == "q5" else joint for joint in robot.mechanism.joints)
    states = random_states(robot.formula, replace(robot.mechanism, joints=joints), 4, 0)
    assert states.ranges["q5"][1:] == pytest.approx(expected)


def test_an_error_beyond_the_joint_limits_is_none_by_intervals():
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += ca.if_else(q1 > 50, 0.001, 0)
        return T

    formula = with_forward(robot.formula, shifted)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    assert all(claim.status == "proved" for claim in proof.claims if claim.name != "conditions")
    assert proof.branches.bounded == twin.prove(robot, states=256).proof.branches.bounded + 1


def test_a_condition_whose_other_answer_nobody_finds_is_unproved():
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        # never true, but intervals need too many boxes to see it
        T[0, 3] += 0.001 * (ca.sin(3 * q1) - 3 * ca.sin(q1) + 4 * ca.sin(q1) ** 3 > 1e-9)
        return T

    formula = with_forward(robot.formula, shifted)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    (claim,) = [claim for claim in proof.claims if claim.status != "proved"]
    assert claim.name == "conditions"
    assert "a search found no state with the other, and intervals in 4096 boxes" in claim.reason
    assert re.search(r"\(margin [0-9.e-]+ or more\)", claim.reason)
    assert proof.branches.open


def test_an_answer_without_a_value_at_some_states_only_is_searched_at_the_others():
    """A small box has no value where the tool is high, and an error where it is low."""
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        inside = ca.fabs(q1 - 0.3) < 5e-5
        T[0, 3] += ca.if_else(T[2, 3] > 0.3, ca.if_else(inside, np.nan, 0), 0) + ca.if_else(inside, 0.001, 0)
        return T

    formula = with_forward(robot.formula, shifted)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    verdicts = {claim.name: claim for claim in proof.claims}
    assert verdicts["forward: joint mount"].status == "refuted"
    assert abs(verdicts["forward: joint mount"].witness["q1"] - 0.3) < 5e-5


@pytest.mark.slow
def test_an_operation_without_an_exact_form_is_refuted_by_its_values_or_named():
    robot = twin.load("pa10")
    verdicts = []
    for size in (0.001, 0.0):

        def shifted(T, q1, size=size):
            T = ca.SX(T)
            T[0, 3] += size * ca.exp(q1) + 1e-3 * ca.log(1 + size * q1**2)
            return T

        formula = with_forward(robot.formula, shifted)
        proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
        verdicts.append({claim.name: claim.status for claim in proof.claims}["forward: joint mount"])
    assert verdicts == ["refuted", "proved"]

    def written_otherwise(T, q1):
        T = ca.SX(T)
        T[0, 3] += 1e-3 * (ca.log(2 * ca.exp(ca.sin(q1))) - np.log(2) - ca.sin(q1))
        return T

    formula = with_forward(robot.formula, written_otherwise)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    reasons = {claim.name: claim.reason for claim in proof.claims if claim.status == "unproved"}
    assert reasons["forward: joint mount"] == "no exact form: operation exp"
    assert reasons["forward of inverse"] == "no exact form: operation exp"


def test_a_table_is_refused_by_name():
    robot = twin.load("pa10")
    table = ca.interpolant("table", "linear", [[-3.0, 0.0, 3.0]], [0.0, 0.001, 0.0])

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += table(q1)
        return T

    formula = with_forward(robot.formula, shifted)
    with pytest.raises(TwinError, match="formula 'pa10': an equation calls a table or another compiled function"):
        prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)


@pytest.mark.parametrize("relation", [lambda q, x: ca.logic_and(q <= x, q >= x), lambda q, x: q == x + 0.3])
def test_a_condition_that_is_true_where_its_margin_is_zero_is_open(relation):
    robot = twin.load("pa10")
    low = robot.mechanism.joint("q1").limits[0]

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += ca.if_else(relation(q1, low), 0.001, 0)
        return T

    formula = with_forward(robot.formula, shifted)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    assert [claim.name for claim in proof.claims if claim.status != "proved"] == ["conditions"]


@pytest.mark.slow
def test_equations_without_a_value_that_do_not_say_why_are_refuted():
    robot = twin.load("pa10")

    def root(T, q1):
        T = ca.SX(T)
        T[0, 3] += ca.cos(ca.acos(q1)) - q1
        return T

    formula = with_forward(robot.formula, root)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    lost = {claim.name: claim for claim in proof.claims}["values"]
    assert lost.status == "refuted"
    assert abs(lost.witness["q1"]) > 1
    assert "values" not in {claim.name for claim in twin.prove(robot, states=256).proof.claims}


def test_an_inverse_without_a_value_where_the_mechanism_is_assembled_is_refuted():
    """Its margins have no value either."""
    robot = twin.load("lapbot")
    function = inspect.unwrap(next(e for e in robot.formula.equations if e.name == "shaft").variants["derived"])
    text = Path(function.__code__.co_filename).read_text(encoding="utf-8")
    right = "u = to / if_else(length < r7, "
    assert text.count(right) == 1
    with proof_mutants.with_text(function, text.replace(right, "u = to / if_else(length < r10, ")):
        proof = prove(robot.formula, variant_choice.choose(robot.formula, None), robot.mechanism, 256)
    assert {claim.name: claim for claim in proof.claims}["values"].status == "refuted"


@pytest.mark.parametrize("unit", ["mm", "deg"])
def test_a_parameter_that_is_no_number_is_refused(unit):
    robot = twin.load("sils")
    changed = []
    for parameter in robot.formula.parameters:
        if parameter.name == "l_p":
            parameter = replace(parameter, value=float("nan"), unit=unit)
        changed.append(parameter)
    formula = replace(robot.formula, parameters=tuple(changed))
    with pytest.raises(TwinError, match="'l_p' is nan, not a finite number"):
        prove(formula, variant_choice.choose(formula, None), robot.mechanism, 64)


@pytest.mark.slow
def test_all_states_are_judged_where_an_angle_without_an_exact_form_must_keep_its_value(monkeypatch):
    """The first attempt has fewer states, because it proves nothing: it is not the last one, either."""
    monkeypatch.setattr(prover, "STATES", 64)
    tilt = Parameter("tilt", 52 * DEG, "deg", 52.0, "ASSUMED", "for this test")
    robot = twin.load("pa10")

    def shifted(T, q1, tilt):
        T = ca.SX(T)
        T[0, 3] += tilt - 52 * DEG
        return T

    formula = with_forward(
        replace(robot.formula, parameters=(*robot.formula.parameters, tilt)), shifted, ("q1", "tilt")
    )
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 96)
    assert "tilt" in proof.published_angles
    assert not proof.arbitrary_parameters
    assert proof.states == 96


def with_forward(formula, change, names=("q1",)):
    """Return the formula whose forward equation's pose is changed by `change(T, *symbols of names)`."""
    (forward,) = [equation for equation in formula.equations if equation.stage == "forward"]
    function = forward.variants[forward.default]

    @wraps(function)
    def changed(**symbols):
        own_symbols = {name: value for name, value in symbols.items() if name in own_names}
        return change(function(**own_symbols), *(symbols[name] for name in names))

    signature = inspect.signature(function)
    own_names = set(signature.parameters)
    added = [
        inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in names if name not in own_names
    ]
    changed.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *added])
    equation = replace(forward, variants={forward.default: changed})
    equations = tuple(equation if e is forward else e for e in formula.equations)
    return replace(formula, equations=equations)


def claim_of_mount(robot, change):
    """Return the claim on the joint mount, proved for the robot with a changed pose of the forward equation."""
    formula = with_forward(robot.formula, change)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    return {claim.name: claim for claim in proof.claims}["forward: joint mount"]


@pytest.mark.parametrize(
    ("entry", "result", "where", "unfound"),
    [
        (0, "margin arm", lambda q2: ca.fabs(q2 - 0.3) < 1e-6, 0),
        (3, "measure elbow", lambda q2: q2 == 0.3, 2),  # two sides, neither reached by chance
    ],
)
def test_an_error_in_a_box_of_a_result_without_a_claim_is_named(entry, result, where, unfound):
    """Nothing tells which value of a margin is right; but that few poses have another formula is said."""
    robot = twin.load("pa10")
    helper = next(equation for equation in robot.formula.equations if "stretch" in equation.outputs)
    function = helper.variants[helper.default]

    @wraps(function)
    def changed(**symbols):
        values = list(function(**symbols))
        values[entry] += 0.001 * where(symbols["q2"])
        return tuple(values)

    equation = replace(helper, variants={helper.default: changed})
    formula = replace(robot.formula, equations=tuple(equation if e is helper else e for e in robot.formula.equations))
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    (claim,) = [claim for claim in proof.claims if claim.status != "proved"]
    assert claim.name == "results without a claim"
    assert result in claim.reason
    assert result in proof.uncovered_values
    assert result in "".join(proof.branches.silent)
    assert (proof.branches.unfound, proof.branches.unjudged) == (unfound, 0)
    assert not prove(robot.formula, variant_choice.choose(robot.formula, None), robot.mechanism, 256).branches.silent


def test_a_joint_that_is_in_no_loop_is_not_judged():
    """Whatever the jaw's value is, it contradicts nothing: pose and other joints are the same."""
    robot = twin.load("davinci_psm").mechanism
    names = [joint.name for joint in robot.joints if not is_judged_by_others(robot, joint.name, ())]
    assert names == ["jaw_half", "jaw"]
    assert is_judged_by_others(robot, "pin_b2", ())
    assert not is_judged_by_others(robot, "pin_b2", [robot.joint("pin_b2").child])
    assert not is_judged_by_others(robot, "unknown", ())


@pytest.mark.parametrize("turn", [(-1, -1, 1), (1, -1, -1), (-1, 1, -1)])
def test_a_tool_turned_by_half_a_turn_is_refuted(turn):
    robot = twin.load("pa10")
    formula = with_forward(robot.formula, lambda T, q1: T @ ca.diag(ca.DM([*turn, 1])))
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    verdicts = {claim.name: claim.status for claim in proof.claims}
    assert verdicts["forward: joint mount"] == "refuted"


def test_an_error_below_rounding_at_half_of_the_states_is_no_proof():
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += ca.if_else(q1 < 0, 0, 5e-7)
        return T

    formula = with_forward(robot.formula, shifted)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    verdicts = {claim.name: claim.status for claim in proof.claims}
    assert verdicts["forward: joint mount"] == "unproved"


@pytest.mark.parametrize("size", [4e-7, 4e-16])
def test_a_root_with_the_wrong_sign_is_no_proof_however_small_its_effect(size):
    """In the field both signs are roots: half of the exact values are zero, as if the claim were true."""
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += size * (ca.sqrt(1 - ca.cos(q1) ** 2) / ca.sin(q1) - 1)
        return T

    claim = claim_of_mount(robot, shifted)
    assert claim.status == "unproved"
    assert claim.exact_zeros > 8
    assert "sign" in claim.reason


def test_states_that_a_search_found_judge_claims_with_roots():
    """In a box of 10 micrometres is an error that only exact values see; none of them is zero there."""
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += ca.sqrt(1 - ca.cos(q1) ** 2) - ca.fabs(ca.sin(q1))
        T[1, 3] += ca.if_else(ca.fabs(q1 - 0.3) < 5e-6, 1e-11, 0)
        return T

    claim = claim_of_mount(robot, shifted)
    assert claim.status == "unproved"
    assert "where a condition has one of its answers" in claim.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    "error",
    [
        lambda margin: ca.copysign(5e-12, margin) - 5e-12,
        lambda margin: 5e-12 * (ca.sign(margin) - 1),
        lambda margin: 1e-11 * (margin < 0),
    ],
)
def test_a_box_of_an_operation_that_chooses_by_itself_judges_claims_with_roots(error):
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += ca.sqrt(1 - ca.cos(q1) ** 2) - ca.fabs(ca.sin(q1))
        T[1, 3] += error(ca.fabs(q1 - 0.3) - 5e-6)
        return T

    claim = claim_of_mount(robot, shifted)
    assert claim.status == "unproved"
    assert "where a condition has one of its answers" in claim.reason


@pytest.mark.slow
def test_an_error_in_a_box_of_a_sign_is_found():
    robot = twin.load("pa10")

    def shifted(T, q1):
        T = ca.SX(T)
        T[0, 3] += 0.001 * (1 - ca.sign(ca.fabs(q1 - 0.12345) - 1e-6))
        return T

    formula = with_forward(robot.formula, shifted)
    proof = prove(formula, variant_choice.choose(formula, None), robot.mechanism, 256)
    verdicts = {claim.name: claim.status for claim in proof.claims}
    assert verdicts["forward: joint mount"] == "refuted"


def test_a_number_of_60_digits_is_not_zero_beyond_its_own_error():
    x = ProgramStep("input", text="x")
    square = ProgramStep("root", (ProgramStep("multiply", (x, x)),))
    difference = ProgramStep("add", (square, ProgramStep("negative", (x,))))
    small = ProgramStep("multiply", (difference, ProgramStep("number", text=f"1/{10**30}*sqrt(1)")))
    assert certainly_not_zero([small], [{"x": 0.1}, {"x": 0.3}]) == 0
    assert certainly_not_zero([small], [{"x": 0.1}, {"x": -0.3}]) == pytest.approx(6e-31)


@pytest.mark.parametrize(
    ("share", "known", "different"), [(0.5, 32, True), (0.5, 8, False), (1.0, 1, True), (None, 32, False)]
)
def test_no_zero_among_found_states_is_luck_or_none_by_the_share_at_drawn_states(share, known, different):
    residue = np.ones(known, np.uint64)
    signature = RootSignature(residue, np.ones(known, bool))
    number = ExactValue(residue, np.ones(known, bool), np.full(known, 1e-11), Degree(1, roots=frozenset({signature})))
    claim = judged("a", "it is zero", [number], np.ones(known, bool), {}, [], known, other_zero_share=share)
    assert claim.status == "unproved"
    assert claim.may_differ == different


@pytest.mark.slow
def test_the_same_seed_gives_the_same_proof():
    first = twin.prove("sils", states=256, seed=4)
    again = twin.prove("sils", states=256, seed=4)
    other = twin.prove("sils", states=256, seed=5)
    assert first.as_dict() == again.as_dict()
    assert first.as_dict() != other.as_dict()


@pytest.mark.slow
def test_no_mutant_that_computes_something_else_is_proved(tmp_path):
    """The truth is the compiled functions of right and wrong equations at random states."""
    generator = np.random.default_rng(8)
    cases = [case for case in seeds.built_ins() if case.name != "sher"]
    refuted = 0
    for i in range(MUTANTS):
        case = cases[i % len(cases)]
        path = tmp_path / str(i) / "formula.py"
        path.parent.mkdir()
        slip = mutants.mutant(case, path, generator)
        if slip is None:
            continue
        try:
            formula = case.load(path).formula if hasattr(case.load(path), "formula") else case.load(path)
            proof = prove(formula, variant_choice.choose(formula, None), twin.load(case.name).mechanism, STATES)
        except TwinError:
            continue
        if proof.count("refuted"):
            refuted += 1
        elif proof.count("proved") == len(proof.claims):
            assert same(case.formula, formula), slip
    assert refuted >= MUTANTS / 2


def same(first, second):
    """Return whether two formulas compute the same numbers, where the first computes any."""
    right, wrong = compile_formula(first), compile_formula(second)
    seed = np.asarray(first.seeds[0], float)
    generator = np.random.default_rng(2)
    if first.has("inverse"):
        poses = [
            right.program.pose_of_coordinates.one(seed + generator.uniform(-0.02, 0.02, len(seed))) for _ in range(50)
        ]
        a, b = right.inverse_many(np.array(poses)), wrong.inverse_many(np.array(poses))
    else:
        q = seed + generator.uniform(-0.02, 0.02, (50, len(seed)))
        a, b = right.forward_many(q), wrong.forward_many(q)
    known = np.isfinite(a)
    return known.any() and np.allclose(a[known], b[known], atol=1e-9)


def test_the_command_prints_a_verdict_and_json(capsys):
    assert main(["prove", "sils", "--states", "256", "--quiet"]) == 0
    assert "PROVED" in capsys.readouterr().out
    assert main(["prove", "sils", "--states", "256", "--variant", "eq1=printed", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["verdict"] == "disagree"
    wrong = [claim for claim in data["claims"] if claim["verdict"] == "refuted"]
    assert set(wrong[0]["witness"]) == {"X_E", "Y_E", "Z_E", "psi", "theta", "phi"}


@pytest.mark.slow
def test_validate_proves_as_well_if_asked(capsys, tmp_path):
    line = ["validate", "sils", "--prove", "--quiet", "--json", "--out", str(tmp_path), "--variant", "eq1=printed"]
    assert main(line) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["verdict"] == "disagree"
    assert any(proof["verdict"] == "disagree" for proof in data["proofs"])
    assert len(data["proofs"]) == len(data["reports"])
    assert len(list(tmp_path.rglob("certificate.json"))) == len(data["proofs"])


@pytest.mark.parametrize("states", [0, 63, 1_000_001])
def test_a_number_of_states_out_of_range_is_refused(states):
    with pytest.raises(TwinError, match="give 64 to 1000000"):
        twin.prove("sils", states=states)


def test_a_refuted_claim_has_a_witness_in_fractions():
    """The printed eq. (1) is computed there by doubles: the distance of two points of the platform is wrong."""
    robot = twin.load("sils")
    found = twin.prove(robot, {"eq1": "printed"}, states=256)
    claim = {claim.name: claim for claim in found.proof.claims}["inverse: s1 to s3"]
    values = []
    for name in robot.formula.coordinates.names:
        text = claim.fractions[name]
        half = text.removeprefix("2 atan(").removesuffix(")")
        values.append(
            2 * np.arctan(float(Fraction(half))) if half != text else float(Fraction(text.removesuffix(" m")))
        )
    equations = compile_formula(robot.formula, {"eq1": "printed"})
    T = np.array(equations.program.pose_of_coordinates.one(values)).reshape(1, 4, 4)
    points = equations.points_many(Ts=T)
    assert abs(np.linalg.norm(points["s1"] - points["s3"]) - 0.135) > 1e-6
    assert "it is wrong at these fractions too: X_E = " in "\n".join(finding.message for finding in found.findings)
    proved = next(claim for claim in found.proof.claims if claim.status == "proved")
    assert proved.fractions == {}
    assert not {c["name"] for c in found.certificate()["claims"]} & {"inverse: s1 to s3"}


def test_a_margin_that_is_a_function_is_named():
    robot = twin.load("sils")
    formula = robot.formula
    symbols = dict.fromkeys(formula.reach.values(), np.cos)
    with pytest.raises(TwinError, match="is a ufunc, not a number, vector or matrix"):
        equation_values.gather(formula, symbols, tuple(formula.reach.values()), "reach")


@pytest.mark.slow
def test_a_branch_that_full_turns_hide_is_met():
    """Half of the candidates of the Ravens' inverse are wrong; with the roll near half a turn, the others suffice."""
    robot = twin.load("raven_right")
    (function,) = [f for f in proof_mutants.functions(robot.formula) if f.__name__ == "candidates"]
    text = Path(function.__code__.co_filename).read_text(encoding="utf-8")
    assert text.count("side * L_w * (R @ u)") == 1
    with proof_mutants.with_text(function, text.replace("side * L_w * (R @ u)", "L_w * (R @ u)")):
        proof = prove(robot.formula, variant_choice.choose(robot.formula, None), robot.mechanism)
    assert {claim.name: claim.status for claim in proof.claims}["forward of inverse"] == "refuted"
