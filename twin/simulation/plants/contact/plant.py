"""Movable objects in contact with robots and fixed parts: MuJoCo moves the objects, joint values move the robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.model.body import Body, Mesh
from twin.model.movable import Movable
from twin.simulation.plants.contact.collision_shapes import NONE, GeomOwner, Solid, add_object, add_part
from twin.simulation.plants.contact.contact_planes import ContactPlanes
from twin.simulation.plants.contact.gripper import Gripper
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    OBJECT_HOLDER,
    OBJECT_POSE,
    OBJECT_RUBS,
    ROBOT_MEETS,
    ROBOT_Q,
    ROBOT_TOUCHES,
)

_LINK_MASS = 10.0
_LINK_INERTIA = 0.1
"""Mass in kg and moment of inertia in kg m2 of the simulated links of an instrument.

The joint values alone move the links; this inertia only keeps contact forces from moving them within a tick.
"""

_JAW_INERTIA = 1e-5
"""Moment of inertia in kg m2 of a jaw with its drive, about the axis of the jaw; ASSUMED."""

_PATCH_RADIUS = 0.5e-3
"""Radius in m of the contact patch that resists turning about the normal; ASSUMED."""

_LARGEST_OVERLAP = 0.1e-3
"""Largest overlap in m of an object with anything at the start."""


@dataclass
class _Contacts:
    """Contacts after a step.

    Attributes:
        holders: index of the gripper that holds each object; -1: none.
        touches: instruments at fixed parts.
        meets: instruments at each other.
        rubs: objects that touch a part of `rubbed`.
    """

    holders: list[int]
    touches: set[int]
    meets: set[int]
    rubs: set[int]


class Contact(Block):
    """Reads `<robot>.q` of instruments; writes poses and holders of objects, and collisions of instruments.

    Instruments follow their joint values exactly, even in contact, with one exception: the torque of a jaw is limited,
    so that an object between the jaws stops the jaw before the jaw reaches its joint value. Objects are held by
    friction only.

    Signals:
        `<object>.pose` (16,): T_world_object, row by row.
        `<object>.holder`: index of the gripper that holds the object: all jaws of the gripper touch the object. If
        several grippers hold the object: the gripper that grasped last; -1: none.
        `<object>.rubs`: 1 while the object touches a part of `rubbed`; not written if `rubbed` is empty.
        `<robot>.touches`: 1 while the instrument touches a fixed part.
        `<robot>.meets`: 1 while the instrument touches another instrument.
        `<robot>.planes`: local planes of the parts that the instrument or its held object touches; not written without
        `feels`.
    """

    def __init__(
        self,
        objects: Sequence[Movable],
        solids: Sequence[Solid] = (),
        grippers: Sequence[Gripper] = (),
        q: Mapping[str, Array] | None = None,
        period: float = 2e-3,
        gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
        friction: float = 0.5,
        feels: bool = False,
        rubbed: Sequence[str] = (),
    ) -> None:
        """Build the MuJoCo model.

        Args:
            objects: the movable objects.
            solids: the fixed parts.
            grippers: the instruments.
            q: joint values (n,) of each instrument at the start; the keys are the names of the robots.
            period: time in s between two steps, a multiple of the World's tick.
            gravity: acceleration in the World in m/s2.
            friction: coefficient of sliding friction of the instruments.
            feels: whether `<robot>.planes` is written; the forces on the hands are computed from this signal.
            rubbed: names of parts of `solids`; `<object>.rubs` states whether an object touches any of these parts.

        Raises:
            WorldError: a number is out of range, or an object overlaps something by more than 0.1 mm at the start.
        """
        for item in objects:
            _require_valid(item)
        self._objects = tuple(objects)
        self._grippers = tuple(grippers)
        self.period = period
        spec = _empty(period, gravity)
        self._add(spec, solids, friction)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._start(q or {})
        self._owners = self._find_owners()
        self._rubbed = self._geoms_of(solids, rubbed)
        mujoco.mj_forward(self._model, self._data)
        self._require_apart()
        # at each object, by time of grasp
        self._holding_grippers: list[list[int]] = [[] for _ in self._objects]
        self._last_contacts: _Contacts | None = None
        self.outputs = self._signals()
        self._contact_planes: ContactPlanes | None = None
        if feels:
            names = [item.name for item in self._objects]
            self._contact_planes = ContactPlanes(self._model, self._grippers, names, self._owners)
            self.outputs |= self._contact_planes.outputs

    # -- the model ----------------------------------------------------------------------------------------

    def _add(self, spec: mujoco.MjSpec, solids: Sequence[Solid], friction: float) -> None:
        """Add parts, objects and instruments; MuJoCo lets two geoms touch if their bits match.

        Bit 1: objects; bit 2: fixed parts; bit 4 << k: instrument k.
        """
        world = spec.worldbody
        all_arms = 0
        for k in range(len(self._grippers)):
            all_arms |= 4 << k
        for solid in solids:
            surface = _surface(solid.friction, 2, 1 | all_arms, self.period)
            for part in solid.parts:
                add_part(spec, world, part, solid.T_world_body, solid.name, **surface)
        for item in self._objects:
            body = world.add_body(name=item.name)
            body.add_freejoint(name=item.name)
            add_object(body, item, **_surface(item.friction, 1, 1, self.period, item.shape))
        for k, gripper in enumerate(self._grippers):
            bit = 4 << k
            others = 1 | all_arms & ~bit
            geom_attributes = _surface(friction, bit, others, self.period)
            geom_attributes["mass"] = 0.0  # the link's body has the mass
            self._add_links(spec, gripper, geom_attributes)

    def _add_links(self, spec: mujoco.MjSpec, gripper: Gripper, geom_attributes: dict) -> None:
        for link in gripper.links:
            name = f"{gripper.robot}/{link.name}"
            body = spec.worldbody.add_body(
                name=name, gravcomp=1.0, mass=_LINK_MASS, inertia=[_LINK_INERTIA] * 3, explicitinertial=True
            )
            body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
            body.add_freejoint(name=name)
            if link.meshes:
                add_part(spec, body, _whole(link), np.eye(4), gripper.robot, **geom_attributes)
            if link is gripper.hand:
                self._add_jaws(spec, body, gripper, geom_attributes)

    def _add_jaws(self, spec: mujoco.MjSpec, hand: mujoco.MjsBody, gripper: Gripper, geom_attributes: dict) -> None:
        first_name = ""
        for jaw in gripper.jaws:
            name = f"{gripper.robot}/{jaw.body.name}"
            body = hand.add_body(
                name=name, gravcomp=1.0, mass=1e-3, inertia=[1e-9] * 3, ipos=jaw.point, explicitinertial=True
            )
            hinge = mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=name, type=hinge, axis=jaw.axis, pos=jaw.point, armature=_JAW_INERTIA)
            for part in jaw.body.meshes:
                add_part(spec, body, part, jaw.T_hand_jaw, gripper.robot, **geom_attributes)
            if not first_name:
                first_name = name
                continue
            # Jaws rotate together, in proportion to their ratios: a polynomial of MuJoCo with only its linear term.
            polynomial = [0.0] * 12
            polynomial[1] = jaw.ratio / gripper.jaws[0].ratio
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT,
                name1=name,
                name2=first_name,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                data=polynomial,
            )

    def _start(self, q: Mapping[str, Array]) -> None:
        """Set links and objects to their poses at the start."""
        q_start = {}
        for robot, values in q.items():
            q_start[robot] = np.asarray(values, float)
        self._links = _Links(self._grippers, self._model, self._data, q_start, self.period)
        self._q_names: list[str] = []
        for gripper in self._grippers:
            self._q_names.append(ROBOT_Q.of(gripper.robot))
        self._rotation_values = np.zeros(9)
        self._object_places: list[tuple[str, Array]] = []  # name of the signal, view on the object's pose in qpos
        for item in self._objects:
            start = self._model.joint(item.name).qposadr[0]
            place = self._data.qpos[start : start + 7]
            place[:3] = item.T_world_object[:3, 3]
            place[3:] = spatial.quat_from_matrix_wxyz(item.T_world_object[:3, :3])
            self._object_places.append((OBJECT_POSE.of(item.name), place))
        self._last_places = [b""] * len(self._object_places)

    def _find_owners(self) -> list[GeomOwner]:
        """Return for each geom its object, or its instrument and jaw."""
        m = self._model
        nobody = GeomOwner()
        by_body: dict[int, GeomOwner] = {}
        for i, item in enumerate(self._objects):
            by_body[m.body(item.name).id] = GeomOwner(item=i)
        for k, gripper in enumerate(self._grippers):
            for link in gripper.links:
                by_body[m.body(f"{gripper.robot}/{link.name}").id] = GeomOwner(arm=k)
            for i, jaw in enumerate(gripper.jaws):
                by_body[m.body(f"{gripper.robot}/{jaw.body.name}").id] = GeomOwner(arm=k, jaw=i)
        return [by_body.get(body, nobody) for body in m.geom_bodyid.tolist()]

    def _geoms_of(self, solids: Sequence[Solid], names: Sequence[str]) -> set[int]:
        """Return the geoms of the fixed parts with these names."""
        # MuJoCo keeps the order in which the geoms of the World's body were added.
        fixed = np.flatnonzero(self._model.geom_bodyid == 0).tolist()
        parts: list[Mesh] = []
        for solid in solids:
            parts.extend(solid.parts)
        geoms = set()
        for geom, part in zip(fixed, parts, strict=True):
            if part.name in names:
                geoms.add(geom)
        return geoms

    def _require_apart(self) -> None:
        m = self._model
        for contact in self._data.contact:
            first, second = contact.geom
            is_object = self._owners[first].item != NONE or self._owners[second].item != NONE
            if contact.dist < -_LARGEST_OVERLAP and is_object:
                first_name = m.body(m.geom_bodyid[first]).name
                second_name = m.body(m.geom_bodyid[second]).name
                if second_name == "world":
                    second_name = "a fixed part"
                raise WorldError(
                    f"'{first_name}' and '{second_name}' overlap by {-contact.dist * 1e3:.2f} mm at the start "
                    f"(allowed: {_LARGEST_OVERLAP * 1e3:g} mm): move one of them"
                )

    # -- the tick -----------------------------------------------------------------------------------------

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, ArrayLike]:
        """Move the instruments to their joint values, and the objects by the contact forces."""
        q = [signals.now[name] for name in self._q_names]
        self._links.lead(q)
        mujoco.mj_step(self._model, self._data)
        self._links.settle()
        changed = self._signals()
        if self._contact_planes is not None and self._last_contacts is not None:
            changed |= self._contact_planes.planes(self._data, self._links.place, q, self._last_contacts.holders)
        return changed

    def _signals(self) -> dict[str, ArrayLike]:
        """Return the signals that have changed."""
        changed: dict[str, ArrayLike] = {}
        for k, (name, place) in enumerate(self._object_places):
            content = place.tobytes()
            if content == self._last_places[k]:
                continue
            self._last_places[k] = content
            T = np.eye(4)
            mujoco.mju_quat2Mat(self._rotation_values, place[3:])
            T[:3, :3] = self._rotation_values.reshape(3, 3)
            T[:3, 3] = place[:3]
            changed[name] = T.ravel()
        contacts = self._contacts()
        if contacts == self._last_contacts:
            return changed
        self._last_contacts = contacts
        for item, holder in zip(self._objects, contacts.holders, strict=True):
            changed[OBJECT_HOLDER.of(item.name)] = float(holder)
        for k, gripper in enumerate(self._grippers):
            changed[ROBOT_TOUCHES.of(gripper.robot)] = float(k in contacts.touches)
            changed[ROBOT_MEETS.of(gripper.robot)] = float(k in contacts.meets)
        if self._rubbed:
            for k, item in enumerate(self._objects):
                changed[OBJECT_RUBS.of(item.name)] = float(k in contacts.rubs)
        return changed

    def _contacts(self) -> _Contacts:
        """Sort the contacts of the last step."""
        contacts = _Contacts([NONE] * len(self._objects), set(), set(), set())
        if not self._data.ncon:
            self._holding_grippers = [[] for _ in self._objects]
            return contacts
        contact = self._data.contact
        grips: dict[tuple[int, int], set[int]] = {}  # (object, instrument) -> jaws at the object
        for (g, h), distance in zip(contact.geom.tolist(), contact.dist.tolist(), strict=True):
            if distance >= 0:
                continue
            first = self._owners[g]
            second = self._owners[h]
            if g in self._rubbed or h in self._rubbed:
                item = max(first.item, second.item)  # one of the two geoms is the fixed part
                if item != NONE:
                    contacts.rubs.add(item)
            if first.arm == NONE:
                first, second = second, first
            if first.arm == NONE:
                continue
            if second.arm != NONE:
                contacts.meets.update((first.arm, second.arm))
            elif second.item == NONE:
                contacts.touches.add(first.arm)
            elif first.jaw != NONE:
                grips.setdefault((second.item, first.arm), set()).add(first.jaw)
        self._find_holders(grips, contacts.holders)
        return contacts

    def _find_holders(self, grips: Mapping[tuple[int, int], set[int]], holders: list[int]) -> None:
        """Write the instrument that holds each object, the latest one; `grips`: jaws at (object, instrument)."""
        holding: list[set[int]] = [set() for _ in self._objects]
        for (item, arm), jaws in grips.items():
            if len(jaws) == len(self._grippers[arm].jaws):
                holding[item].add(arm)
        for item, arms in enumerate(holding):
            before = self._holding_grippers[item]
            # those that still hold the object, in their order, then the new ones
            holders_by_time = []
            for arm in before:
                if arm in arms:
                    holders_by_time.append(arm)
            self._holding_grippers[item] = holders_by_time + sorted(arms.difference(before))
            if arms:
                holders[item] = self._holding_grippers[item][-1]


class _Links:
    """The links of all instruments in MuJoCo: free bodies whose positions and velocities are set in every step."""

    def __init__(
        self, grippers: Sequence[Gripper], m: mujoco.MjModel, d: mujoco.MjData, q: Mapping[str, Array], period: float
    ) -> None:
        self._grippers = grippers
        self._m = m
        self._d = d
        self._period = period
        qpos: list[int] = []
        dofs: list[int] = []
        jaw_qpos: list[int] = []
        jaw_dofs: list[int] = []
        ratios: list[float] = []
        efforts: list[float] = []
        for gripper in grippers:
            for link in gripper.links:
                joint = m.joint(f"{gripper.robot}/{link.name}")
                qpos.extend(range(joint.qposadr[0], joint.qposadr[0] + 7))
                dofs.extend(range(joint.dofadr[0], joint.dofadr[0] + 6))
            for jaw in gripper.jaws:
                joint = m.joint(f"{gripper.robot}/{jaw.body.name}")
                jaw_qpos.append(joint.qposadr[0])
                jaw_dofs.append(joint.dofadr[0])
                ratios.append(jaw.ratio)
                efforts.append(gripper.effort)
        self._qpos = np.array(qpos, int)
        self._dofs = np.array(dofs, int)
        self._jaw_qpos = np.array(jaw_qpos, int)
        self._jaw_dofs = np.array(jaw_dofs, int)
        self._ratios = np.array(ratios)
        self._efforts = np.array(efforts)
        self._link_poses = np.zeros(len(qpos))
        self._jaw_angles = np.zeros(len(jaw_qpos))
        self._target_qpos = d.qpos.copy()
        self._velocities = np.zeros(m.nv)
        # views on `_link_poses`: position and quaternion of each link of each instrument
        self._pose_views: list[list[tuple[Array, Array]]] = []
        row = 0
        for gripper in grippers:
            views = self._link_poses.reshape(-1, 7)[row : row + len(gripper.links)]
            rows = []
            for view in views:
                rows.append((view[:3], view[3:]))
            self._pose_views.append(rows)
            row += len(gripper.links)
        self._last_q = [b""] * len(grippers)
        self._locate([q[gripper.robot] for gripper in grippers])
        self.settle()
        d.qpos[self._jaw_qpos] = self._jaw_angles

    def _locate(self, q: Sequence[Array]) -> None:
        """Compute link poses and jaw angles; `q` has joint values (n,) of each instrument."""
        first = 0
        for k, gripper in enumerate(self._grippers):
            end = first + len(gripper.jaws)
            content = q[k].tobytes()
            if content != self._last_q[k]:
                self._last_q[k] = content
                for (point, quaternion), pose in zip(self._pose_views[k], gripper.place(q[k]), strict=True):
                    point[...] = pose[:3]
                    mujoco.mju_mat2Quat(quaternion, pose[3:])
                if gripper.jaws:
                    self._jaw_angles[first:end] = self._ratios[first:end] * q[k][gripper.jaw]
            first = end

    def lead(self, q: Sequence[Array]) -> None:
        """Set the torques of the jaws, and the velocities with which the links reach joint values q (n,) in a step."""
        self._locate(q)
        d = self._d
        dt = self._period
        self._target_qpos[:] = d.qpos
        self._target_qpos[self._qpos] = self._link_poses
        mujoco.mj_differentiatePos(self._m, self._velocities, dt, d.qpos, self._target_qpos)
        d.qvel[self._dofs] = self._velocities[self._dofs]
        # a jaw that touches nothing reaches its angle in this step
        angle_error = self._jaw_angles - d.qpos[self._jaw_qpos] - d.qvel[self._jaw_dofs] * dt
        torque = np.minimum(_JAW_INERTIA / dt**2 * angle_error, self._efforts)
        d.qfrc_applied[self._jaw_dofs] = np.maximum(torque, -self._efforts)

    def place(self, qpos: Array) -> None:
        """Write the poses of all links and the angles of all jaws at the latest joint values into qpos."""
        qpos[self._qpos] = self._link_poses
        qpos[self._jaw_qpos] = self._jaw_angles

    def settle(self) -> None:
        """Set the links exactly to the poses given by the joint values."""
        self._d.qpos[self._qpos] = self._link_poses


def _require_valid(item: Movable) -> None:
    """Raise `WorldError` for an object whose mass, friction or size is out of range."""
    for quantity, value, low in (("mass", item.mass, 1e-6), ("friction", item.friction, 0.0)):
        if not (value >= low and np.isfinite(value)):
            raise WorldError(f"object '{item.name}': {quantity} is {value:g}; it must be finite and at least {low:g}")
    for length in item.size:
        if not length > 0:  # also a size that is not a number
            raise WorldError(f"object '{item.name}': its size is {item.size}; each length must be above 0")


def _empty(period: float, gravity: tuple[float, float, float]) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = period
    option.gravity = gravity
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 10.0
    option.noslip_iterations = 5  # without it, objects creep along surfaces on which friction holds them
    option.tolerance = 1e-12
    option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # objects at rest cost nothing until they are touched
    return spec


def _surface(friction: float, kind: int, touches: int, period: float, shape: str = "") -> dict:
    condim = 4 if shape == "ball" else 3  # other shapes touch at several points, which resist turning
    return {
        "friction": [friction, friction * _PATCH_RADIUS, 0.0],
        "condim": condim,
        "contype": kind,
        "conaffinity": touches,
        "solref": [2 * period, 1.0],
        "solimp": [0.99, 0.9999, 1e-4, 0.5, 2.0],
    }


def _whole(body: Body) -> Mesh:
    """Return all parts of a body as one mesh; its convex hull is the collision shape."""
    vertices = np.concatenate([part.vertices for part in body.meshes])
    no_triangles = np.zeros((0, 3), np.int32)
    return Mesh(body.name, vertices, no_triangles)
