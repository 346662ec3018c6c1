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
from twin.model.mechanism import Mechanism
from twin.reference.dynamics import Dynamics


@dataclass(frozen=True)
class Motion:
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
class _Moved:
    """Motion of a body: pose (R, p); angular velocity w; its derivative `turn`; a: origin's acceleration - gravity."""

    R: Any
    p: Any
    w: Any
    turn: Any
    a: Any


def motion(mechanism: Mechanism) -> Motion:
    """Return the equations of motion of a mechanism without loops; its passive joints follow active ones by couplings.

    Raises:
        MechanismError: the mechanism has loops.
    """
    if mechanism.loops:
        raise MechanismError(f"{mechanism.name} has loops: a machine needs a mechanism without loops")
    n, joints = len(mechanism.active), mechanism.tree
    q, qd, qdd = (ca.SX.sym(name, n) for name in ("q", "qd", "qdd"))
    factors, fall = ca.SX.sym("factors", len(joints)), ca.SX.sym("fall", 3)
    start, share = _coordinates(mechanism)
    x, xd, xdd = ca.DM(start) + ca.DM(share) @ q, ca.DM(share) @ qd, ca.DM(share) @ qdd
    bodies: dict[str, Inertia | None] = {b.name: b.inertia for b in mechanism.bodies}
    moved = {mechanism.base: _Moved(ca.DM.eye(3), ca.DM.zeros(3), ca.DM.zeros(3), ca.DM.zeros(3), -fall)}
    axes, force, moment = {}, {b: ca.SX.zeros(3) for b in bodies}, {b: ca.SX.zeros(3) for b in bodies}
    for i, joint in enumerate(joints):
        up, T, back = moved[joint.parent], joint.T_parent_joint, spatial.inverse(joint.T_child_joint)
        R, r = up.R @ T[:3, :3], up.R @ T[:3, 3]
        z = R[:, 2]
        if joint.is_angle:
            R = R @ symbolic.rotation_z(x[i])
            w, turn = up.w + z * xd[i], up.turn + z * xdd[i] + ca.cross(up.w, z * xd[i])
            a = up.a + _carried(up.turn, up.w, r)
        else:
            r = r + z * x[i]
            w, turn = up.w, up.turn
            a = up.a + _carried(turn, w, r) + z * xdd[i] + 2 * ca.cross(w, z * xd[i])
        axes[joint.name] = z, up.p + r
        s = R @ back[:3, 3]
        here = _Moved(R @ back[:3, :3], up.p + r + s, w, turn, a + _carried(turn, w, s))
        moved[joint.child] = here
        inertia = bodies[joint.child]
        if inertia is not None:
            c = here.R @ inertia.p_body_com
            about = here.R @ ca.DM(inertia.I_com) @ here.R.T
            F = factors[i] * inertia.mass * (here.a + _carried(turn, w, c))
            N = factors[i] * (about @ turn + ca.cross(w, about @ w))
            force[joint.child], moment[joint.child] = F, N + ca.cross(here.p + c, F)
    efforts = ca.SX.zeros(len(joints))
    for i, joint in reversed(list(enumerate(joints))):
        (z, p), F, N = axes[joint.name], force[joint.child], moment[joint.child]
        efforts[i] = ca.dot(z, N - ca.cross(p, F)) if joint.is_angle else ca.dot(z, F)
        force[joint.parent] += F
        moment[joint.parent] += N
    tau = ca.DM(share).T @ efforts
    return Motion(q, qd, factors, fall, ca.jacobian(tau, qdd), ca.substitute(tau, qdd, ca.DM.zeros(n)))


def _coordinates(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return x0 (m,) and S (m, n): the coordinates of the tree joints are x0 + S q."""
    dynamics = Dynamics(mechanism)
    places = [dynamics.model.tree.configuration[j.name] for j in mechanism.tree]
    at = [
        np.array(dynamics.configuration(row))[places] for row in np.vstack([np.zeros(dynamics.n), np.eye(dynamics.n)])
    ]
    return at[0], np.round(np.array([row - at[0] for row in at[1:]]).T, 12)


def _carried(turn: Any, w: Any, r: Any) -> Any:
    """Return the acceleration of a point at r on a body whose origin does not accelerate."""
    return ca.cross(turn, r) + ca.cross(w, ca.cross(w, r))
