"""Symbolic equations of motion of a mechanism without loops, for compilation: M(q) qdd + b(q, qd) = joint efforts.

Newton-Euler recursion in the axes of base (R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, chapter 5).
M is the derivative of the efforts with respect to the accelerations. The tests compare the equations with
`twin.reference.dynamics`, which shares no code with this file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference.dynamics import Dynamics


@dataclass(frozen=True)
class MotionEquations:
    """Symbols and terms of the equations of motion for n active joints and m tree joints.

    Attributes:
        q, qd: symbols (n,) of joint values and rates.
        factors: symbols (m,), one for each tree joint; a factor multiplies mass and inertia tensor of the joint's body.
        fall: symbol (3,) of the gravitational acceleration in base, m/s2.
        M: (n, n) mass matrix, without rotors.
        b: (n,) Coriolis and centrifugal efforts, and gravity.
    """

    q: Any
    qd: Any
    factors: Any
    fall: Any
    M: Any
    b: Any


@dataclass
class _BodyMotion:
    """Motion of a body: pose (R, p); angular velocity w; its derivative `turn`; a: origin's acceleration - gravity."""

    R: Any
    p: Any
    w: Any
    turn: Any
    a: Any


def motion(mechanism: Mechanism) -> MotionEquations:
    """Return the equations of motion of a mechanism without loops; its passive joints follow active ones by couplings.

    Raises:
        MechanismError: the mechanism has loops.
    """
    if mechanism.loops:
        raise MechanismError(f"{mechanism.name} has loops: a machine needs a mechanism without loops")
    n = len(mechanism.active)
    joints = mechanism.tree
    q = ca.SX.sym("q", n)
    qd = ca.SX.sym("qd", n)
    qdd = ca.SX.sym("qdd", n)
    factors = ca.SX.sym("factors", len(joints))
    fall = ca.SX.sym("fall", 3)
    x0, S = _coordinates(mechanism)
    x = ca.DM(x0) + ca.DM(S) @ q
    xd = ca.DM(S) @ qd
    xdd = ca.DM(S) @ qdd
    # The base accelerates upwards instead of a weight on each body (Featherstone, section 5.3).
    base = _BodyMotion(ca.DM.eye(3), ca.DM.zeros(3), ca.DM.zeros(3), ca.DM.zeros(3), -fall)
    motions = {mechanism.base: base}
    axes = {}
    # Forces and moments that accelerate the bodies, about the origin of base.
    inertias: dict[str, Inertia | None] = {}
    forces = {}
    moments = {}
    for body in mechanism.bodies:
        inertias[body.name] = body.inertia
        forces[body.name] = ca.SX.zeros(3)
        moments[body.name] = ca.SX.zeros(3)
    for i, joint in enumerate(joints):
        z, p, body = _across(joint, motions[joint.parent], x[i], xd[i], xdd[i])
        axes[joint.name] = z, p
        motions[joint.child] = body
        inertia = inertias[joint.child]
        if inertia is not None:
            com = body.R @ inertia.p_body_com
            I_base = body.R @ ca.DM(inertia.I_com) @ body.R.T
            F = factors[i] * inertia.mass * (body.a + _carried(body.turn, body.w, com))
            N = factors[i] * (I_base @ body.turn + ca.cross(body.w, I_base @ body.w))
            forces[joint.child] = F
            moments[joint.child] = N + ca.cross(body.p + com, F)
    efforts = ca.SX.zeros(len(joints))
    for i, joint in reversed(list(enumerate(joints))):
        z, p = axes[joint.name]
        F = forces[joint.child]
        N = moments[joint.child]
        if joint.is_angle:
            efforts[i] = ca.dot(z, N - ca.cross(p, F))
        else:
            efforts[i] = ca.dot(z, F)
        forces[joint.parent] += F
        moments[joint.parent] += N
    tau = ca.DM(S).T @ efforts
    M = ca.jacobian(tau, qdd)
    b = ca.substitute(tau, qdd, ca.DM.zeros(n))
    return MotionEquations(q, qd, factors, fall, M, b)


def _across(joint: Joint, parent: _BodyMotion, x: Any, xd: Any, xdd: Any) -> tuple[Any, Any, _BodyMotion]:
    """Return axis and origin of a joint in base, and the motion of its child, at coordinate x with its derivatives."""
    T_parent_joint = joint.T_parent_joint
    T_joint_child = spatial.inverse(joint.T_child_joint)
    R = parent.R @ T_parent_joint[:3, :3]
    r = parent.R @ T_parent_joint[:3, 3]
    z = R[:, 2]
    if joint.is_angle:
        R = R @ symbolic.rotation_z(x)
        w = parent.w + z * xd
        turn = parent.turn + z * xdd + ca.cross(parent.w, z * xd)
        a = parent.a + _carried(parent.turn, parent.w, r)
    else:
        r = r + z * x
        w = parent.w
        turn = parent.turn
        coriolis = 2 * ca.cross(w, z * xd)
        a = parent.a + _carried(turn, w, r) + z * xdd + coriolis
    p = parent.p + r
    s = R @ T_joint_child[:3, 3]
    child = _BodyMotion(R @ T_joint_child[:3, :3], p + s, w, turn, a + _carried(turn, w, s))
    return z, p, child


def _coordinates(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return x0 (m,) and S (m, n): the coordinates of the tree joints are x0 + S q."""
    dynamics = Dynamics(mechanism)
    indices = [dynamics.model.tree.configuration[j.name] for j in mechanism.tree]
    x0 = np.array(dynamics.configuration(np.zeros(dynamics.n)))[indices]
    # Couplings are linear, so that one unit step of each active joint gives a column of S.
    columns = []
    for unit in np.eye(dynamics.n):
        x = np.array(dynamics.configuration(unit))[indices]
        columns.append(x - x0)
    S: Array = np.array(columns).T
    return x0, np.round(S, 12)


def _carried(turn: Any, w: Any, r: Any) -> Any:
    """Return the acceleration of a point at r on a body whose origin does not accelerate."""
    return ca.cross(turn, r) + ca.cross(w, ca.cross(w, r))
