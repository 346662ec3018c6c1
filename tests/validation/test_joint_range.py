"""Equations that are wrong in a part of the joint range are found; right ones are not accused."""

from __future__ import annotations

import functools
import os
from dataclasses import replace
from typing import cast

import casadi
import numpy as np
import pytest

import twin
from made import explain_seeds as seeds
from made.arm import LINK, arm
from made.branches import RIGHT, THREE, TWO, WRONG
from made.formulas import with_reach
from made.lanes import one_of_a_kind
from twin.cli import fix_search
from twin.core import spatial
from twin.kinematics import Kinematics, compile_formula
from twin.reference import ReferenceModel
from twin.reference.joint_range import STATES, joint_range
from twin.robots import load_formula
from twin.validation.equations_comparison import EquationsComparison
from twin.validation.explain.explain import explain
from twin.validation.joint_range import HEADING, reads_orientation, whole_range
from twin.validation.residual_rows import Tolerances
from twin.validation.result import Residual

DRAWS = int(os.environ.get("TWIN_BRANCHES", "8"))
"""Number of drawn errors; the figures of the documentation are with 200."""

SEED = int(os.environ.get("TWIN_BRANCHES_SEED", "5"))

LIMIT = 2.6


def judged(tmp_path, template, parts, error="pass", before=None, reach=None):
    """Return the comparison over the joint range of a formula for a planar arm of two or three links.

    `before` is a row of the protocol, `reach` are functions from tool pose to margin by row of reach.
    """
    count = 2 if template is TWO else 3
    model = ReferenceModel(arm(count))
    path = tmp_path / "formula.py"
    path.write_text(template.format(link=LINK, error=error, **parts))
    home = np.full(count, 0.3)
    driven = [(f"q{i}", True) for i in range(count)]
    formula = load_formula(path, "arm", driven=lambda: (driven, model.solve(home).T_base_tool, home))
    if reach:
        formula = with_reach(formula, reach)
    out = EquationsComparison(residuals=[before] if before else [])
    whole_range(compile_formula(formula), model, Tolerances(), out)
    return out


@pytest.mark.parametrize(("template", "parts"), RIGHT)
def test_right_equations_are_not_accused(tmp_path, template, parts):
    out = judged(tmp_path, template, parts)
    assert not out.findings
    assert all(r.agrees for r in out.residuals)
    assert out.facts[HEADING]["judged"] == f"100 % of the joint range, {STATES} states"


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_branch_is_found(tmp_path, name):
    template, parts, share = WRONG[name]
    (finding,) = judged(tmp_path, template, parts).findings
    assert finding.code in ("range.differs", "range.no_answer")
    assert finding.severity == "disagreement"
    found = float(finding.message.split("(")[1].split(" %")[0]) / 100
    assert found == pytest.approx(share, abs=0.11)


def test_a_margin_without_a_value_excludes_no_state_and_is_found(tmp_path):
    reach = {"upper": lambda T: casadi.sqrt(T[1, 3])}
    out = judged(tmp_path, *RIGHT[0], reach=reach)
    (finding,) = out.findings
    assert (finding.code, finding.severity) == ("range.no_margin", "disagreement")
    assert "the row 'upper' of reach has no value at" in finding.message
    assert out.facts[HEADING]["judged"] == f"100 % of the joint range, {STATES} states"
    both = judged(tmp_path, *RIGHT[0], reach={**reach, "above": lambda T: T[1, 3]})
    assert not both.findings
    assert "beyond 'above' of the equations" in both.facts[HEADING]


def test_derivatives_without_a_value_do_not_say_that_no_orientation_is_read():
    class Unknown:
        def __init__(self, rates):
            self.rates = rates

        def inverse_jacobian_many(self, Ts):
            return self.rates

    nothing = np.zeros((2, 3, 6))
    unknown = np.full((2, 3, 6), np.nan)
    turning = nothing.copy()
    turning[1, 2, 4] = 1.0
    for rates, reads in ((nothing, False), (unknown, True), (turning, True), (np.zeros((0, 3, 6)), True)):
        assert reads_orientation(cast(Kinematics, Unknown(rates)), np.zeros((len(rates), 4, 4))) is reads


def test_the_fix_of_a_lost_quadrant_is_atan2(tmp_path):
    model = ReferenceModel(arm(2))
    path = tmp_path / "formula.py"
    template, parts, _ = WRONG["atan for atan2"]
    path.write_text(template.format(link=LINK, error="pass", **parts))
    home = np.array([0.3, 0.3])
    driven = [("q0", True), ("q1", True)]
    formula = load_formula(path, "arm", driven=lambda: (driven, model.solve(home).T_base_tool, home))
    found = explain("arm", formula, model)
    assert found.explained
    assert fix_search.text(found, "").startswith("in inverse, q0, q1: replace atan(y / x) by atan2(y, x) (")


def drawn_error(rng, count):
    """Return (an error as code, a function that makes the same error in joint values (k, n))."""
    where, what = rng.integers(count, size=2)
    side = rng.choice([-1, 1])
    threshold = rng.uniform(-0.95, 0.95) * LIMIT
    wrong, change = [
        ("-q[{0}]", lambda x: -x),
        ("q[{0}] + pi", lambda x: x + np.pi),
        ("pi - q[{0}]", lambda x: np.pi - x),
        ("q[{0}] + 0.001", lambda x: x + 0.001),
        ("fabs(q[{0}])", np.abs),
    ][rng.integers(5)]
    condition = f"{side} * q[{where}] > {threshold}"

    def applied(q):
        out = q.copy()
        region = side * q[:, where] > threshold
        out[region, what] = change(q[region, what])
        return out

    return f"q[{what}] = if_else({condition}, {wrong.format(what)}, q[{what}])", applied


def planar(q):
    """Return x, y and orientation (k, 3) of the planar arm at joint values q (k, n), by trigonometry."""
    angles = np.cumsum(q, axis=1)
    return np.column_stack([LINK * np.cos(angles).sum(axis=1), LINK * np.sin(angles).sum(axis=1), angles[:, -1]])


def test_drawn_errors_in_a_part_of_the_range_are_found(tmp_path):
    """Those that are wrong on at least 5 % of the range, all; those on at least 1 %, 99 %."""
    rng = np.random.default_rng(SEED)
    missed, all_of = {0.05: 0, 0.01: 0}, {0.05: 0, 0.01: 0}
    while all_of[0.01] < DRAWS:
        count = int(rng.choice([2, 3]))
        error, applied = drawn_error(rng, count)
        q = rng.uniform(-LIMIT, LIMIT, (20_000, count))
        if count == 3:
            q = q[q[:, 1] > 0]  # the inverse's elbow
        difference = planar(applied(q)) - planar(q)
        difference[:, 2] = np.abs(np.exp(1j * difference[:, 2]) - 1)
        share = (np.abs(difference).max(axis=1) > 1e-5).mean()
        if not 0.01 <= share <= 0.5:
            continue
        template, parts = (TWO, RIGHT[0][1]) if count == 2 else (THREE, RIGHT[4][1])
        found = [f.severity for f in judged(tmp_path, template, parts, error).findings]
        for bound in (0.05, 0.01):
            if share >= bound:
                all_of[bound] += 1
                missed[bound] += not found
                assert set(found) <= {"disagreement"}
    print(f"missed {missed} of {all_of}")
    assert missed[0.05] == 0
    assert missed[0.01] <= 0.01 * all_of[0.01]


ROBOTS = [name for name in twin.names() if not name.startswith(("sils", "raven"))]
"""Robots in which errors are drawn. The equations of SILS are solved, and must be linear in the joint values; those of
the Ravens choose one of eight solutions."""


def with_error(formula, ends, rng):
    """Return (formula with an error in one joint value, function that returns where values q (k, n) are wrong, text).

    `ends` (n, 2) are the smallest and largest joint values.
    """
    names = [joint.name for joint in formula.joints]
    choices = [e for e in formula.equations if e.stage == "inverse" and set(e.outputs) & set(names)]
    equation = choices[rng.integers(len(choices))]
    joints = [name for name in equation.outputs if name in names]
    where, what = (joints[i] for i in rng.integers(len(joints), size=2))
    condition, wrong = names.index(where), names.index(what)
    side = rng.choice([-1, 1])
    threshold = rng.uniform(*ends[condition])
    offset = 0.001
    if formula.joints[wrong].kind == "revolute":
        offset = rng.choice([0.001, np.pi])
    kind = rng.integers(3)
    right = equation.variants[equation.default]

    def change(x, size):
        return [-x, x + offset, size(x)][kind]

    @functools.wraps(right)
    def function(*args, **kwargs):
        found = right(*args, **kwargs)
        out = list(found) if isinstance(found, tuple | list) else [found]
        i, j = equation.outputs.index(where), equation.outputs.index(what)
        out[j] = casadi.if_else(side * out[i] > threshold, change(out[j], casadi.fabs), out[j])
        return tuple(out) if len(out) > 1 else out[0]

    def is_wrong(q):
        difference = change(q[:, wrong], np.abs) - q[:, wrong]
        return (side * q[:, condition] > threshold) & (np.abs(difference) > 1e-6)

    edited = replace(equation, variants={**equation.variants, equation.default: function})
    told = f"{what} where {side} * {where} > {threshold:.4g}, kind {kind}"
    return replace(formula, equations=tuple(edited if e is equation else e for e in formula.equations)), is_wrong, told


@pytest.mark.slow
def test_drawn_errors_in_the_equations_of_robots_are_found():
    """The share of the range is counted at other states than those at which the equations are judged.

    It is counted with the joint values of the right inverse: a mechanism may have other solutions as well.
    """
    rng = np.random.default_rng(SEED)
    missed, all_of = {0.05: 0, 0.01: 0}, {0.05: 0, 0.01: 0}
    robots = [twin.load(name) for name in ROBOTS]
    states = []
    for robot in robots:
        kin = robot.kinematics(None)
        q = kin.inverse_many(joint_range(robot.reference(), 5 * STATES).run.Ts_base_tool[STATES:])
        states.append(q[np.isfinite(q).all(axis=1)][:, ~kin.auxiliary])
    while all_of[0.01] < DRAWS:
        n = rng.integers(len(robots))
        ends = np.column_stack([states[n].min(axis=0), states[n].max(axis=0)])
        formula, is_wrong, told = with_error(robots[n].formula, ends, rng)
        share = is_wrong(states[n]).mean()
        if not 0.01 <= share <= 0.5:
            continue
        out = EquationsComparison()
        model = robots[n].reference()
        extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
        whole_range(compile_formula(formula, extra_joints=extra_joints), model, Tolerances(), out)
        found = [f.severity for f in out.findings]
        for bound in (0.05, 0.01):
            if share >= bound:
                all_of[bound] += 1
                missed[bound] += "disagreement" not in found
        if "disagreement" not in found:
            print(f"\n{ROBOTS[n]}: {told}, wrong at {100 * share:.1f} % of the states: {found}")
    print(f"missed {missed} of {all_of}")
    assert missed[0.05] == 0
    assert missed[0.01] <= 0.01 * all_of[0.01]


@pytest.mark.parametrize("name", one_of_a_kind())
def test_the_equations_of_a_robot_agree_over_the_whole_range(name):
    robot = twin.load(name)
    kin = robot.kinematics(None)
    out = EquationsComparison()
    whole_range(kin, robot.reference(), Tolerances(), out)
    assert [f.message for f in out.findings] == []
    stages = {r.name.partition(",")[0] for r in out.residuals}
    assert stages == {n for n in ("inverse", "forward") if getattr(kin, f"closed_{n}")}


@pytest.mark.parametrize("name", one_of_a_kind())
def test_the_states_are_closed_and_within_all_limits(name):
    robot = twin.load(name)
    drawn = joint_range(robot.reference())
    mechanism = robot.mechanism
    assert len(drawn.run.x) == STATES
    limits = mechanism.limits
    assert (drawn.run.q >= limits[:, 0] - 1e-12).all()
    assert (drawn.run.q <= limits[:, 1] + 1e-12).all()
    assert drawn.run.gaps[..., 0].max(initial=0.0) < 1e-11
    links = robot.reference().link_poses(drawn.run.x)
    for joint in mechanism.passive:
        if joint.limits is not None and joint.name in drawn.run.q_passive:
            value = drawn.run.q_passive[joint.name]
            assert joint.limits[0] - 1e-12 <= value.min() <= value.max() <= joint.limits[1] + 1e-12
        if joint.cone is not None:
            axes = [
                (links[body] @ T)[:, :3, 2]
                for body, T in ((joint.parent, joint.T_parent_joint), (joint.child, joint.T_child_joint))
            ]
            cosine = np.sum(axes[0] * axes[1], axis=1)
            assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() <= np.degrees(joint.cone) + 1e-6


@pytest.mark.parametrize("name", ["davinci_psm", "davinci_psm_si"])
def test_the_wrist_of_an_instrument_may_be_above_the_remote_centre(name):
    """At insertions below 15.6 mm. The inverse gave poses that were off by 18.2 mm there (2 a5)."""
    robot = twin.load(name)
    mechanism = robot.mechanism
    rng = np.random.default_rng(0)
    low, high = mechanism.limits.T
    q = rng.uniform(low, high, (200, len(low)))
    q[:, 2] = rng.uniform(0.0, 0.0155, 200)
    kin = robot.kinematics(None)
    Ts = robot.reference().solve_many(q).Ts_base_tool
    again = kin.inverse_many(Ts)
    difference = again[:, :6] - q[:, :6]
    difference -= 2 * np.pi * np.round(difference / (2 * np.pi)) * kin.revolute[:6]
    assert np.abs(difference).max() < 1e-9
    assert spatial.is_pose(Ts, 1e-9)


def test_after_a_disagreement_along_the_protocol_it_is_a_consequence(tmp_path):
    before = Residual("A-B", "driven", "q1", "rad", 1.0, 1.0, 1e-8, 0.0, "go")
    template, parts, _ = WRONG["atan for atan2"]
    out = judged(tmp_path, template, parts, before=before)
    assert [f.severity for f in out.findings] == ["info"]
    assert [r.consequence_of for r in out.residuals[1:]] == ["q1", "q1"]


@pytest.mark.parametrize("wrong", ["", "atan2(sqrt(w[0] ** 2), w[2])"])
def test_an_error_that_a_swivel_of_zero_hides_is_found(tmp_path, wrong):
    """At swivel 0, w[1] is zero at every pose: an elbow row without its square agrees there, and only there."""
    robot = twin.load("pa10")
    right = "atan2(sqrt(w[0] ** 2 + w[1] ** 2), w[2])"
    case = seeds.built_in("pa10")
    text = case.path.read_text(encoding="utf-8")
    assert text.count(right) == 1
    path = tmp_path / "formula.py"
    path.write_text(text.replace(right, wrong or right), encoding="utf-8")
    out = EquationsComparison()
    whole_range(compile_formula(case.load(path)), robot.reference(), Tolerances(), out)
    wrong_rows = {(r.name, r.unit) for r in out.residuals if not r.agrees}
    assert wrong_rows == ({("inverse, swivel = 23 deg", "m")} if wrong else set())
    assert [(f.code, f.cause) for f in out.findings] == ([("range.differs", "inverse")] if wrong else [])
    assert all("inverse equations with swivel = 23 deg are wrong" in f.message for f in out.findings)
