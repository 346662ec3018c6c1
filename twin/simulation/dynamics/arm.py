"""Robot model used by controller and plant: a mechanism with masses, friction, and effort limits of the motors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.model.body import Body
from twin.model.inertia import Inertia
from twin.model.mechanism import Mechanism
from twin.reference.dynamics import Dynamics
from twin.reference.inertia import Inertias, parameters, weighed


@dataclass(frozen=True)
class Arm:
    """A mechanism with n active joints, with its dynamic parameters; arrays are in the order of q.

    Attributes:
        mechanism: the mechanism, with a mass for each moving body.
        rotor: (n,) rotor inertia at the joints in kg m2 or kg, added to the inertia of the mechanism's actuators.
        friction: (n,) viscous friction at the joints, N m s/rad or N s/m.
        limit: (n,) largest efforts of the motors in N m or N; infinite if unknown.
        parameters: numbers from the inertia file, with provenance.
        mjcf: the mechanism as MJCF text, for simulation in MuJoCo; "" if not available.
    """

    mechanism: Mechanism
    rotor: Array
    friction: Array
    limit: Array
    parameters: tuple[Parameter, ...] = ()
    mjcf: str = field(default="", repr=False)

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the n motors; a directly driven joint is its own motor."""
        return self.mechanism.motor_names

    @property
    def effort_units(self) -> tuple[str, ...]:
        """Unit of the effort of each motor, "N m" or "N"."""
        kinds = {a.name: a.is_angle for a in self.mechanism.actuators}
        angles = (kinds.get(m, j.is_angle) for m, j in zip(self.motors, self.mechanism.active, strict=True))
        return tuple("N m" if angle else "N" for angle in angles)

    @property
    def masses(self) -> dict[str, float]:
        """Mass in kg of each body that a tree joint moves; the keys are the names of these joints."""
        bodies = {b.name: b.inertia for b in self.mechanism.bodies}
        return {j.name: m.mass for j in self.mechanism.tree if (m := bodies[j.child]) is not None}

    @cached_property
    def _outward(self) -> Array:
        """Matrix (n, n): row i has the joint efforts for an effort of 1 of motor i."""
        return np.asarray(np.linalg.inv(self.mechanism.motor_matrix), float)

    def joint_efforts(self, efforts: Array) -> Array:
        """Return the joint efforts (..., n) for motor efforts (..., n)."""
        return efforts @ self._outward

    def dynamics(self, factors: ArrayLike = 1.0, friction: ArrayLike | None = None) -> Dynamics:
        """Return the equations of motion, optionally with changed masses or friction.

        Args:
            factors: factors that multiply mass and inertia tensor of the bodies in `masses`, in the same order, or one
                factor for all bodies; mass centres and rotors are unchanged.
            friction: (n,) viscous friction that replaces `Arm.friction`; None: `Arm.friction` is used.
        """
        names = [j.child for j in self.mechanism.tree]
        known = dict(zip(names, np.broadcast_to(np.asarray(factors, float), len(names)), strict=True))
        bodies = (replace(b, inertia=_scaled(b.inertia, known.get(b.name, 1.0))) for b in self.mechanism.bodies)
        mechanism = replace(self.mechanism, bodies=tuple(bodies))
        return Dynamics(mechanism, rotor=self.rotor, friction=self.friction if friction is None else friction)


def arm(mechanism: Mechanism, table: Inertias | None = None, *, cited: bool = True, instrument: bool = True) -> Arm:
    """Return the robot model of a mechanism.

    Args:
        mechanism: the mechanism. The effort limit of a motor is that of its actuator; without an actuator, the limit in
            the inertia file; without a limit in the file, that of the joint's drive.
        table: inertia file of the robot; None if there is none.
        cited: True: use the masses of the file; False: use those of the mechanism.
        instrument: whether the last link of the file carries the instrument that the file describes.

    Raises:
        MechanismError: a moving body has no mass, or the file does not match the mechanism.
    """
    masses = table if cited else None
    if masses is not None:
        mechanism = weighed(masses, mechanism, instrument=instrument)
    else:
        for body in mechanism.bodies:
            if body.meshes and body.inertia is None and body.name != mechanism.base:
                raise MechanismError(
                    f"{mechanism.name}: body '{body.name}' has no mass: give its parts a material with a density, or "
                    f"state its mass; `twin info --inertia` names parts that cannot be weighed"
                )
    out = without_fixed(mechanism)
    bodies = {b.name: b for b in out.bodies}
    missing = [j.name for j in out.tree if bodies[j.child].inertia is None]
    if missing:
        raise MechanismError(
            f"{mechanism.name}: no body with a mass is moved by {', '.join(missing)}: give the bodies there a "
            "material with a density, or add their links to inertia.toml"
        )
    links = {link.joint: link for link in table.link} if table is not None else {}
    motors = {a.name: a.max_effort for a in out.actuators}

    def of(key: str, joint: str) -> float | None:
        entry = getattr(links.get(joint), key, None)
        return None if entry is None else entry.value

    limits = [
        motors[motor] if motor in motors else of("torque", j.name) or (j.drive.max_effort if j.drive else None)
        for j, motor in zip(out.active, out.motor_names, strict=True)
    ]
    return Arm(
        out,
        np.array([of("rotor", j.name) or 0.0 for j in out.active]),
        np.array([of("friction", j.name) or 0.0 for j in out.active]),
        np.array([np.inf if limit is None else limit for limit in limits]),
        tuple(parameters(table)) if table is not None else (),
    )


def without_fixed(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without shapes; bodies that are fixed to each other are merged into one body.

    Passive joints that move no mass are removed, except joints of a loop, of a coupling, or on the path to the tool.
    """
    at: dict[str, tuple[str, Array]] = {mechanism.base: (mechanism.base, np.eye(4))}  # body -> carrier, T_carrier_body
    for joint in mechanism.tree:
        name, T = at[joint.parent]
        fixed = joint.type == "fixed"
        step = T @ joint.T_parent_joint @ spatial.inverse(joint.T_child_joint)
        at[joint.child] = (name, step) if fixed else (joint.child, np.eye(4))
    masses: dict[str, Inertia] = {}
    for body in mechanism.bodies:
        if body.inertia is not None:
            name, T = at[body.name]
            part = body.inertia.seen_from(T)
            masses[name] = masses[name] + part if name in masses else part
    kept = {j.name for j in mechanism.loops} | {n for c in mechanism.couplings for n in c.joints}
    kept |= {j.name for j in mechanism.active}
    tied = {at[b][0] for j in mechanism.loops for b in (j.parent, j.child)}
    needed = {at[mechanism.frame(mechanism.tool).body][0], mechanism.base, *masses, *tied}
    for joint in mechanism.tree[::-1]:
        if at[joint.child][0] in needed or joint.name in kept:
            needed |= {at[joint.child][0], at[joint.parent][0]}
    welded = {j.name for j in mechanism.tree if j.type == "fixed"}
    joints = tuple(
        replace(
            j,
            parent=at[j.parent][0],
            child=at[j.child][0],
            T_parent_joint=at[j.parent][1] @ j.T_parent_joint,
            T_child_joint=at[j.child][1] @ j.T_child_joint,
            mating=(),
        )
        for j in mechanism.joints
        if j.name not in welded and {at[j.parent][0], at[j.child][0]} <= needed
    )
    names = {j.name for j in joints}
    return replace(
        mechanism,
        bodies=tuple(Body(b.name, (), masses.get(b.name)) for b in mechanism.bodies if b.name in needed),
        joints=joints,
        frames=tuple(
            replace(f, body=at[f.body][0], T_body_frame=at[f.body][1] @ f.T_body_frame)
            for f in mechanism.frames
            if at[f.body][0] in needed
        ),
        points=(),
        rest={n: T for n, T in mechanism.rest.items() if n in needed},
        trocars=tuple(n for n in mechanism.trocars if n in names),
    )


def _scaled(inertia: Inertia | None, factor: float) -> Inertia | None:
    return None if inertia is None else replace(inertia, mass=inertia.mass * factor, I_com=inertia.I_com * factor)
