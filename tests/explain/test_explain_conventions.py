"""Conventions: Euler sequences, units, signs, axes, hands, Denavit-Hartenberg forms."""

from __future__ import annotations

import types
from dataclasses import replace

import numpy as np
import pytest
from casadi import cos, pi, sin, sqrt, vertcat
from hypothesis import given, settings
from hypothesis import strategies as st

from made.formulas import replaced
from twin import api
from twin.core import spatial
from twin.formula import symbolic
from twin.robots import _authoring, load_formula
from twin.validation.explain.conventions import (
    AXIS_SEQUENCES,
    _offset_and_residual,
    _scalar_outputs,
    conventions,
)
from twin.validation.explain.denavit_hartenberg import dh_form
from twin.validation.explain.judged_states import sampled_values
from twin.validation.explain.rebuilt_functions import Matrix, Rebuilder, is_of_formula
from twin.validation.explain.row_deviations import Judge


@pytest.fixture(scope="module")
def sils(sils_model):
    formula = load_formula("sils")
    return formula, sampled_values(formula, sils_model)


@pytest.fixture(scope="module")
def pa10():
    formula = load_formula("pa10")
    return formula, sampled_values(formula, api.load("pa10").reference())


def turn(axis, a):
    f = {"x": symbolic.rotation_x, "y": symbolic.rotation_y, "z": symbolic.rotation_z}[axis]
    return np.array(__import__("casadi").DM(f(float(a))))


@settings(deadline=None, max_examples=40)
@given(st.sampled_from(AXIS_SEQUENCES), st.floats(-3, 3), st.floats(0.1, 1.4), st.floats(-3, 3))
def test_angles_of_every_sequence(order, a, b, c):
    R = turn(order[0], a) @ turn(order[1], b) @ turn(order[2], c)
    got = spatial.euler_angles(R[None], order)[0]
    again = turn(order[0], got[0]) @ turn(order[1], got[1]) @ turn(order[2], got[2])
    np.testing.assert_allclose(again, R, atol=1e-12)


@pytest.mark.slow
def test_another_euler_sequence(sils):
    formula, reference = sils
    a, b, c = spatial.euler_angles(reference.Ts[:, :3, :3], "xyz").T
    other = replace(reference, symbols={**reference.symbols, "phi": a, "theta": b, "psi": c})
    found = conventions(Judge(formula, None, other))
    assert found[0].kind == "euler"
    assert "Rz(psi) Ry(theta) Rx(phi)" in found[0].message


def eq1_degrees(X_E, Y_E, Z_E, psi, theta, phi, l_p):
    c_psi, c_theta, c_phi = cos(psi * pi / 180), cos(theta * pi / 180), cos(phi * pi / 180)
    s_psi, s_theta, s_phi = sin(psi * pi / 180), sin(theta * pi / 180), sin(phi * pi / 180)
    a, b = sqrt(3) / 6 * l_p, l_p / 2
    R = (
        (c_psi * c_theta, c_psi * s_theta * s_phi - s_psi * c_phi),
        (s_psi * c_theta, s_psi * s_theta * s_phi + c_psi * c_phi),
        (-s_theta, c_theta * s_phi),
    )
    E = (X_E, Y_E, Z_E)
    S = [tuple(E[i] + x * R[i][0] + y * R[i][1] for i in range(3)) for x, y in ((a, -b), (-2 * a, 0), (a, b))]
    return *S[0], *S[1], *S[2]


def eq1_mirrored(X_E, Y_E, Z_E, psi, theta, phi, l_p):
    S = eq1_degrees(X_E, Y_E, Z_E, psi * 180 / pi, theta * 180 / pi, phi * 180 / pi, l_p)
    return S[0], -S[1], S[2], S[3], -S[4], S[5], S[6], -S[7], S[8]


@pytest.mark.slow
def test_degrees(sils):
    formula, reference = sils
    found = conventions(Judge(replaced(formula, "eq1", eq1_degrees), None, reference))
    assert any(c.kind == "unit" and "degrees" in c.message for c in found)


@pytest.mark.slow
def test_a_left_handed_frame(sils):
    formula, reference = sils
    found = conventions(Judge(replaced(formula, "eq1", eq1_mirrored), None, reference))
    hand = next(c for c in found if c.kind == "handedness")
    assert "y = -y" in hand.message
    assert "x = x" in hand.message


@pytest.mark.slow
def test_sign_and_zero_of_a_joint(sils):
    formula, reference = sils
    rows = {"rf1": reference.symbols["rf1"] + 0.1}
    found = conventions(Judge(formula, None, replace(reference, symbols={**reference.symbols, **rows})))
    assert any("its zero position differs by -5.72958°" in c.message for c in found)
    found = conventions(
        Judge(formula, None, replace(reference, symbols={**reference.symbols, "rf2": -reference.symbols["rf2"]}))
    )
    assert any(c.kind == "sign" and "rf2" in c.message for c in found)


def scalar_messages(sils, symbol, slope, offset):
    """Return (kind, message) of the conventions of one output that the formula gives as slope * value + offset."""
    formula, reference = sils
    stated = reference.symbols[symbol]  # the formula agrees with this value
    true = (stated - offset) / slope
    judge = Judge(formula, None, replace(reference, symbols={**reference.symbols, symbol: true}))
    found = []
    with np.errstate(all="ignore"):
        for convention in _scalar_outputs(judge):
            if convention.message.startswith(f"{symbol}:"):
                found.append((convention.kind, convention.message))
    return found


def test_an_output_in_degrees(sils):
    text = "rf1: degrees instead of radians"
    assert scalar_messages(sils, "rf1", 180 / np.pi, 0.0) == [("unit", text)]
    # The offset is known modulo 2 pi degrees only, so that no size is stated.
    [(kind, message)] = scalar_messages(sils, "rf1", 180 / np.pi, 20.0)
    assert kind == "unit"
    assert message == f"{text} and its zero position differs from the zero position in the mechanism"


def test_an_offset_is_in_the_unit_of_the_mechanism():
    true = np.linspace(0.1, 0.4, 5)
    offset, after = _offset_and_residual(1e3 * true + 5.0, true, 1e3, is_angle=False, tolerance=1e-9)
    assert offset == pytest.approx(5e-3)
    assert after <= 1
    # full turns, in the formula's unit, are lost before the comparison
    degrees = np.degrees(np.linspace(-2.0, 2.0, 7))
    recovered = degrees - 2 * np.pi * np.array([3, -1, 0, 2, 5, -4, 1])
    offset, after = _offset_and_residual(recovered, np.radians(degrees), 180 / np.pi, is_angle=True, tolerance=1e-9)
    assert abs(offset) < 1e-12
    assert after <= 1


def standard(alpha, d, theta, r):
    """One row in the standard form."""
    c = symbolic.rotation_z(theta)
    return symbolic.pose(c, vertcat(0, 0, r)) @ symbolic.pose(symbolic.rotation_x(alpha), vertcat(d, 0, 0))


def table1_standard(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
    T = standard(0, 0, q1, 0) @ standard(-pi / 2, 0, q2, 0) @ standard(pi / 2, 0, q3, RL3)
    T = T @ standard(-pi / 2, 0, q4, 0) @ standard(pi / 2, 0, q5, RL5) @ standard(-pi / 2, 0, q6, 0)
    return T @ standard(pi / 2, 0, q7, RL7) @ standard(0, 0, 0, RL8)


def table1_turned(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
    T = _authoring.row(0, 0, q1, 0) @ _authoring.row(-pi / 2, 0, q2, 0) @ _authoring.row(pi / 2, 0, q3, RL3)
    T = T @ _authoring.row(-pi / 2, 0, q4, 0) @ _authoring.row(pi / 2, 0, q5, RL5) @ _authoring.row(-pi / 2, 0, q6, 0)
    T = T @ _authoring.row(pi / 2, 0, q7, RL7) @ _authoring.row(0, 0, 0, RL8)
    return symbolic.pose(symbolic.rotation_x(pi / 2), vertcat(0, 0, 0)) @ T


def test_the_form_of_a_row_is_recognised():
    rebuild = Rebuilder()
    assert dh_form(rebuild.function(_authoring.row)) == ("modified", (0, 1, 2, 3))
    assert dh_form(rebuild.function(standard)) == ("standard", (0, 1, 2, 3))
    assert dh_form(rebuild.function(lambda a, b, c, d: Matrix(np.eye(4)[None]))) is None


def test_an_installed_twin_rebuilds_its_own_functions():
    """A wheel lies in site-packages, as the libraries do that run unchanged."""
    f = _authoring.row
    code = f.__code__.replace(co_filename="/venv/lib/python3.11/site-packages/twin/robots/_authoring.py")
    installed = types.FunctionType(code, f.__globals__, f.__name__, f.__defaults__, f.__closure__)
    rebuilt = Rebuilder().value(installed)
    assert rebuilt is not installed
    assert dh_form(rebuilt) == ("modified", (0, 1, 2, 3))


@pytest.mark.parametrize("folder", ["kinematics", "formula"])
def test_helpers_are_found_whatever_the_folder_of_a_robot_is_called(folder, tmp_path):
    path = tmp_path / folder / "formula.py"
    path.parent.mkdir()
    path.write_text("def half(x):\n    return x / 2\n")
    space = {}
    exec(compile(path.read_text(), path, "exec"), space)
    assert is_of_formula(space["half"])
    assert is_of_formula(_authoring.row)
    assert not is_of_formula(symbolic.pose)


@pytest.mark.slow
def test_a_table_multiplied_in_the_other_form(pa10):
    formula, reference = pa10
    found = conventions(Judge(replaced(formula, "table1", table1_standard), None, reference))
    (dh,) = [c for c in found if c.kind == "dh"]
    assert "standard Denavit-Hartenberg form" in dh.message
    assert dh.rows == ("table1.T_base_tool",)


@pytest.mark.slow
def test_a_base_that_lies_on_its_side(pa10):
    formula, reference = pa10
    found = conventions(Judge(replaced(formula, "table1", table1_turned), None, reference))
    assert any(c.kind == "axes" and "base axes" in c.message for c in found)


@pytest.mark.slow
def test_no_convention_is_found_where_all_is_well(sils, pa10):
    for formula, reference in (sils, pa10):
        assert conventions(Judge(formula, None, reference)) == []
