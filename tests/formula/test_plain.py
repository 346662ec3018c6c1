"""Plain formulas: what authors write in NumPy and CasADi is what is computed, compared with numbers and Pinocchio."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.core import spatial
from twin.formula import deg, if_else, mm, number
from twin.formula.lift import lifted_globals
from twin.formula.symbol import Symbol
from twin.kinematics import compile_formula
from twin.robots import load_formula
from twin.validation.explain.plain_values import SampledScalar, as_arrays

ROOT = Path(__file__).parents[2]


def compiled(text, joints, folder, home=None):
    path = Path(folder) / "formula.py"
    path.write_text(text, encoding="utf-8")
    T, q = home if home is not None else (np.eye(4), None)
    return compile_formula(load_formula(path, "own", lambda: (joints, T, q)))


# ------------------------------------------------------------------------------ what NumPy gives to symbols

ROWS = (
    "np.sin(x) + np.cos(y) * np.tan(x)",
    "np.arctan2(1, x) + np.arctan2(y, 2)",
    "np.arcsin(x / 4) - np.arccos(y / 4) + np.arctan(x)",
    "np.sqrt(x**2 + y**2) + np.hypot(x, 3) + np.exp(-x) + np.log(y)",
    "np.abs(x - y) + np.fabs(y - x) + abs(x)",
    "np.radians(x) + np.deg2rad(y) + np.degrees(x) + np.rad2deg(y)",
    "np.square(x) + np.power(y, 3) + x**0.5",
    "np.linalg.norm(np.array([x, y, 2.0]))",
    "np.linalg.norm([x, y, 2])",
    "np.linalg.norm(np.array([[x, y, 2.0], [1.0, x, y]]), axis=1)[1]",
    "np.cross([x, 0, 0], np.array([0, y, 1]))[2] + np.dot([x, 1], [2, y])",
    "(np.eye(3) @ np.array([x, y, 1]))[1] + np.array([x, 2.0]) @ np.array([y, 3.0])",
    "np.sin(np.array([x, 2.0, y])).sum() + np.mean([x, y])",
    "np.array([x, y], dtype=float)[0] + np.asarray([x, y], float)[1]",
    "np.where(x > y, x, y) + np.where(np.greater([1.0, 5.0], x), x, y)[1]",
    "np.maximum(x, y) + np.minimum(x, 2) + np.clip(x, 0.5, 1.2) + np.sign(x - y)",
    "if_else(x < y, x, 3.0) + if_else(2 > 1, 4.0, 5.0)",
    "filled(x, y)",
    "np.linalg.inv(np.array([[x, 1, 2], [y, 0, 1], [1, 1, x]]))[0, 1]",
    "np.linalg.solve(np.array([[x, 1], [1, y + 3]]), np.array([1.0, 2.0]))[0]",
    "np.linalg.det(np.array([[x, 1], [2, y]]))",
    "np.vstack([[x, y], [1, 2]])[1, 0] + np.hstack([x, y])[1] + np.concatenate([[x], [y, 1]])[2]",
    "np.trace(np.outer([x, y], [1, 2])) + np.einsum('i,i', np.array([x, y]), np.array([1.0, 2.0]))",
    "np.diag([x, y])[1, 1] + np.roll(np.array([x, y]), 1)[0] + np.prod([x, y]) + np.cumsum([x, y])[1]",
    "np.float64(2) * x - np.float64(3) / y + np.pi * x + np.ones(3)[0] * x",
    "math.sin(x) + math.atan2(1, y) + math.sqrt(2) + math.pi + math.acos(x / 4) + math.hypot(x, y)",
    "cosine(x) + root(2)",
    "(np.array([[x, y], [1, 2]]).T @ np.linalg.matrix_power(np.array([[x, 0], [0, 1]]), 2))[0, 0]",
)


def cosine_of_math():
    from math import cos, sqrt

    return cos, sqrt


def filled(x, y):
    R = np.zeros((2, 2))
    R[0, 0], R[1, 0] = x, 3
    v = np.zeros(2)
    v[1] = y
    return (R @ v)[1] + np.sin(R)[0, 0] + np.zeros(3)[0] + np.sin(np.zeros(2))[0]


HOME = {
    "np": np,
    "math": math,
    "if_else": if_else,
    "cosine": cosine_of_math()[0],
    "root": cosine_of_math()[1],
}


def home():
    """The globals of a file with these imports and this function."""
    out = dict(HOME)
    out["filled"] = type(filled)(filled.__code__, out, "filled")
    return out


@pytest.mark.parametrize("row", ROWS)
def test_symbols_and_samples_give_what_numbers_give(row):
    rng = np.random.default_rng(3)
    xs, ys = rng.uniform(0.3, 2.0, (2, 7))
    expected = [float(eval(row, home(), {"x": float(x), "y": float(y)})) for x, y in zip(xs, ys, strict=True)]
    lifted = lifted_globals(home())
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    f = ca.Function("f", [a, b], [eval(row, lifted, {"x": Symbol(a), "y": Symbol(b)}).x])
    np.testing.assert_allclose([float(f(x, y)) for x, y in zip(xs, ys, strict=True)], expected, rtol=1e-12)
    np.testing.assert_allclose(
        as_arrays(eval(row, lifted, {"x": SampledScalar(xs), "y": SampledScalar(ys)})), expected, rtol=1e-12
    )


# ------------------------------------------------------------------------------ files

HEXAPOD = (ROOT / "docs/examples/hexapod/formula.py").read_text(encoding="utf-8")
LEGS = [(f"q{i}", False) for i in range(1, 7)]
CASADI = '''
"""The same hexapod in CasADi."""
from casadi import cos, norm_2, pi, sin, vertcat
from twin.formula import deg, m
PARAMETERS = {"r_a": m(0.165), "h_a": m(0.03), "alpha": deg(18), "r_b": m(0.095), "h_b": m(0.034), "beta": deg(45)}


def inverse(pose, r_a, h_a, alpha, r_b, h_b, beta):
    out = []
    for leg in range(6):
        a, b = (2 * pi / 3 * (leg // 2) + (-1, 1)[leg % 2] * x for x in (alpha, beta))
        foot = vertcat(r_a * cos(a), r_a * sin(a), h_a)
        out.append(norm_2(pose[:3, 3] + pose[:3, :3] @ vertcat(r_b * cos(b), r_b * sin(b), -h_b) - foot))
    return vertcat(*out)
'''


def some_poses(count, middle=(0.0, 0.0, 0.304)):
    rng = np.random.default_rng(5)
    turns = spatial.exp_so3(rng.uniform(-0.2, 0.2, (count, 3)))
    return np.array([spatial.pose(R, middle + rng.uniform(-0.01, 0.01, 3)) for R in turns])


def test_numpy_and_casadi_styles_agree_and_go_forward(tmp_path):
    drawn = spatial.pose(np.eye(3), [0, 0, 0.304])
    one = compiled(HEXAPOD, LEGS, tmp_path, (drawn, None))
    (tmp_path / "other").mkdir()
    two = compiled(CASADI, LEGS, tmp_path / "other", (drawn, None))
    Ts = some_poses(20)
    np.testing.assert_allclose(one.inverse_many(Ts), two.inverse_many(Ts), atol=1e-15)
    for T in Ts[:4]:
        np.testing.assert_allclose(one.forward(one.inverse(T), drawn), T, atol=1e-11)
        np.testing.assert_allclose(one.forward(one.inverse(T)), T, atol=1e-9)  # begins as drawn
        J = two.jacobian(T)
        dq = 1e-6 * np.arange(1, 7)
        dx = two.forward(two.inverse(T) + dq, T)[:3, 3] - T[:3, 3]
        np.testing.assert_allclose(J[:3] @ dq, dx, atol=2e-10)


def test_parameters_are_in_si_and_can_be_replaced(tmp_path):
    text = HEXAPOD.replace('mm(165.0, "ASSUMED", "radius of', 'mm(165.0, "PUBLISHED", "Table 7, radius of')
    kin = compiled(text, LEGS, tmp_path)
    first = kin.formula.parameters[0]
    assert (first.name, first.unit, first.shown, first.provenance) == ("r_a", "mm", 165.0, "PUBLISHED")
    assert first.value == pytest.approx(0.165)
    assert kin.parameters["alpha"] == pytest.approx(np.radians(18))
    other = compile_formula(kin.formula, parameters={"r_a": 0.2})
    T = some_poses(1)[0]
    assert not np.allclose(other.inverse(T), kin.inverse(T))


def test_forward_alone_both_and_names_of_joints(tmp_path):
    arm = """
import math
from twin.formula import mm, pose, rotation_y, rotation_z
PARAMETERS = {"l1": mm(300), "l2": mm(200)}
def forward(q1, q2, q3, l1, l2):
    R = rotation_z(q1) @ rotation_y(q2)
    S = R @ rotation_y(q3)
    return pose(S, R @ [0, 0, l1] + S @ [0, 0, l2])
"""
    joints = [("q1", True), ("q2", True), ("q3", True)]
    kin = compiled(arm, joints, tmp_path, (np.eye(4), np.array([0.1, 0.2, 0.3])))
    q = np.array([0.3, 0.5, 0.7])
    T = kin.forward(q)
    assert T[2, 3] == pytest.approx(0.3 * np.cos(0.5) + 0.2 * np.cos(1.2))
    np.testing.assert_allclose(kin.forward(kin.inverse(T)), T, atol=1e-9)  # solved for
    (tmp_path / "both").mkdir()
    both = (
        arm
        + """
def inverse(x, y, z, theta, l1, l2):
    q1 = math.atan2(y, x)
    r = math.hypot(x, y) - l2 * math.sin(theta)
    q2 = math.atan2(r, z - l2 * math.cos(theta))
    return {"q3": theta - q2, "q1": q1, "q2": q2}
"""
    )
    closed = compiled(both, joints, tmp_path / "both")
    assert closed.closed_inverse
    assert closed.closed_forward
    np.testing.assert_allclose(closed.inverse(T), q, atol=1e-12)
    assert closed.formula.coordinates.names == ("x", "y", "z", "psi", "theta", "phi")


def test_names_of_the_robot_win_over_names_of_coordinates(tmp_path):
    text = "def inverse(pose):\n    return pose[0, 3], pose[1, 3], pose[2, 3]\n"
    kin = compiled(text, [("x", False), ("y", False), ("z", False)], tmp_path)
    assert kin.formula.coordinates.names[:3] == ("tool_x", "tool_y", "tool_z")
    np.testing.assert_allclose(kin.inverse(spatial.pose(np.eye(3), [1.0, 2.0, 3.0])), [1, 2, 3])


def test_points_are_named_and_inverse_may_start_from_them(tmp_path):
    chain = """
import numpy as np
from twin.formula import mm
PARAMETERS = {"w": mm(100)}
def points(pose, w):
    return {"left": pose[:3, 3] - w * pose[:3, 0], "right": pose[:3, 3] + w * pose[:3, 0]}
def inverse(left, right):
    return np.linalg.norm(left), np.linalg.norm(right)
"""
    joints = [("q1", False), ("q2", False)]
    kin = compiled(chain, joints, tmp_path)
    T = some_poses(1)[0]
    left = kin.points_many(T[None])["left"][0]
    np.testing.assert_allclose(left, T[:3, 3] - 0.1 * T[:3, 0])
    assert kin.inverse(T)[0] == pytest.approx(np.linalg.norm(left))
    given = {"left": [[3.0, 0, 4.0]], "right": [[0, 2.0, 0]]}
    np.testing.assert_allclose(kin.joints_from_points(given), [[5, 2]])
    (tmp_path / "after").mkdir()
    after = chain.replace("def points(pose, w)", "def points(pose, q, w)").replace(
        "inverse(left, right)", "inverse(pose)"
    )
    after = after.replace("norm(left)", "norm(pose[:3, 3])").replace("norm(right)", "norm(pose[:3, 0])")
    kin = compiled(after.replace("+ w *", "+ q[0] *"), joints, tmp_path / "after")
    reach = np.linalg.norm(T[:3, 3])
    np.testing.assert_allclose(kin.points_many(T[None])["right"][0], T[:3, 3] + reach * T[:3, 0])


def test_pose_at_a_right_angle_is_no_trouble(tmp_path):
    """Angles of Rz Ry Rx do not exist there; a formula of the pose does not need them."""
    text = "def inverse(pose):\n    return pose[0, 3], pose[0, 2]\n"
    kin = compiled(text, [("q1", False), ("q2", False)], tmp_path)
    T = spatial.pose(spatial.exp_so3(np.array([0, np.pi / 2, 0])), [0.1, 0, 0])
    np.testing.assert_allclose(kin.inverse(T), [0.1, 1.0])


def test_units_of_the_helpers():
    assert mm(135).value == pytest.approx(0.135)
    assert deg(180).value == pytest.approx(np.pi)
    assert number(3).value == 3


# ------------------------------------------------------------------------------ against Pinocchio

numbers = st.floats(-1, 1).map(lambda x: round(x, 3))


@st.composite
def arms(draw):
    count = draw(st.integers(1, 6))
    link = st.tuples(st.booleans(), st.lists(numbers, min_size=6, max_size=6), numbers)
    return [draw(link) for _ in range(count)]


@pytest.mark.slow
@given(arms())
@settings(deadline=None, max_examples=25)
def test_forward_of_random_arms_agrees_with_pinocchio(arm):
    rows = ["from math import cos, sin", "import numpy as np", "from twin.formula import pose, rotation_x, rotation_z"]
    rows += ["def forward(q):", "    T = np.eye(4)"]
    model = pin.Model()
    parent = 0
    for i, (angle, (a, b, c, x, y, z), _) in enumerate(arm):
        rows.append(f"    R = rotation_z({a}) @ rotation_x({b}) @ rotation_z({c})")
        rows.append(f"    T = T @ pose(R, [{x}, {y}, {z}])")
        rows.append(
            f"    T = T @ np.array([[cos(q[{i}]), -sin(q[{i}]), 0, 0], [sin(q[{i}]), cos(q[{i}]), 0, 0], "
            "[0, 0, 1, 0], [0, 0, 0, 1]])"
            if angle
            else f"    T = T @ pose(np.eye(3), [0, 0, q[{i}]])"
        )
        R = pin.utils.rotate("z", a) @ pin.utils.rotate("x", b) @ pin.utils.rotate("z", c)
        joint = pin.JointModelRZ() if angle else pin.JointModelPZ()
        parent = model.addJoint(parent, joint, pin.SE3(R, np.array([x, y, z])), f"q{i}")
    rows.append("    return T")
    data = model.createData()
    q = np.array([value for _, _, value in arm])
    pin.forwardKinematics(model, data, q)
    with tempfile.TemporaryDirectory() as folder:
        kin = compiled("\n".join(rows) + "\n", [(f"q{i}", a) for i, (a, _, _) in enumerate(arm)], folder)
    np.testing.assert_allclose(kin.forward(q), data.oMi[parent].homogeneous, atol=1e-14)
    pin.computeJointJacobians(model, data, q)
    J = np.reshape(pin.getJointJacobian(model, data, parent, pin.LOCAL_WORLD_ALIGNED), (6, -1))
    np.testing.assert_allclose(kin.jacobian(q=q), J, atol=1e-13)
