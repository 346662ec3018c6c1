"""SHER in numbers: both assemblies of its delta stage, and its Jacobian in closed form."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.spatial import Array
from twin.units import DEG

_U = np.array([[np.cos(a), np.sin(a)] for a in (60 * DEG, 180 * DEG, 300 * DEG)])


def platforms(q: Array, p: Mapping[str, float]) -> list[Array]:
    """Return the platform centres (3,) in m at slides q (3,): the upper solution, then the lower; none: empty.

    The points at distance l from three centres, on both sides of the plane through these.
    """
    c = np.column_stack([(p["r_b"] - p["r_p"]) * _U, q])
    d = np.linalg.norm(c[1] - c[0])
    e_x = (c[1] - c[0]) / d
    i = e_x @ (c[2] - c[0])
    e_y = c[2] - c[0] - i * e_x
    e_y /= np.linalg.norm(e_y)
    j = e_y @ (c[2] - c[0])
    X = d / 2
    Y = (i**2 + j**2 - 2 * i * X) / (2 * j)
    H2 = p["l"] ** 2 - X**2 - Y**2
    if H2 < 0:
        return []
    foot, up = c[0] + X * e_x + Y * e_y, np.sqrt(H2) * np.cross(e_x, e_y)
    return sorted((foot + up, foot - up), key=lambda r: -r[2])


def branches(q: Array, p: Mapping[str, float], variants: Mapping[str, str]) -> list[Array]:
    """Return T_base_tool (4, 4) of both assemblies at q (5,), the upper one first."""
    from twin.kinematics import compile_formula
    from twin.robots.sher import FORMULA

    centres = platforms(q[:3], p)
    if not centres:
        return []
    T = compile_formula(FORMULA, dict(variants), p).forward(q)
    out = []
    for r in centres:  # the rest of the chain is the same, moved with the platform
        moved = T.copy()
        moved[:3, 3] += r - centres[0]
        out.append(moved)
    return out


def tilt(s: float, p: Mapping[str, float]) -> dict[str, float]:
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


def _rods(q: Array, p: Mapping[str, float]) -> Array:
    centre = platforms(q[:3], p)[0]
    return centre - np.column_stack([(p["r_b"] - p["r_p"]) * _U, q[:3]])


def jacobian(q: Array, p: Mapping[str, float]) -> Array:
    """Return (6, 5): twist of P in {b}, linear rows first, per rate of q (5,)."""
    rods, t = _rods(q, p), tilt(q[4], p)
    c, s = np.cos(q[3]), np.sin(q[3])
    J = np.zeros((6, 5))
    J[:3, :3] = np.linalg.solve(rods, np.diag(rods[:, 2]))
    J[:, 3] = 0, -c * (t["P_y"] + p["d3"]), -s * (t["P_y"] + p["d3"]), 1, 0, 0
    J[:, 4] = t["dP_x"], -s * t["dP_y"], c * t["dP_y"], 0, -c * t["dth2"], -s * t["dth2"]
    return J


def left_inverse(q: Array, p: Mapping[str, float]) -> Array:
    """Return (5, 6): joint rates per twist of P in {b}.

    Eq. (4) of the paper inverts the 6x5 Jacobian, which has no inverse. What can be meant is a left inverse,
    exact for every twist that five joints can make: c_psi w_z = s_psi w_y. This is the one that reads the
    roll from w_x, the stroke from the turn about the linkage's pins, and the slides from the rest of v.
    """
    rods, J = _rods(q, p), jacobian(q, p)
    c, s = np.cos(q[3]), np.sin(q[3])
    out = np.zeros((5, 6))
    out[3, 3] = 1
    out[4, 4:] = -np.array([c, s]) / tilt(q[4], p)["dth2"]
    rest = np.hstack([np.eye(3), np.zeros((3, 3))]) - J[:3, 3:] @ out[3:]
    out[:3] = rods @ rest / rods[:, 2:]
    return out


def in_tool(T: Array, twist: Array) -> Array:
    """Return a twist (6,) given in {b} in the axes of the tool: both halves turned, as [A] prints it."""
    return np.concatenate([T[:3, :3].T @ twist[:3], T[:3, :3].T @ twist[3:]])


def reachable(q: Array, twist: Array) -> float:
    """Return what a twist (6,) in {b} asks of the sixth freedom, in rad/s: 0 for what the robot can do."""
    return float(np.cos(q[3]) * twist[5] - np.sin(q[3]) * twist[4])
