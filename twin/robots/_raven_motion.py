"""Published equations of motion of shoulder, elbow and insertion of the Raven-II, without rotors and friction.

CSLDepend/raven2_sim contains the equations as a long closed form. This form describes exactly three rigid bodies, moved
by the first three joints of the table in `_raven`, with gravity along -x of frame 0. The form is linear in the 30
inertial parameters of the bodies and determines 14 combinations of these (residual 5e-10). The parameters below are the
solution of smallest norm: the three bodies together move like the arm, but the single bodies are not physical. The
parameters are rounded, which changes M by at most 2e-6 and g by at most 7e-6. The closed form describes the left arm.
The right arm is the mirror image of the left arm; its M, C and g are the same functions of the joints.

M and g are computed from the Jacobians of the links (R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to
Robotic Manipulation, CRC Press 1994, section 4.3), C from the Christoffel symbols of M.
"""

from __future__ import annotations

import casadi as ca
from casadi import jacobian, pi, reshape, skew, vertcat

from twin.core.provenance import Parameter
from twin.formula.closed_form import ClosedForm
from twin.robots._authoring import row

_DEG = pi / 180
_SOURCE = "CSLDepend/raven2_sim, dynamics of joints 1 to 3"
_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
_UNITS = ("kg", "kg m", "kg m", "kg m", *["kg m2"] * 6)
_LINKS = {  # mass, first moment of mass, inertia about the origin of the link's frame
    "link1": (0, 0.00361, 0.110148, 0, 0, 0, 0, 0, 0, 0.06684),
    "link2": (0, -0.00309, -0.129524, -0.106395, 0.044066, 0.000094, 0.000029, 0.018296, 0.005402, 0.028733),
    "link3": (0.407, -0.007613, -0.000061, -0.00021, 0.022156, 0.000035, -0.011433, 0.044066, 0.000093, 0.024873),
}
_COMPENSATION = {  # mass and mass centre in the link's frame
    "link1": (0.494, 0.0065, 0.09775, -0.13771),
    "link2": (0.750, -0.002, -0.18274, -0.23053),
    "link3": (0.231, 0, 0, 0),
}


def terms(q, qd, p):
    """Return M (3, 3), C (3, 3) and g (3,) at joints q (3,) and rates qd (3,); p: {name: inertial parameter}."""
    T_01 = row(0, 0, q[0] + 205 * _DEG, 0)
    T_02 = T_01 @ row(75 * _DEG, 0, q[1] + 180 * _DEG, 0)
    T_03 = T_02 @ row(128 * _DEG, 0, 90 * _DEG, q[2])
    gravity = vertcat(-9.81, 0, 0)
    M = ca.SX.zeros(3, 3)
    V = 0  # potential energy
    for link, T in zip(_LINKS, (T_01, T_02, T_03), strict=True):
        m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz = [p[f"{link}.{name}"] for name in _NAMES]
        R = T[0:3, 0:3]
        o = T[0:3, 3]
        mc = vertcat(mx, my, mz)
        I_o = ca.blockcat([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
        Jv = R.T @ jacobian(o, q)
        Jw = _angular_jacobian(R, q)
        # The origin of the link is not its mass centre: its first moment couples translation and rotation.
        coupling = Jv.T @ skew(mc) @ Jw
        M += m * Jv.T @ Jv - coupling - coupling.T + Jw.T @ I_o @ Jw
        V -= ca.dot(gravity, m * o + R @ mc)
    return M, christoffel(M, q, qd), ca.gradient(V, q)


def _angular_jacobian(R, q):
    """Return the Jacobian (3, 3) from joint rates to the angular velocity of the link with rotation R, in link axes."""
    columns = []
    for i in range(3):
        S = R.T @ reshape(jacobian(reshape(R, 9, 1), q[i]), 3, 3)
        columns.append(vertcat(S[2, 1], S[0, 2], S[1, 0]))
    return ca.horzcat(*columns)


def christoffel(M, q, qd):
    """Return C (3, 3) from the Christoffel symbols of M."""
    dM_dq = [reshape(jacobian(reshape(M, 9, 1), q[k]), 3, 3) for k in range(3)]
    C = ca.SX.zeros(3, 3)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] += 0.5 * (dM_dq[k][i, j] + dM_dq[j][i, k] - dM_dq[i][j, k]) * qd[k]
    return C


def _parameters(link, values, provenance, note):
    """Return the ten inertial parameters of a link; they are in SI units, in the order of `_NAMES`."""
    parameters = []
    for name, unit, value in zip(_NAMES, _UNITS, values, strict=True):
        parameters.append(Parameter(f"{link}.{name}", float(value), unit, float(value), provenance, note))
    return parameters


def _point_masses():
    parameters = []
    note = "uw-biorobotics/raven2, gravity compensation: mass times mass centre"
    for link, (m, x, y, z) in _COMPENSATION.items():
        values = (m, m * x, m * y, m * z, 0, 0, 0, 0, 0, 0)
        parameters += _parameters(link, values, "CITED", note)
    return tuple(parameters)


def _bodies():
    parameters = []
    for link, values in _LINKS.items():
        parameters += _parameters(link, values, "DERIVED", f"{_SOURCE}: smallest norm")
    return tuple(parameters)


COMPENSATION = _point_masses()
"""Point masses of the gravity compensation in the released software; they differ from those of the closed form."""

MOTION = ClosedForm(
    source=_SOURCE,
    joints=("shoulder", "elbow", "insertion"),
    parameters=_bodies(),
    tolerance=1e-5,  # M and g change by the rounding of the parameters
    terms=terms,
)
