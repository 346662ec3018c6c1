"""Inverse and forward dynamics of a serial arm on Pinocchio, and the chain of a mechanism for it.

    M(q) qdd + C(q, qd) qd + g(q) + F qd = torque

with the rotors' inertia on the diagonal of M and viscous friction F. q in rad, torques in N m, gravity along -z of
base. Link j turns about z of joint frame j; links are given in those frames.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.model.mechanism import Inertia, Joint, Mechanism
from twin.simulation.dynamics.inertia import scaled

GRAVITY = (0.0, 0.0, -9.81)
"""In base, m/s2."""


class Dynamics:
    """Equations of motion of n links in a row.

    Attributes:
        placements: (n, 4, 4) joint frame j in joint frame j-1 (the first: in base) with joint j at zero.
        links: in joint frames.
        rotor: (n,) kg m2 at the link. friction: (n,) N m s/rad.
    """

    def __init__(self, placements: ArrayLike, links: Sequence[Inertia], rotor: ArrayLike, friction: ArrayLike) -> None:
        self.placements = np.asarray(placements, float)
        self.links = tuple(links)
        self.rotor, self.friction = np.asarray(rotor, float), np.asarray(friction, float)
        n = len(self.links)
        if self.placements.shape != (n, 4, 4) or self.rotor.shape != (n,) or self.friction.shape != (n,):
            raise MechanismError(
                f"{n} links need {n} placements, rotors and frictions, not {len(self.placements)}, "
                f"{self.rotor.size} and {self.friction.size}"
            )
        model = pin.Model()
        model.gravity.linear = np.array(GRAVITY)
        parent = 0
        for j, (T, link) in enumerate(zip(self.placements, self.links, strict=True)):
            parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(T), f"q{j + 1}")
            body = pin.Inertia(link.mass, np.asarray(link.p_body_com), np.asarray(link.I_com))
            model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        model.armature = self.rotor.copy()
        self._model, self._data = model, model.createData()

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.links)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return M (n, n) at q (n,), kg m2, rotors included."""
        upper = np.triu(np.asarray(pin.crba(self._model, self._data, np.asarray(q, float)), float))
        return upper + np.triu(upper, 1).T

    def coriolis(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Return C(q, qd) qd (n,) in N m."""
        return self.bias(q, qd) - self.gravity(q)

    def gravity(self, q: ArrayLike) -> Array:
        """Return g (n,): the torques in N m that hold the arm at q (n,)."""
        return np.array(pin.computeGeneralizedGravity(self._model, self._data, np.asarray(q, float)))

    def bias(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Return C qd + g (n,) in N m, without friction."""
        q, qd = np.asarray(q, float), np.asarray(qd, float)
        return np.array(pin.nonLinearEffects(self._model, self._data, q, qd))

    def inverse(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Return the torques (n,) in N m that give qdd (n,) at q, qd, friction included."""
        q, qd, qdd = np.asarray(q, float), np.asarray(qd, float), np.asarray(qdd, float)
        return np.array(pin.rnea(self._model, self._data, q, qd, qdd)) + self.friction * qd

    def forward(self, q: ArrayLike, qd: ArrayLike, torque: ArrayLike) -> Array:
        """Return qdd (n,) in rad/s2 under torques (n,) in N m, friction included."""
        q, qd = np.asarray(q, float), np.asarray(qd, float)
        tau = np.asarray(torque, float) - self.friction * qd
        return np.array(pin.aba(self._model, self._data, q, qd, tau))

    def energy(self, q: ArrayLike, qd: ArrayLike) -> tuple[float, float]:
        """Return kinetic energy (rotors included) and potential energy in J; the latter is zero at base."""
        q, qd = np.asarray(q, float), np.asarray(qd, float)
        kinetic = float(pin.computeKineticEnergy(self._model, self._data, q, qd))
        return kinetic, float(pin.computePotentialEnergy(self._model, self._data, q))

    def tip(self, q: ArrayLike, p_last: ArrayLike) -> Array:
        """Return (3,) in base, m: where a point p_last (3,) of the last joint frame is at q (n,)."""
        pin.forwardKinematics(self._model, self._data, np.asarray(q, float))
        return np.array(self._data.oMi[self.n].act(np.asarray(p_last, float)))

    def perturbed(self, fraction: float, seed: int | None = None) -> Dynamics:
        """Return the model with masses and tensors wrong by a fraction; mass centres, rotors and friction stay.

        Args:
            fraction: 0.05 makes links 5 % too heavy.
            seed: None: all links alike. Otherwise each link is too heavy or too light by chance.
        """
        return self.altered(1.0 + fraction * signs(self.n, seed), self.friction)

    def altered(self, factors: ArrayLike, friction: ArrayLike) -> Dynamics:
        """Return the model with masses and tensors times factors (n,) and another friction (n,)."""
        return Dynamics(self.placements, scaled(self.links, factors), self.rotor, friction)


def signs(n: int, seed: int | None) -> Array:
    """Return n signs +1 or -1: all +1 without a seed, by chance with one."""
    return np.ones(n) if seed is None else np.random.default_rng(seed).choice([-1.0, 1.0], n)


class ModelPlant:
    """An arm that moves by the equations of `Dynamics`, integrated by Runge-Kutta of fourth order.

    Not independent of the controller's model: it shows what the control alone does wrong.
    """

    def __init__(self, dynamics: Dynamics, step: float = 0.25e-3) -> None:
        self._dynamics, self._step = dynamics, step
        self.q = self.qd = np.zeros(dynamics.n)

    def reset(self, q: ArrayLike, qd: ArrayLike) -> None:
        """Put the arm at q (n,) in rad with qd (n,) in rad/s."""
        self.q, self.qd = np.array(q, float), np.array(qd, float)

    def advance(self, torque: Array, duration: float) -> None:
        """Move on for a duration in s, a multiple of the step, under constant torques (n,) in N m."""
        f, h = self._dynamics.forward, self._step
        for _ in range(round(duration / h)):
            q, v = self.q, self.qd
            a1 = f(q, v, torque)
            a2 = f(q + h / 2 * v, v + h / 2 * a1, torque)
            a3 = f(q + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2, torque)
            a4 = f(q + h * v + h * h / 2 * a2, v + h * a3, torque)
            self.q = q + h * v + h * h / 6 * (a1 + a2 + a3)
            self.qd = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def poses(placements: Array, qs: ArrayLike, T_last_tool: ArrayLike | None = None) -> Array:
    """Return (k, 4, 4): the last joint frame, or a tool in it, in base at joints (k, n) in rad."""
    qs = np.asarray(qs, float)
    T = np.broadcast_to(np.eye(4), (len(qs), 4, 4))
    for j, step in enumerate(placements):
        T = T @ (step @ spatial.pose(spatial.rotation_z(qs[:, j])))
    return T if T_last_tool is None else T @ np.asarray(T_last_tool, float)


def placements(mechanism: Mechanism) -> Array:
    """Return (n, 4, 4): joint frame j in joint frame j-1 (the first: in base) of a mechanism with all joints zero.

    The active joints must be revolute and stand in a row; fixed joints may lie between them, and passive ones
    beside the row (a trocar on the instrument) are left out.

    Raises:
        MechanismError: the active joints are no serial chain of revolute joints.
    """
    T, out = np.eye(4), []  # of the present body in the joint frame before it
    for joint in _row(mechanism):
        if joint.type == "fixed":
            T = T @ joint.T_parent_joint @ spatial.inverse(joint.T_child_joint)
        else:
            out.append(T @ joint.T_parent_joint)
            T = spatial.inverse(joint.T_child_joint)
    return np.array(out)


def tool_in_last(mechanism: Mechanism, frame: str | None = None) -> Array:
    """Return T_last_tool (4, 4): a named frame (default the tool) in the frame of the last active joint's child.

    Raises:
        MechanismError: no serial chain, or the frame is not fixed to its last link.
    """
    chosen = mechanism.frame(frame or mechanism.tool)
    row = _row(mechanism)
    reached = {row[-1].child: spatial.inverse(row[-1].T_child_joint)}
    for joint in mechanism.tree:
        if joint.type == "fixed" and joint.parent in reached:
            T = reached[joint.parent] @ joint.T_parent_joint @ spatial.inverse(joint.T_child_joint)
            reached[joint.child] = T
    if chosen.body not in reached:
        raise MechanismError(f"frame '{chosen.name}' is on body '{chosen.body}', which is not fixed to the last link")
    return reached[chosen.body] @ chosen.T_body_frame


def links_of(mechanism: Mechanism) -> tuple[Inertia, ...]:
    """Return the links as the CAD weighs them, each in its joint frame with all that is fixed to it.

    Raises:
        MechanismError: no serial chain of revolute joints, or a body of it was not weighed.
    """
    owner: dict[str, tuple[int, Array]] = {}  # body -> index of its link, T_joint_body
    for i, joint in enumerate(j for j in _row(mechanism) if j.type != "fixed"):
        owner[joint.child] = i, spatial.inverse(joint.T_child_joint)
    moving = set(owner)
    for joint in mechanism.tree:
        if joint.type == "fixed" and joint.parent in owner and joint.child not in moving:
            i, T = owner[joint.parent]
            owner[joint.child] = i, T @ joint.T_parent_joint @ spatial.inverse(joint.T_child_joint)
    links: dict[int, Inertia] = {}
    for body, (i, T) in owner.items():
        weighed = mechanism.body(body).inertia
        if weighed is None:
            if mechanism.body(body).meshes:
                raise MechanismError(f"{mechanism.name}: body '{body}' has no mass: give its material a density")
            continue
        part = weighed.seen_from(T)
        links[i] = links[i] + part if i in links else part
    missing = [j.name for i, j in enumerate(mechanism.active) if i not in links]
    if missing:
        raise MechanismError(f"{mechanism.name}: nothing that has a mass is moved by {', '.join(missing)}")
    return tuple(links[i] for i in range(len(links)))


def _row(mechanism: Mechanism) -> tuple[Joint, ...]:
    """Return the joints of the tree from the base to the last active one."""
    active = {j.name for j in mechanism.active}
    ends = [j for j in mechanism.tree if j.name in active]
    if not active or len(ends) != len(active):
        raise MechanismError(f"{mechanism.name}: no active joints in a row (one closes a loop, or there is none)")
    row = mechanism.path(ends[-1].child)
    moving = [j for j in row if j.type != "fixed"]
    if {j.name for j in moving} != active or any(j.type != "revolute" for j in moving):
        raise MechanismError(
            f"{mechanism.name}: dynamics need active revolute joints in a row; from the base to "
            f"'{ends[-1].child}' there are {', '.join(f'{j.name} ({j.type})' for j in moving)}"
        )
    if [j.name for j in moving] != [j.name for j in mechanism.active]:
        raise MechanismError(f"{mechanism.name}: list the active joints from the base outwards")
    return row
