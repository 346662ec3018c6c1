"""SHER against the numbers that were published, at their printed precision, and against its derivation in numbers.

[A] is github.com/zhaob5/sher3-kinematics (MIT). Millimetres and degrees as printed.
"""

from __future__ import annotations

import numpy as np
import pytest

from twin.core.units import DEG, MM
from twin.kinematics import compile_formula
from twin.robots import load_formula
from twin.robots.sher import platforms

SCALE = np.array([MM, MM, MM, DEG, MM])
U = np.array([[np.cos(a), np.sin(a)] for a in (60 * DEG, 180 * DEG, 300 * DEG)])


@pytest.fixture(scope="module")
def kin():
    return compile_formula(load_formula("sher"))


def tool(kin, *q):
    """Return P in mm and the direction of the tool at joints in mm and deg."""
    T = kin.forward(np.array(q) * SCALE)
    return T[:3, 3] / MM, -T[:3, 1]


def states(kin, count):
    rng = np.random.default_rng(11)
    r = rng.uniform([-18, -18, 70], [18, 18, 150], (count, 3))
    rho = kin.parameters["r_b"] - kin.parameters["r_p"]
    lateral = r[:, None, :2] * MM - rho * U
    q = r[:, 2:] * MM - np.sqrt(kin.parameters["l"] ** 2 - (lateral**2).sum(axis=2))
    return np.column_stack([q, rng.uniform(-80, 80, count) * DEG, rng.uniform(1, 49, count) * MM]), r * MM


# -- closed forms


def tilt_of(s: float, p: dict[str, float]) -> dict[str, float]:
    """Return angles in rad and P in {a} in m at the stroke s in m, and their derivatives by s ([A], rates).

    th1, th2, P_x, P_y and dth1, dth2, dP_x, dP_y.
    """
    x = p["x_max"] - s
    L = np.hypot(x, p["y_AR"])
    al = np.arccos((L**2 + p["AQ"] ** 2 - p["QR"] ** 2) / (2 * L * p["AQ"])) + np.arctan2(p["y_AR"], x)
    th1 = np.pi - p["phi2"] - al
    BD = np.sqrt(p["AB"] ** 2 + p["DA"] ** 2 - 2 * p["AB"] * p["DA"] * np.cos(p["phi1"] - th1))
    b1 = np.arccos((p["AB"] ** 2 + BD**2 - p["DA"] ** 2) / (2 * p["AB"] * BD))
    de = np.arccos((p["CD"] ** 2 + BD**2 - p["BC"] ** 2) / (2 * p["CD"] * BD))
    th2 = p["phi1"] + b1 - de
    be = b1 + np.arccos((p["BC"] ** 2 + BD**2 - p["CD"] ** 2) / (2 * p["BC"] * BD))
    a1 = p["phi1"] - th1
    L_JR, L_JQ = x * np.tan(al) - p["y_AR"], x / np.cos(al) - p["AQ"]
    L_ID = p["AB"] * np.sin(be) / np.sin(a1 + be) - p["DA"]
    dth1 = -L_JQ / (p["AQ"] * L_JR)
    dth2 = p["DA"] * L_JQ / (L_ID * p["AQ"] * L_JR)
    g = th2 - p["phi3"]
    return {
        "th1": th1,
        "th2": th2,
        "P_x": p["DA"] * np.cos(th1) + p["DP"] * np.cos(g),
        "P_y": p["DA"] * np.sin(th1) + p["DP"] * np.sin(g),
        "dth1": dth1,
        "dth2": dth2,
        "dP_x": -p["DA"] * np.sin(th1) * dth1 - p["DP"] * np.sin(g) * dth2,
        "dP_y": p["DA"] * np.cos(th1) * dth1 + p["DP"] * np.cos(g) * dth2,
    }


def _rods(q: np.ndarray, p: dict[str, float]) -> np.ndarray:
    centre = platforms(q[:3], p)[0]
    return centre - np.column_stack([(p["r_b"] - p["r_p"]) * U, q[:3]])


def jacobian(q: np.ndarray, p: dict[str, float]) -> np.ndarray:
    """Return (6, 5): twist of P in {b}, linear rows first, per rate of q (5,)."""
    rods, t = _rods(q, p), tilt_of(q[4], p)
    c, s = np.cos(q[3]), np.sin(q[3])
    J = np.zeros((6, 5))
    J[:3, :3] = np.linalg.solve(rods, np.diag(rods[:, 2]))
    J[:, 3] = 0, -c * (t["P_y"] + p["d3"]), -s * (t["P_y"] + p["d3"]), 1, 0, 0
    J[:, 4] = t["dP_x"], -s * t["dP_y"], c * t["dP_y"], 0, -c * t["dth2"], -s * t["dth2"]
    return J


def left_inverse(q: np.ndarray, p: dict[str, float]) -> np.ndarray:
    """Return (5, 6): joint rates per twist of P in {b}.

    Eq. (4) of the paper inverts the 6x5 Jacobian, which has no inverse. What can be meant is a left inverse,
    exact for every twist that five joints can make: c_psi w_z = s_psi w_y. This is the one that reads the
    roll from w_x, the stroke from the turn about the linkage's pins, and the slides from the rest of v.
    """
    rods, J = _rods(q, p), jacobian(q, p)
    c, s = np.cos(q[3]), np.sin(q[3])
    out = np.zeros((5, 6))
    out[3, 3] = 1
    out[4, 4:] = -np.array([c, s]) / tilt_of(q[4], p)["dth2"]
    rest = np.hstack([np.eye(3), np.zeros((3, 3))]) - J[:3, 3:] @ out[3:]
    out[:3] = rods @ rest / rods[:, 2:]
    return out


def in_tool(T: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Return a twist (6,) given in {b} in the axes of the tool: both halves turned, as [A] prints it."""
    return np.concatenate([T[:3, :3].T @ twist[:3], T[:3, :3].T @ twist[3:]])


def reachable(q: np.ndarray, twist: np.ndarray) -> float:
    """Return what a twist (6,) in {b} asks of the sixth freedom, in rad/s: 0 for what the robot can do."""
    return float(np.cos(q[3]) * twist[5] - np.sin(q[3]) * twist[4])


# -- [A]: velocity example, scripts and SolidWorks motion study ---------------------------------------------


def test_velocity_example_of_the_script_and_of_the_motion_study(kin):
    q = np.array([1, 2, 3, 30, 10]) * SCALE
    V = kin.jacobian(q=q) @ (np.array([4, 5, 6, 6, 10]) * SCALE)
    v, w = V[:3] / MM, V[3:] / DEG
    np.testing.assert_allclose(v, [6.87802679, 4.93238197, 5.28504435], atol=1e-6)
    np.testing.assert_allclose(w, [6, -8.14832999, -4.70444052], atol=1e-6)
    turned = in_tool(kin.forward(q), V)
    np.testing.assert_allclose(turned[:3] / MM, [6.97252563, -1.77386034, -6.91409027], atol=1e-6)
    np.testing.assert_allclose(turned[3:] / DEG, [5.12488415, -3.12018628, 9.40888104], atol=1e-6)
    # Read off a plot: one unit of the last digit, except w_y (0.05 off) and w_z (0.014 off).
    assert (np.abs(v - [6.9, 4.93, 5.29]) <= [0.1, 0.01, 0.01]).all()
    assert (np.abs(w - [6, -8.1, -4.69]) <= [0.1, 0.06, 0.02]).all()


# -- [A]: examples of the delta stage and of the tilt -------------------------------------------------------


def test_inverse_of_the_delta_stage(kin):
    """Label z = 205.8 lost a digit: the printed slides belong to 205.85, to their last digit."""
    p = kin.parameters
    for z, want in ((205.85, [139.81, 158.95, 146.50]), (205.8, [139.764, 158.900, 146.449])):
        r = np.array([22.15, 9.23, z]) * MM
        T = kin.forward(np.array([50, 50, 50, 0, 20]) * SCALE)
        T[:3, 3] += r - [0, 0, 50 * MM + np.sqrt(p["l"] ** 2 - (p["r_b"] - p["r_p"]) ** 2)]
        np.testing.assert_allclose(kin.inverse(T)[:3] / MM, want, atol=0.005)


@pytest.mark.parametrize(
    ("q", "want", "within"),
    [
        ((67.4, 84.6, 81), (15.43, 18.20, 135.20), 0.1),  # printed; its labels are rounded
        ((67.4, 84.6, 81), (15.3506, 18.2761, 135.2187), 1e-4),
        ((40, 50, 60), (1.27151725, 25.07138615, 106.92007534), 1e-8),
        ((50, 50, 50), (0, 0, 112.743548), 1e-6),
        ((0, 0, 0), (0, 0, 62.743548), 1e-6),
    ],
)
def test_forward_of_the_delta_stage(kin, q, want, within):
    state = np.array([[*q, 0, 20]]) * SCALE
    np.testing.assert_allclose(
        kin.points_many(qs=state, Ts=kin.forward_many(state))["platform"][0] / MM, want, atol=within
    )
    np.testing.assert_allclose(platforms(state[0, :3], kin.parameters)[0] / MM, want, atol=within)


def test_both_assemblies_of_the_delta_stage_are_named(kin):
    q = np.array([40, 50, 60, 10, 20]) * SCALE
    upper, lower = kin.branches(q)
    np.testing.assert_allclose(upper, kin.forward(q), atol=1e-15)
    assert lower[2, 3] < upper[2, 3] - 50 * MM
    for T in (upper, lower):  # every rod has its length in both
        centre = T[:3, 3] - upper[:3, 3] + kin.points_many(Ts=upper[None])["platform"][0]
        c = np.column_stack([26.2154 * MM * U, q[:3]])
        np.testing.assert_allclose(np.linalg.norm(centre - c, axis=1), 68 * MM, atol=1e-14)


@pytest.mark.parametrize(
    ("s", "tilt", "P"),
    [
        (0, 109.609, (145.153, -45.439)),
        (10, 121.334, (157.213, -45.499)),
        (20, 129.802, (161.223, -45.968)),
        (20.25077, 130.0, (161.2650, -45.9652)),
        (30, 137.647, (161.291, -44.812)),
        (40, 146.458, (158.512, -40.037)),
        (50, 159.148, (152.254, -26.735)),
    ],
)
def test_tilt_linkage(kin, s, tilt, P):
    p, n = tool(kin, 50, 50, 50, 0, s)
    np.testing.assert_allclose(p[[0, 2]] - [192.7, 112.743548 + 56.01 + 25.5], P, atol=6e-4)
    assert np.arctan2(n[0], -n[2]) / DEG + 90 == pytest.approx(tilt, abs=6e-4)


def test_printed_ends_of_the_tilt(kin):
    """Printed: P = (145.2, -45.4) mm at s = 0; s = 20.3, P = (161.3, -46.0) at a tilt of 130 deg."""
    low = tool(kin, 50, 50, 50, 0, 0)[0]
    np.testing.assert_allclose([low[0] - 192.7, low[2] - 194.253548], [145.2, -45.4], atol=0.05)
    T = kin.program.pose_of_coordinates.one(np.array([0.35, 0, 0.15, 0, 40 * DEG]))
    assert kin.inverse(T)[4] / MM == pytest.approx(20.3, abs=0.05)


def test_rail_above_a_as_drawn_does_not_give_the_published_point(kin):
    drawn = compile_formula(kin.formula, {"tilt_forward": "drawn", "tilt_inverse": "drawn"})
    p, _ = tool(drawn, 50, 50, 50, 0, 0)
    np.testing.assert_allclose([p[0] - 192.7, p[2] - 194.253548], [160.10, -45.87], atol=0.01)


@pytest.mark.parametrize(
    ("q", "p", "n"),
    [
        ((50, 50, 50, 0, 0), (337.8534, 0, 148.8150), (0.33560, 0, -0.94201)),
        ((50, 50, 50, 0, 25), (354.3458, 0, 148.5596), (0.69096, 0, -0.72289)),
        ((50, 50, 50, 30, 10), (349.9131, 9.9993, 151.4342), (0.52003, 0.42707, -0.73971)),
        ((50, 50, 50, -30, 40), (351.2123, -7.2686, 156.1639), (0.83348, -0.27628, -0.47852)),
        ((1, 2, 3, 30, 10), (349.925785, 12.760058, 103.368122), (0.52003, 0.42707, -0.73971)),
    ],
)
def test_whole_chain(kin, q, p, n):
    got_p, got_n = tool(kin, *q)
    np.testing.assert_allclose(got_p, p, atol=6e-5)
    np.testing.assert_allclose(got_n, n, atol=6e-6)


# -- Jacobian: closed form, CasADi, differences -------------------------------------------------------------


def test_round_trip_over_the_workspace(kin):
    q, r = states(kin, 5000)
    T = kin.forward_many(q)
    assert np.abs(kin.inverse_many(T) - q).max() < 1e-12
    assert np.abs(kin.points_many(Ts=T)["platform"] - r).max() < 1e-12


def test_closed_jacobian_equals_the_derivatives(kin):
    q, _ = states(kin, 300)
    J = kin.jacobian_many(qs=q)
    for row, j in zip(q, J, strict=True):
        written = jacobian(row, kin.parameters)
        assert np.abs(written - j).max() < 1e-11 * max(1, np.abs(j).max())
        back = left_inverse(row, kin.parameters)
        assert np.abs(back @ j - np.eye(5)).max() < 1e-11
        twist = j @ np.array([0.003, -0.002, 0.004, 0.2, 0.005])
        assert np.abs(j @ (back @ twist) - twist).max() < 1e-13  # consistent on what five joints can do
        assert abs(reachable(row, twist)) < 1e-13


def test_jacobian_against_differences_of_fourth_order(kin):
    q, _ = states(kin, 200)
    J = kin.jacobian_many(qs=q)
    h, worst = 1e-4, 0.0
    for i in range(5):
        step = h * np.eye(5)[i] * (1.0 if i == 3 else 0.1)
        T = {k: kin.forward_many(q + k * step) for k in (-2, -1, 1, 2)}
        width = np.linalg.norm(step)
        slope = (8 * (T[1] - T[-1]) - (T[2] - T[-2])) / (12 * width)
        W = slope[:, :3, :3] @ np.swapaxes(kin.forward_many(q)[:, :3, :3], 1, 2)
        spin = np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=1)
        want = np.concatenate([slope[:, :3, 3], spin], axis=1)
        worst = max(worst, float((np.abs(J[:, :, i] - want).max(axis=1) / np.abs(want).max(axis=1)).max()))
    assert worst <= 1e-7


def test_published_jacobian_rows(kin):
    J = kin.jacobian(q=np.array([1, 2, 3, 30, 10]) * SCALE)
    np.testing.assert_allclose(J[0], [-0.8097, 1.5939, -0.7842, 0, 0.6853], atol=6e-5)
    np.testing.assert_allclose(J[1] / [1, 1, 1, MM, 1], [-1.3848, 0.0146, 1.3701, 17.3193, 0.0364], atol=6e-5)
    np.testing.assert_allclose(J[2] / [1, 1, 1, MM, 1], [0.3998, 0.3324, 0.2678, 9.9993, -0.0630], atol=6e-5)
    np.testing.assert_allclose(J[3:, 4] * MM, [0, -0.0142, -0.0082], atol=6e-5)


def test_a_twist_about_the_tool_is_out_of_reach(kin):
    q = np.array([50, 50, 50, 0, 20]) * SCALE
    T = kin.forward(q)
    twist = np.concatenate([np.zeros(3), -T[:3, 1]])
    assert abs(reachable(q, twist)) > 0.5
    J, back = kin.jacobian(q=q), left_inverse(q, kin.parameters)
    assert np.abs(J @ (back @ twist) - twist).max() > 0.1
