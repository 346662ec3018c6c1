"""Robot model used by controller and plant: a mechanism with masses, friction, and effort limits of the motors."""

from __future__ import annotations

from collections.abc import Mapping
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
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference.dynamics import Dynamics
from twin.reference.inertia import Inertias, Link, parameters, weighed


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
        turning = {}
        for actuator in self.mechanism.actuators:
            turning[actuator.name] = actuator.is_angle
        units = []
        for motor, joint in zip(self.motors, self.mechanism.active, strict=True):
            is_angle = turning.get(motor, joint.is_angle)  # a motor without actuator is its joint
            units.append("N m" if is_angle else "N")
        return tuple(units)

    @property
    def masses(self) -> dict[str, float]:
        """Mass in kg of each body that a tree joint moves; the keys are the names of these joints."""
        masses = {}
        for joint in self.mechanism.tree:
            inertia = self.mechanism.body(joint.child).inertia
            if inertia is not None:
                masses[joint.name] = inertia.mass
        return masses

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
        tree = self.mechanism.tree
        factor_of_joint = np.broadcast_to(np.asarray(factors, float), len(tree))
        factor_of_body = {}
        for joint, factor in zip(tree, factor_of_joint, strict=True):
            factor_of_body[joint.child] = factor
        bodies = []
        for body in self.mechanism.bodies:
            inertia = body.inertia
            if inertia is not None:
                factor = factor_of_body.get(body.name, 1.0)
                inertia = replace(inertia, mass=inertia.mass * factor, I_com=inertia.I_com * factor)
            bodies.append(replace(body, inertia=inertia))
        mechanism = replace(self.mechanism, bodies=tuple(bodies))
        if friction is None:
            friction = self.friction
        return Dynamics(mechanism, rotor=self.rotor, friction=friction)


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
    if table is not None and cited:
        mechanism = weighed(table, mechanism, instrument=instrument)
    else:
        _check_weighed(mechanism)
    merged = without_fixed(mechanism)
    # Only after the merge, because a link without a mass may be fixed to one with a mass.
    massless = []
    for joint in merged.tree:
        if merged.body(joint.child).inertia is None:
            massless.append(joint.name)
    if massless:
        raise MechanismError(
            f"{mechanism.name}: no body with a mass is moved by {', '.join(massless)}: give the bodies there a "
            "material with a density, or add their links to inertia.toml"
        )
    links: dict[str, Link] = {}
    provenance: tuple[Parameter, ...] = ()
    if table is not None:
        for link in table.link:
            links[link.joint] = link
        provenance = tuple(parameters(table))
    n = len(merged.active)
    rotor = np.zeros(n)
    friction = np.zeros(n)
    limit = np.full(n, np.inf)
    motor_limits = {actuator.name: actuator.max_effort for actuator in merged.actuators}
    for i, (joint, motor) in enumerate(zip(merged.active, merged.motor_names, strict=True)):
        link = links.get(joint.name)
        if link is not None and link.rotor is not None:
            rotor[i] = link.rotor.value
        if link is not None and link.friction is not None:
            friction[i] = link.friction.value
        # The limit of an actuator counts also if it is unknown: that of a joint behind it would be another quantity.
        largest = motor_limits[motor] if motor in motor_limits else _drive_limit(joint, link)
        if largest is not None:
            limit[i] = largest
    return Arm(merged, rotor, friction, limit, provenance)


def _check_weighed(mechanism: Mechanism) -> None:
    """Raise `MechanismError` if a moving body with a shape has no mass."""
    for body in mechanism.bodies:
        if body.meshes and body.inertia is None and body.name != mechanism.base:
            raise MechanismError(
                f"{mechanism.name}: body '{body.name}' has no mass: give its parts a material with a density, or "
                f"state its mass; `twin info --inertia` names parts that cannot be weighed"
            )


def _drive_limit(joint: Joint, link: Link | None) -> float | None:
    """Return the largest effort in N m or N of a joint without actuator: that of the inertia file, or of its drive."""
    if link is not None and link.torque is not None:
        return link.torque.value
    if joint.drive is not None:
        return joint.drive.max_effort
    return None


def without_fixed(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without shapes; bodies that are fixed to each other are merged into one body.

    Passive joints that move no mass are removed, except joints of a loop, of a coupling, or on the path to the tool.
    """
    carriers = _carriers(mechanism)
    inertias = _merged_inertias(mechanism, carriers)
    needed = _needed_bodies(mechanism, carriers, set(inertias))
    bodies = []
    for body in mechanism.bodies:
        if body.name in needed:
            bodies.append(Body(body.name, (), inertias.get(body.name)))
    # A fixed joint of the tree has disappeared into its carrier; a loop is closed also by a fixed joint.
    welded = [joint.name for joint in mechanism.tree if joint.type == "fixed"]
    joints = []
    for joint in mechanism.joints:
        parent, T_carrier_parent = carriers[joint.parent]
        child, T_carrier_child = carriers[joint.child]
        if joint.name in welded or parent not in needed or child not in needed:
            continue
        joint_on_carriers = replace(
            joint,
            parent=parent,
            child=child,
            T_parent_joint=T_carrier_parent @ joint.T_parent_joint,
            T_child_joint=T_carrier_child @ joint.T_child_joint,
            mating=(),
        )
        joints.append(joint_on_carriers)
    frames = []
    for frame in mechanism.frames:
        carrier, T_carrier_body = carriers[frame.body]
        if carrier in needed:
            frames.append(replace(frame, body=carrier, T_body_frame=T_carrier_body @ frame.T_body_frame))
    rest = {}
    for name, T_base_body in mechanism.rest.items():
        if name in needed:
            rest[name] = T_base_body
    joint_names = [joint.name for joint in joints]
    trocars = []
    for name in mechanism.trocars:
        if name in joint_names:
            trocars.append(name)
    return replace(
        mechanism,
        bodies=tuple(bodies),
        joints=tuple(joints),
        frames=tuple(frames),
        points=(),
        rest=rest,
        trocars=tuple(trocars),
    )


def _carriers(mechanism: Mechanism) -> dict[str, tuple[str, Array]]:
    """Return for each body the body into which it is merged, and its pose T_carrier_body (4, 4)."""
    carriers = {mechanism.base: (mechanism.base, np.eye(4))}
    for joint in mechanism.tree:
        if joint.type == "fixed":
            carrier, T_carrier_parent = carriers[joint.parent]
            T_carrier_child = T_carrier_parent @ joint.T_parent_joint @ spatial.inverse(joint.T_child_joint)
            carriers[joint.child] = carrier, T_carrier_child
        else:
            carriers[joint.child] = joint.child, np.eye(4)
    return carriers


def _merged_inertias(mechanism: Mechanism, carriers: Mapping[str, tuple[str, Array]]) -> dict[str, Inertia]:
    """Return the inertia of each carrier, in its frame, with all bodies that are merged into it."""
    inertias: dict[str, Inertia] = {}
    for body in mechanism.bodies:
        if body.inertia is None:
            continue
        carrier, T_carrier_body = carriers[body.name]
        part = body.inertia.seen_from(T_carrier_body)
        if carrier in inertias:
            inertias[carrier] = inertias[carrier] + part
        else:
            inertias[carrier] = part
    return inertias


def _needed_bodies(mechanism: Mechanism, carriers: Mapping[str, tuple[str, Array]], heavy: set[str]) -> set[str]:
    """Return the carriers of a mass (`heavy`), of base, tool, loops, couplings and motors, and all that carry these."""
    kept_joints: set[str] = set()
    tool = mechanism.frame(mechanism.tool)
    needed = {carriers[tool.body][0], mechanism.base, *heavy}
    for joint in mechanism.active:
        kept_joints.add(joint.name)
    for joint in mechanism.loops:
        kept_joints.add(joint.name)
        needed.add(carriers[joint.parent][0])
        needed.add(carriers[joint.child][0])
    for coupling in mechanism.couplings:
        kept_joints.update(coupling.joints)
    # From the leaves to the base, so that a needed body makes all bodies that carry it needed.
    for joint in mechanism.tree[::-1]:
        parent = carriers[joint.parent][0]
        child = carriers[joint.child][0]
        if child in needed or joint.name in kept_joints:
            needed.update((parent, child))
    return needed
