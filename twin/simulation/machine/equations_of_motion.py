"""Symbolic equations of motion of a mechanism, for compilation: M(q) qdd + b(q, qd) = joint efforts.

Newton-Euler recursion along the tree in the axes of base (R. Featherstone, Rigid Body Dynamics Algorithms, Springer
2008, chapter 5). Passive joints of closed loops follow the active ones (`LoopRates`); by virtual work, their efforts
count at the active joints, because the forces in the loops do no work. M is the derivative of the efforts with respect
to the accelerations. The tests compare the equations with `twin.reference.dynamics`, which shares no code with this
file.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.kinematics.closed_loops.equations import STEP_SIZES, rotated_by_quaternion
from twin.kinematics.closed_loops.solver import LoopSolver, block_solution
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference.dynamics import Dynamics

Expression = ca.SX | ca.DM
"""A matrix of CasADi: `ca.SX` has symbols, `ca.DM` numbers. Both take the same operators."""


@dataclass(frozen=True)
class MotionEquations:
    """Symbols and terms of the equations of motion for n active joints and m tree joints.

    Attributes:
        q, qd: symbols (n,) of joint values and rates.
        factors: symbols (m,), one for each tree joint; a factor multiplies mass and inertia tensor of the joint's body.
        fall: symbol (3,) of the gravitational acceleration in base, m/s2.
        states: symbols of the states of the passive joints of closed loops, as in `LoopSolver`; empty without loops.
        M: (n, n) mass matrix, without rotors.
        b: (n,) Coriolis and centrifugal efforts, and gravity.
    """

    q: ca.SX
    qd: ca.SX
    factors: ca.SX
    fall: ca.SX
    states: ca.SX
    M: ca.SX
    b: ca.SX


@dataclass
class _JointMotion:
    """Coordinate of a joint of the tree with rate and acceleration.

    The coordinate of a ball joint is a unit quaternion (w x y z); rate and acceleration are its angular velocity and
    the derivative of this velocity, in the axes of the child's joint frame.
    """

    x: ca.SX
    xd: ca.SX
    xdd: ca.SX


@dataclass
class _BodyMotion:
    """Motion of a body, in the axes of base.

    Attributes:
        R, p: (3, 3) rotation and (3,) origin of the body in base.
        w: (3,) angular velocity in rad/s.
        wd: (3,) derivative of w in rad/s2.
        a: (3,) acceleration of the origin minus the gravitational acceleration, in m/s2.
    """

    R: Expression
    p: Expression
    w: Expression
    wd: Expression
    a: Expression


def motion(mechanism: Mechanism, solver: LoopSolver | None = None) -> MotionEquations:
    """Return the equations of motion of a mechanism; its passive joints follow active ones by loops or couplings.

    `solver` closes the loops of the mechanism; None: a new one.

    Raises:
        MechanismError: a passive joint of a mechanism with loops has a type other than revolute, prismatic and
            spherical, or no loop determines it.
    """
    n = len(mechanism.active)
    q = ca.SX.sym("q", n)
    qd = ca.SX.sym("qd", n)
    qdd = ca.SX.sym("qdd", n)
    factors = ca.SX.sym("factors", len(mechanism.tree))
    fall = ca.SX.sym("fall", 3)
    states = ca.SX(0, 1)
    joints: dict[str, _JointMotion] = {}
    if mechanism.loops:
        rates = LoopRates(solver or LoopSolver(mechanism), q, qd)
        states = rates.states
        # acceleration of the passive joints: a part for the accelerations of the active joints, and a part without
        followers = rates.gain @ qdd + rates.drift
        for i, joint in enumerate(mechanism.active):
            joints[joint.name] = _JointMotion(q[i], qd[i], qdd[i])
        for name, state, steps in rates.passive:
            joints[name] = _JointMotion(state, rates.rates[steps], followers[steps])
        efforts = _tree_efforts(mechanism, joints, factors, fall)
        tau = ca.vertcat(*[efforts[joint.name] for joint in mechanism.active])
        tau = tau + rates.gain.T @ ca.vertcat(*[efforts[name] for name, _, _ in rates.passive])
    else:
        x0, S = _coordinates(mechanism)
        x = ca.DM(x0) + ca.DM(S) @ q
        xd = ca.DM(S) @ qd
        xdd = ca.DM(S) @ qdd
        for i, joint in enumerate(mechanism.tree):
            joints[joint.name] = _JointMotion(x[i], xd[i], xdd[i])
        efforts = _tree_efforts(mechanism, joints, factors, fall)
        tau = ca.DM(S).T @ ca.vertcat(*[efforts[joint.name] for joint in mechanism.tree])
    M = ca.jacobian(tau, qdd)
    b = ca.substitute(tau, qdd, ca.DM.zeros(n))
    return MotionEquations(q, qd, factors, fall, states, M, b)


def _tree_efforts(
    mechanism: Mechanism, joints: dict[str, _JointMotion], factors: ca.SX, fall: ca.SX
) -> dict[str, ca.SX]:
    """Return the efforts of the joints of the tree, by name: (1,), or (3,) for a ball joint, as if there were no loops.

    `joints` has the motion of each joint; a fixed joint, which has none, may be missing.
    """
    # The base accelerates upwards instead of a weight on each body (Featherstone, section 5.3).
    base = _BodyMotion(ca.DM.eye(3), ca.DM.zeros(3), ca.DM.zeros(3), ca.DM.zeros(3), -fall)
    motions = {mechanism.base: base}
    axes_and_origins = {}
    inertias: dict[str, Inertia | None] = {}
    # Forces and moments that accelerate the bodies, about the origin of base; below, each body adds those beyond it.
    forces = {}
    moments = {}
    for body in mechanism.bodies:
        inertias[body.name] = body.inertia
        forces[body.name] = ca.SX.zeros(3)
        moments[body.name] = ca.SX.zeros(3)
    for i, joint in enumerate(mechanism.tree):
        if joint.type == "fixed":
            joint_motion = _JointMotion(ca.SX(0), ca.SX(0), ca.SX(0))
        else:
            joint_motion = joints[joint.name]
        z, p, body = _across(joint, motions[joint.parent], joint_motion)
        axes_and_origins[joint.name] = z, p
        motions[joint.child] = body
        inertia = inertias[joint.child]
        if inertia is not None:
            com = body.R @ inertia.p_body_com
            I_base = body.R @ ca.DM(inertia.I_com) @ body.R.T
            F = factors[i] * inertia.mass * (body.a + _carried(body.wd, body.w, com))
            N = factors[i] * (I_base @ body.wd + ca.cross(body.w, I_base @ body.w))
            forces[joint.child] = F
            moments[joint.child] = N + ca.cross(body.p + com, F)
    # From the tips to the base: a joint carries what accelerates all bodies beyond it.
    efforts = {}
    for joint in reversed(mechanism.tree):
        z, p = axes_and_origins[joint.name]
        F = forces[joint.child]
        N = moments[joint.child]
        if joint.type == "prismatic":
            efforts[joint.name] = ca.dot(z, F)
        else:
            efforts[joint.name] = z.T @ (N - ca.cross(p, F))
        forces[joint.parent] += F
        moments[joint.parent] += N
    return efforts


def _across(
    joint: Joint, parent: _BodyMotion, joint_motion: _JointMotion
) -> tuple[Expression, Expression, _BodyMotion]:
    """Return the axes and the origin of a joint in base, and the motion of its child.

    The axes are z (3,), or for a ball joint x, y, z (3, 3) of the child's joint frame.
    """
    T_parent_joint = joint.T_parent_joint
    T_joint_child = spatial.inverse(joint.T_child_joint)
    R = parent.R @ T_parent_joint[:3, :3]
    r = parent.R @ T_parent_joint[:3, 3]
    z = R[:, 2]
    if joint.type == "prismatic":
        r = r + z * joint_motion.x
        w = parent.w
        wd = parent.wd
        coriolis = 2 * ca.cross(w, z * joint_motion.xd)
        a = parent.a + _carried(wd, w, r) + z * joint_motion.xdd + coriolis
    else:
        if joint.type == "spherical":
            R = R @ ca.horzcat(*[rotated_by_quaternion(joint_motion.x, ca.SX(axis)) for axis in np.eye(3)])
            z = R
        else:
            R = R @ symbolic.rotation_z(joint_motion.x)
        spin = z @ joint_motion.xd
        w = parent.w + spin
        wd = parent.wd + z @ joint_motion.xdd + ca.cross(parent.w, spin)
        a = parent.a + _carried(parent.wd, parent.w, r)
    p = parent.p + r
    s = R @ T_joint_child[:3, 3]
    child = _BodyMotion(R @ T_joint_child[:3, :3], p + s, w, wd, a + _carried(wd, w, s))
    return z, p, child


def _coordinates(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return x0 (m,) and S (m, n): the coordinates of the tree joints are x0 + S q."""
    dynamics = Dynamics(mechanism)
    indices = [dynamics.model.tree.configuration[joint.name] for joint in mechanism.tree]
    x0 = np.array(dynamics.configuration(np.zeros(dynamics.n)))[indices]
    # Couplings are linear, so that one unit step of each active joint gives a column of S.
    columns = []
    for unit in np.eye(dynamics.n):
        x = np.array(dynamics.configuration(unit))[indices]
        columns.append(x - x0)
    S: Array = np.array(columns).T
    # numbers that are 0 but for rounding errors would make all terms of the compiled equations larger
    return x0, np.round(S, _COUPLING_DECIMALS)


def _carried(wd: Expression, w: Expression, r: Expression) -> Expression:
    """Return the acceleration (3,) of a point at r (3,) on a body whose origin does not accelerate."""
    return ca.cross(wd, r) + ca.cross(w, ca.cross(w, r))


_COUPLING_DECIMALS = 12
"""Decimals of the factors of couplings (rad/rad, m/rad, ...): far above rounding errors, far below any real factor."""

_PASSIVE_TYPES = ("revolute", "prismatic", "spherical")
"""Types of the passive joints that the recursion along the tree knows."""


class LoopRates:
    """Rates of the passive joints of a mechanism with loops.

    The derivative of the closing conditions r(q, s) = 0 along a motion is A_q qd + A_s v = 0; v are the rates of the
    passive joints, for a ball joint its angular velocity. Another derivative gives their accelerations,
    A_s a = -A_q qdd - c, with c the derivative of A_q qd + A_s v while qd and v are constant. Each block of
    `LoopSolver` is solved after those before it.

    Attributes:
        states: symbols (m,) of the states of the passive joints, as in `ClosedStates.states`.
        passive: for each passive joint of the tree, its name, the symbols of its state, and its rows in `rates`.
        gain: (k, n) rates of the passive joints per rate of each active joint.
        rates: (k,) rates of the passive joints in rad/s or m/s.
        drift: (k,) accelerations of the passive joints while the active joints do not accelerate.
    """

    def __init__(self, solver: LoopSolver, q: ca.SX, qd: ca.SX) -> None:
        """Derive the rates at active joints q (n,) and rates qd (n,), which are symbols.

        Raises:
            MechanismError: a passive joint has an unknown type, or no loop determines it.
        """
        equations = solver.equations
        self._solver = solver
        self.states = equations.states
        self.passive: list[tuple[str, ca.SX, slice]] = []
        start = 0
        for passive in equations.passive:
            joint_type = passive.joint.type
            if joint_type not in _PASSIVE_TYPES:
                known = ", ".join(_PASSIVE_TYPES)
                raise MechanismError(
                    f"the passive joint {passive.name} is {joint_type}: the equations of motion know {known}"
                )
            end = start + STEP_SIZES[joint_type]
            self.passive.append((passive.name, passive.state, slice(start, end)))
            start = end
        self._count = start
        A_q = ca.substitute(ca.jacobian(equations.residual, equations.q), equations.q, q)
        self._A_s = ca.substitute(equations.jacobian, equations.q, q)
        columns = []
        for i in range(q.numel()):
            columns.append(self._solve(A_q[:, i]))
        self.gain = ca.horzcat(*columns)
        self.rates = self.gain @ qd
        # c: the derivative of A_q qd + A_s v along the motion, with v as symbols, which do not change
        v = ca.SX.sym("v", self._count)
        changes = []
        for (_, _, rows), passive in zip(self.passive, equations.passive, strict=True):
            stepped = passive.stepped(passive.step)
            per_step = ca.substitute(ca.jacobian(stepped, passive.step), passive.step, 0)
            changes.append(per_step @ v[rows])
        direction = ca.vertcat(qd, *changes)
        c = ca.jtimes(A_q @ qd + self._A_s @ v, ca.vertcat(q, equations.states), direction)
        self.drift = self._solve(ca.substitute(c, v, self.rates))

    def _solve(self, b: ca.SX) -> ca.SX:
        """Return x (k,) with A_s x = -b."""
        x: dict[int, ca.SX] = {}
        for block, sample in zip(self._solver.blocks, self._solver.samples, strict=True):
            rows = list(block.rows)
            right_side = b[rows]
            for column, value in x.items():
                right_side = right_side + self._A_s[rows, column] * value
            part = block_solution(self._A_s, block, sample, -right_side)
            x.update(zip(block.columns, ca.vertsplit(part), strict=True))
        for name, _, rows in self.passive:
            if not all(column in x for column in range(rows.start, rows.stop)):
                raise MechanismError(
                    f"no loop determines the passive joint {name}, which moves a mass: drive it, or make it fixed"
                )
        return ca.vertcat(*[x[column] for column in range(self._count)])
