"""Reach and singularity rows of arms with fewer than six freedoms: judged in the directions that their tool has."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from made.loops import mechanism
from twin.core import spatial
from twin.core.provenance import Parameter
from twin.formula import symbolic
from twin.formula.contract import ActiveJoint, Coordinates, Equation, Formula, Measure
from twin.kinematics import compile_formula
from twin.kinematics.margins import Margins
from twin.model.joint import Joint
from twin.reference import ReferenceModel
from twin.reference.degeneracy import Degeneracy
from twin.reference.margin_zeros import JudgedRow, ZeroCheck, disagreements
from twin.validation.cause import side_of

A, B = 0.3, 0.2
X, Y, Z = np.eye(3)


def arm(*axes_and_lengths):
    """Return a serial arm: each joint about an axis, each link along x from it."""
    joints, at, parent = [], np.zeros(3), "base"
    for i, (axis, length) in enumerate(axes_and_lengths, 1):
        turned = spatial.frame_from_axes(axis, Y if axis is not Y else Z)
        joints.append(
            Joint(f"q{i}", "revolute", parent, f"link{i}", spatial.pose(turned, at), spatial.pose(turned), active=True)
        )
        at, parent = np.array([length, 0, 0]), f"link{i}"
    return mechanism(*joints, tool=parent, T_tool=spatial.pose(p=at))


def inverse(x, y, a, b):
    q2 = ca.acos((x**2 + y**2 - a**2 - b**2) / (2 * a * b))
    return ca.atan2(y, x) - ca.atan2(b * ca.sin(q2), a + b * ca.cos(q2)), q2


def margins(x, y, q2, a, b, longer, turned):
    r = ca.sqrt(x**2 + y**2)
    return a + b - r + longer, r - (a - b), ca.sin(q2 + turned)


def formula(longer=0.0, turned=0.0) -> Formula:
    numbers = {"a": A, "b": B, "longer": longer, "turned": turned}
    return Formula(
        name="planar",
        title="two bars in a plane",
        source="test",
        parameters=tuple(
            Parameter(n, v, "rad" if n == "turned" else "m", v, "ASSUMED", "test") for n, v in numbers.items()
        ),
        joints=(ActiveJoint("q1", "revolute"), ActiveJoint("q2", "revolute")),
        coordinates=Coordinates(
            ("x", "y", "phi"),
            ("m", "m", "rad"),
            lambda x, y, phi: symbolic.pose(symbolic.rotation_z(phi), ca.vertcat(x, y, 0)),
            lambda T: (T[0, 3], T[1, 3], ca.atan2(T[1, 0], T[0, 0])),
        ),
        equations=(
            Equation("eq1", "", "test", "inverse", ("q1", "q2"), {"only": inverse}, {}, "only"),
            Equation("margins", "", "test", "helper", ("far", "near", "s2"), {"corrected": margins}, {}, "corrected"),
        ),
        characteristic_length=lambda a: a,
        reach={"far": "far", "near": "near"},
        measures=(Measure("elbow", "s2", "type1", 0.1, "stretched or folded"),),
        seeds=((0.4, 0.1, 0.5),),
    )


def status(given: Formula) -> dict[str, str]:
    model = ReferenceModel(arm((Z, A), (Z, B)))
    run = model.collect(np.stack([np.linspace(-0.5, 1, 40), np.linspace(0.6, 1.6, 40)], 1))
    found = ZeroCheck(model, Margins(compile_formula(given), {"q1": True, "q2": True}, ()), run.x).judge()
    return {r.name: r.status for r in found}


@pytest.mark.parametrize(
    ("wrong", "row"), [({}, ""), ({"longer": 0.004}, "far"), ({"longer": -0.004}, "far"), ({"turned": 0.2}, "elbow")]
)
def test_an_arm_of_two_bars_is_at_the_end_of_its_reach_though_its_hand_can_turn(wrong, row):
    """Stretched, the pose still has two directions, one of them a turn; the position has one."""
    found = status(formula(**wrong))
    assert found == dict.fromkeys(("far", "near", "elbow"), "agrees") | ({row: found[row]} if row else {})
    assert found.get(row) != "agrees"


@pytest.mark.parametrize("kind", ["reach", "type1", "type2", "aspect"])
def test_a_wrong_row_is_told_as_one_of_the_equations(kind):
    (found,) = disagreements([JudgedRow("far", "far", "margins", kind, "disagrees", "it is wrong", size=1.0)])
    assert side_of(found) == "equations"


@pytest.mark.parametrize(
    ("joints", "positional"),
    [
        ([(Z, A), (Z, B)], True),
        ([(Z, 0.0), (Y, A), (Y, B)], True),  # turret, shoulder, elbow: they carry a point
        ([(Z, A), (Z, B), (Z, 0.1)], False),  # the hand's direction is the third thing it has
        ([(Z, 0.0), (Y, 0.0), (X, 0.1)], False),  # a wrist
        ([(Z, 0.0), (Y, A), (Y, B), (Z, 0.1), (Y, 0.1), (X, 0.1)], False),
    ],
)
def test_position_counts_alone_where_it_has_as_many_directions_as_the_arm_has_freedoms(joints, positional, rng):
    model = ReferenceModel(arm(*joints))
    states = rng.uniform(0.3, 1.0, (20, len(joints)))
    judge = Degeneracy(model, states)
    assert judge.positional is positional
    assert judge.freedom == len(joints)
    assert judge.of(states)[:, 2].min() > 0.05
    if positional:  # the last link in line with the one before
        states[:, -1] = 0
        assert judge.of(states)[:, 2].max() < 1e-9
