"""Equations must have values wherever the mechanism can be assembled; where it can, it says itself."""

from __future__ import annotations

import inspect
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import twin
from made import proof_mutants
from twin.formula import variant_choice
from twin.proof import mechanism_reach
from twin.proof.prove import prove
from twin.proof.refused_states import RefusedStates

LAPBOT = ("q1", "q2", "q3", "q7", "q8", "q9")


def proof_of(name, equation, right, wrong, states=256):
    """Return the proof of a robot with a changed line in one of its equations."""
    robot = twin.load(name)
    variants = next(e for e in robot.formula.equations if e.name == equation).variants
    function = inspect.unwrap(next(iter(variants.values())))
    text = Path(function.__code__.co_filename).read_text(encoding="utf-8")
    source = inspect.getsource(function)
    assert source.count(right) == 1
    changed = text.replace(source, source.replace(right, wrong))
    with proof_mutants.with_text(function, changed):
        return prove(robot.formula, variant_choice.choose(robot.formula, None), robot.mechanism, states)


def claim_of(proof):
    return {claim.name: claim for claim in proof.claims}.get("values")


GUARDS = [
    # 0.30 m instead of 0.35; the slide of the cannula ends at 0.326
    ("length < trocar_z", "length < r7", lambda q: length_at(q) < 0.3),
    ("length < r7 - 0.03", "length < r7", lambda q: length_at(q) < 0.32),
    ("length < if_else(q2 < 0.35, r7, 0)", "length < r7", lambda q: q[1] < 0.35),
    # a box that no drawn state meets
    (
        "norm_2(u) * if_else(sqrt((q2 - 0.2) ** 2) > 1e-6, 1, float('nan'))",
        "norm_2(u)",
        lambda q: abs(q[1] - 0.2) > 1e-6,
    ),
]
"""What the guard of Lapbot's forward equations becomes, what it was, and whether joints q have a value."""


@pytest.mark.parametrize(
    ("wrong", "right", "with_value"), [GUARDS[0], *(pytest.param(*g, marks=pytest.mark.slow) for g in GUARDS[1:])]
)
def test_a_guard_that_is_too_narrow_is_refuted(wrong, right, with_value):
    proof = proof_of("lapbot", "outer", right, wrong)
    claim = claim_of(proof)
    assert claim.status == "refuted"
    assert proof.refused_states.without_value
    # the reference model closes the loops there, and keeps all limits
    robot = twin.load("lapbot")
    q = np.array([claim.witness[name] for name in LAPBOT])
    poses = robot.reference().solve(q).link_poses
    for joint in robot.mechanism.joints:
        assert joint.beyond(poses[joint.parent], poses[joint.child]) < 0
    assert not with_value(q)
    assert np.isfinite(robot.forward(q)).all()


def length_at(q):
    """Return the distance in m of the outer point from the trocar at joint values q (6,)."""
    known = {p.name: float(p.value) for p in twin.load("lapbot").formula.parameters}
    r = known["a"] * np.exp(1j * q[1]) + known["b"] * np.exp(1j * (q[1] + q[2]))
    trocar = [known[f"trocar_{x}"] for x in "xyz"]
    return np.linalg.norm(np.subtract([r.real, r.imag, q[0]], trocar))


@pytest.mark.slow
def test_right_guards_are_compared_with_the_mechanism():
    robot = twin.load("lapbot")
    proof = prove(robot.formula, variant_choice.choose(robot.formula, None), robot.mechanism, 256)
    assert claim_of(proof) is None
    assert proof.refused_states.compared > 200
    assert proof.refused_states.unknown == 0
    assert proof.refused_states.reached == 0


@pytest.mark.slow
def test_a_negative_margin_where_the_mechanism_can_be_assembled_is_open():
    proof = proof_of("lapbot", "margins", "rest = r7 - norm_2", "rest = r7 / 2 - norm_2")
    claim = claim_of(proof)
    assert claim.status == "unproved"
    assert "a margin of the equations is negative, or not a number, at q1 = " in claim.reason


@pytest.mark.slow
def test_a_pose_that_equations_without_a_forward_model_refuse_is_compared_too():
    """The mechanism is led to the pose by six joints that hold its tool."""
    robot = twin.load("sils")
    names = robot.formula.coordinates.names
    formula = robot.formula
    first = next(e for e in formula.equations if e.stage == "inverse")
    variant = variant_choice.choose(formula, None).get(first.name, first.default)
    right = first.variants[variant]

    def refusing(**arguments):
        found = right(**arguments)
        head = found[0] if isinstance(found, tuple) else found
        refused = ca.if_else(arguments[names[0]] > formula.seeds[0][0] + 0.005, np.nan, 1)
        head = head * refused
        return (head, *found[1:]) if isinstance(found, tuple) else head

    assert names[0] in inspect.signature(right).parameters
    refusing.__signature__ = inspect.signature(right)
    equation = replace(first, variants={**first.variants, variant: refusing})
    equations = tuple(equation if e is first else e for e in formula.equations)
    proof = prove(replace(formula, equations=equations), variant_choice.choose(formula, None), robot.mechanism, 256)
    assert claim_of(proof).status == "refuted"


def test_the_mechanism_alone_says_at_which_poses_it_can_be_assembled():
    """Near home it can, far away not; the tool held in a pose is that of the reference model's joints."""
    robot = twin.load("sils")
    T = np.stack([robot.reference().solve(robot.mechanism.home).T_base_tool] * 3)
    T[1, :3, 3] += [0.004, -0.003, 0.002]
    T[2, 0, 3] += 0.5
    found = mechanism_reach.at_poses(robot.mechanism, T)
    assert found.closed.tolist() == [True, True, False]
    assert found.within.tolist() == [True, True, False]


def test_states_without_a_witness_make_no_claim():
    assert RefusedStates(10, 10, 0, {}, False).claim() is None
