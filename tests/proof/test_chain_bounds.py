"""Bounds of the difference of equations and mechanism over all joint values."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.api.chain_bounds import chain_bounds
from twin.cli import main
from twin.core import spatial
from twin.core.errors import TwinError
from twin.formula import variant_choice
from twin.model.mechanism import Mechanism
from twin.proof import chain, formula_chain, trigonometric
from twin.proof.trigonometric import AngleSum, TrigonometricSum, length_bound, part

CHAINS = ["pa10", "raven_left", "davinci_psm", *[pytest.param(n, marks=pytest.mark.nightly) for n in ("davinci_ecm",)]]


def _angles(mechanism: Mechanism) -> dict[str, AngleSum]:
    return {joint.name: AngleSum({place: 1}, 0.0, 0.0) for place, joint in enumerate(mechanism.active)}


def _pose(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return T_base_tool by multiplication of 4 x 4 matrices."""
    tool = mechanism.frame(mechanism.tool)
    values = dict(zip([joint.name for joint in mechanism.active], q, strict=True))
    T = np.eye(4)
    for joint in mechanism.path(tool.body):
        T = T @ joint.T_parent_joint
        if joint.type != "fixed":
            c, s = np.cos(values[joint.name]), np.sin(values[joint.name])
            T = T @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        T = T @ spatial.inverse(joint.T_child_joint)
    return T @ tool.T_body_frame


@pytest.mark.parametrize("name", CHAINS)
def test_corrected_equations_are_those_of_the_mechanism_at_all_joints(name):
    found = chain_bounds(twin.load(name))
    assert len(repr(found)) < 2000  # without the operations of both sides
    assert found.position < 1e-10
    assert found.rotation < 1e-10


def test_the_bound_of_two_arms_is_above_and_near_the_largest_sampled_difference():
    """A joint frame of one model is shifted and turned; the difference is sampled by products of matrices."""
    first = twin.load("pa10").mechanism
    changed = first.joints[2]
    shift = np.eye(4)
    shift[:3, 3] = 1e-4, -5e-5, 2e-5
    shift[:3, :3] = spatial.exp_so3([1e-4, 0, 5e-5])
    joints = list(first.joints)
    joints[2] = replace(changed, T_parent_joint=changed.T_parent_joint @ shift)
    second = replace(first, joints=tuple(joints))
    difference = chain.tool_pose(first, _angles(first)) - chain.tool_pose(second, _angles(second))
    bound = length_bound(part(difference, slice(0, 3), slice(3, 4)), range(7, 12))
    generator = np.random.default_rng(1)
    largest = 0.0
    for q in generator.uniform(-np.pi, np.pi, (3000, 7)):
        largest = max(largest, float(np.linalg.norm((_pose(first, q) - _pose(second, q))[:3, 3])))
    assert largest <= bound <= 1.5 * largest


def test_tolerances_of_lengths_widen_the_bound_by_their_sum():
    """The lengths of PA-10 lie along the arm: stretched, all of them add up."""
    robot = twin.load("pa10")
    found = chain_bounds(robot, tolerance=1e-5)
    assert 4e-5 <= found.position <= 1.0001 * 4e-5 + 1e-10
    assert found.rotation < 1e-10


def test_sums_have_the_values_of_the_equations():
    robot = twin.load("pa10")
    formula = robot.formula
    pose, _ = formula_chain.tool_pose(formula, variant_choice.choose(formula, None), {}, {})
    q = np.random.default_rng(2).uniform(-2, 2, 7)
    waves = np.exp(1j * pose.exponents()[:, :7] @ q)
    T = np.tensordot(waves, pose.centre, 1)
    assert np.abs(T.imag).max() < 1e-14
    assert np.abs(T.real - robot.forward(q)).max() < 1e-13


def test_products_cancel_and_keep_their_radius():
    angle = AngleSum({0: 1}, 0.3, 0.0)
    c = trigonometric.wave(angle, sine=False)
    s = trigonometric.wave(angle, sine=True)
    one = c * c + s * s - trigonometric.constant(1.0)
    assert one.bound() < 1e-13
    assert 0.99 < (c * s * trigonometric.constant(2.0)).bound() < 1.0 + 1e-12
    assert (c + trigonometric.constant(0.0, 0.01)).bound() == pytest.approx(1.01)


def test_exponents_that_leave_their_digit_are_refused():
    """32 q1 - q2 would be the constant 1: the exponent 32 is the digit 1 of the next joint."""
    with pytest.raises(TwinError, match="32 times a joint angle"):
        trigonometric.wave(AngleSum({0: 32, 1: -1}, 0.0, 0.0), sine=False)
    fast = trigonometric.wave(AngleSum({0: 9}, 0.0, 0.0), sine=True)
    zero = trigonometric.constant(0.0)
    column = trigonometric.stacked([[fast], [zero], [zero]])
    with pytest.raises(TwinError, match="exponent 18"):
        trigonometric.transposed(column).matrix_product(column)
    assert 1.0 <= length_bound(column, range(7, 12)) < 1.0 + 1e-9


def test_a_tolerance_of_a_length_that_only_a_passive_joint_needs_counts():
    """The pose does not contain `slide_up`; a passive slide does, and the mechanism's side uses the slide."""
    robot = twin.load("davinci_psm_si")
    formula = robot.formula

    def longer(q2, q3, slide_up):
        return -q2, q2, q3 / 2 + slide_up, q3 / 2

    equations = []
    for equation in formula.equations:
        known = equation.name == "bands"
        equations.append(replace(equation, variants={equation.default: longer}) if known else equation)
    changed = replace(formula, equations=tuple(equations))
    sliding = {}
    for joint in formula.joints:
        if joint.kind == "prismatic":
            sliding[joint.name] = chain.sliding_range(robot.mechanism, joint.name)
    _, joints = formula_chain.tool_pose(changed, variant_choice.choose(changed, None), sliding, {"slide_up": 1e-5})
    slide = joints["slide1"]
    assert isinstance(slide, TrigonometricSum)
    own = slide.exponents()[:, len(formula.joints)] != 0
    assert slide.centre[own].real.tolist() == [1e-5]


def test_a_long_frame_has_a_long_rounding():
    """The inverse of a frame at 1000 m is rounded by more than 4e-15 m; the radius says so."""
    first = twin.load("pa10").mechanism
    far = np.eye(4)
    far[:3, :3] = spatial.exp_so3([0.3, -1.1, 0.7])
    far[:3, 3] = 1000.0, -777.7, 333.3
    joints = list(first.joints)
    joints[2] = replace(joints[2], T_child_joint=far)
    pose = chain.tool_pose(replace(first, joints=tuple(joints)), _angles(first))
    assert pose.radius.max() > 1e-13


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sils", "no forward model"),
        ("hibou", r"no sum of sines and cosines of the joints \(sqrt\)"),
    ],
)
def test_what_has_no_bound_is_named(name, message):
    with pytest.raises(TwinError, match=message):
        chain_bounds(twin.load(name))


def test_bad_tolerances_are_named():
    for tolerance in (np.nan, -1e-6, np.inf):
        with pytest.raises(TwinError, match="tolerance of lengths is"):
            chain_bounds(twin.load("pa10"), tolerance=tolerance)


@pytest.mark.slow
def test_the_command_prints_the_bounds(tmp_path, capsys):
    options = ["--bounds", "--tolerance-um", "10", "--json", "--out", str(tmp_path / "out")]
    assert main(["prove", "pa10", *options]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["schema"] == "twin/prove-bounds/1"
    assert data["position_bound_mm"] == pytest.approx(0.04, rel=1e-3)
    assert main(["prove", "pa10", "--bounds", "--against", "pa10", "--json", "--out", str(tmp_path / "two")]) == 0
    assert json.loads(capsys.readouterr().out)["position_bound_mm"] < 1e-7  # rounding
    assert main(["prove", "pa10", "--bounds", "--against", "raven_left", "--out", str(tmp_path / "no")]) == 2
    assert "gives no value of joint" in capsys.readouterr().err
    assert main(["prove", "pa10", "--tolerance-um", "10"]) == 2
    assert "--tolerance-um needs --bounds or --workspace" in capsys.readouterr().err
