"""Movable objects in contact with robots and fixed parts: MuJoCo moves the objects, joint values move the robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.model.body import Body, Mesh
from twin.model.movable import Movable
from twin.simulation.plants.contact.feel import Feel
from twin.simulation.plants.contact.gripper import Gripper
from twin.simulation.plants.contact.shapes import Solid, add_object, add_part
from twin.simulation.world import Block, Signals

_LINK_MASS, _LINK_INERTIA = 10.0, 0.1
"""Mass in kg and moment of inertia in kg m2 of the simulated links of an instrument.

The joint values alone move the links; this inertia only keeps contact forces from moving them within a tick.
"""

_JAW_INERTIA = 1e-5
"""Moment of inertia in kg m2 of a jaw with its drive, about the axis of the jaw; ASSUMED."""

_PATCH = 0.5e-3
"""Radius in m of the contact patch that resists turning about the normal; ASSUMED."""

_DEEPEST = 0.1e-3
"""Largest overlap in m of an object with anything at the start."""


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
            for what, value, low in (("mass", item.mass, 1e-6), ("friction", item.friction, 0.0)):
                if not (value >= low and np.isfinite(value)):
                    raise WorldError(
                        f"object '{item.name}': {what} is {value:g}; it must be finite and at least {low:g}"
                    )
            if not all(s > 0 for s in item.size):
                raise WorldError(f"object '{item.name}': its size is {item.size}; each length must be above 0")
        self._objects, self._grippers, self.period = tuple(objects), tuple(grippers), period
        spec = _empty(period, gravity)
        self._add(spec, solids, friction)
        m = self._model = spec.compile()
        d = self._data = mujoco.MjData(m)
        self._start(q or {})
        self._sort()
        names = [part.name for solid in solids for part in solid.parts]  # in the order of the geoms of the World's body
        fixed = np.flatnonzero(m.geom_bodyid == 0).tolist()
        self._rubbed = {geom for geom, name in zip(fixed, names, strict=True) if name in rubbed}
        mujoco.mj_forward(m, d)
        self._require_apart()
        self._holding: list[list[int]] = [[] for _ in self._objects]  # grippers at each object, by time of grasp
        self._said: tuple[list[int], set[int], set[int], set[int]] | None = None
        self.outputs = self._signals()
        self._feel = Feel(m, self._grippers, [o.name for o in self._objects], self._whose) if feels else None
        if self._feel is not None:
            self.outputs |= self._feel.outputs

    # -- the model ----------------------------------------------------------------------------------------

    def _add(self, spec: mujoco.MjSpec, solids: Sequence[Solid], friction: float) -> None:
        world = spec.worldbody
        arms = sum(4 << k for k in range(len(self._grippers)))
        for solid in solids:
            for part in solid.parts:
                add_part(
                    spec,
                    world,
                    part,
                    solid.T_world_body,
                    solid.name,
                    **_surface(solid.friction, 2, 1 | arms, self.period),
                )
        for item in self._objects:
            body = world.add_body(name=item.name)
            body.add_freejoint(name=item.name)
            add_object(body, item, **_surface(item.friction, 1, 1, self.period, item.shape))
        for k, gripper in enumerate(self._grippers):
            bit = 4 << k
            others = 1 | arms & ~bit
            skin = _surface(friction, bit, others, self.period) | {"mass": 0.0}
            for link in gripper.links:
                name = f"{gripper.robot}/{link.name}"
                body = world.add_body(
                    name=name, gravcomp=1.0, mass=_LINK_MASS, inertia=[_LINK_INERTIA] * 3, explicitinertial=True
                )
                body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
                body.add_freejoint(name=name)
                if link.meshes:
                    add_part(spec, body, _whole(link), np.eye(4), gripper.robot, **skin)
                if link is gripper.hand:
                    self._add_jaws(spec, body, gripper, skin)

    def _add_jaws(self, spec: mujoco.MjSpec, hand: mujoco.MjsBody, gripper: Gripper, skin: dict) -> None:
        first: tuple[str, float] | None = None
        for jaw in gripper.jaws:
            name = f"{gripper.robot}/{jaw.body.name}"
            body = hand.add_body(
                name=name, gravcomp=1.0, mass=1e-3, inertia=[1e-9] * 3, ipos=jaw.point, explicitinertial=True
            )
            hinge = mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=name, type=hinge, axis=jaw.axis, pos=jaw.point, armature=_JAW_INERTIA)
            for part in jaw.body.meshes:
                add_part(spec, body, part, jaw.T_hand_jaw, gripper.robot, **skin)
            if first is None:
                first = name, jaw.ratio
            else:  # jaws rotate together, in proportion to their ratios
                spec.add_equality(
                    type=mujoco.mjtEq.mjEQ_JOINT,
                    name1=name,
                    name2=first[0],
                    objtype=mujoco.mjtObj.mjOBJ_JOINT,
                    data=[0, jaw.ratio / first[1], *([0] * 10)],
                )

    def _start(self, q: Mapping[str, Array]) -> None:
        m, d = self._model, self._data
        start = {name: np.asarray(values, float) for name, values in q.items()}
        self._links = _Links(self._grippers, m, d, start, self.period)
        self._q = [f"{g.robot}.q" for g in self._grippers]
        self._R = np.zeros(9)
        self._places: list[tuple[str, Array]] = []
        for item in self._objects:
            k = m.joint(item.name).qposadr[0]
            place, T = d.qpos[k : k + 7], item.T_world_object
            place[:3], place[3:] = T[:3, 3], spatial.quat_from_matrix_wxyz(T[:3, :3])
            self._places.append((f"{item.name}.pose", place))
        self._seen = [b""] * len(self._places)

    def _sort(self) -> None:
        """Store for each geom the indices of its object, instrument and jaw; -1: none."""
        m = self._model
        whose = {m.body(item.name).id: (i, -1, -1) for i, item in enumerate(self._objects)}
        for k, gripper in enumerate(self._grippers):
            whose |= {m.body(f"{gripper.robot}/{b.name}").id: (-1, k, -1) for b in gripper.links}
            whose |= {m.body(f"{gripper.robot}/{j.body.name}").id: (-1, k, i) for i, j in enumerate(gripper.jaws)}
        self._whose = [whose.get(b, (-1, -1, -1)) for b in m.geom_bodyid.tolist()]

    def _require_apart(self) -> None:
        m, d = self._model, self._data
        for contact in d.contact:
            if contact.dist < -_DEEPEST and max(self._whose[g][0] for g in contact.geom) >= 0:
                one, other = (m.body(m.geom_bodyid[g]).name for g in contact.geom)
                raise WorldError(
                    f"'{one}' and '{other if other != 'world' else 'a fixed part'}' overlap by "
                    f"{-contact.dist * 1e3:.2f} mm at the start (allowed: {_DEEPEST * 1e3:g} mm): move one of them"
                )

    # -- the tick -----------------------------------------------------------------------------------------

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, ArrayLike]:
        """Move the instruments to their joint values, and the objects by the contact forces."""
        now = signals.now
        q = [now[name] for name in self._q]
        self._links.lead(q)
        mujoco.mj_step(self._model, self._data)
        self._links.settle()
        out = self._signals()
        if self._feel is not None and self._said is not None:
            out |= self._feel.planes(self._data, self._links.place, q, self._said[0])
        return out

    def _signals(self) -> dict[str, ArrayLike]:
        """Return the signals that have changed."""
        out: dict[str, ArrayLike] = {}
        for k, (name, place) in enumerate(self._places):
            if (now := place.tobytes()) != self._seen[k]:
                self._seen[k] = now
                T = np.eye(4)
                mujoco.mju_quat2Mat(self._R, place[3:])
                T[:3, :3], T[:3, 3] = self._R.reshape(3, 3), place[:3]
                out[name] = T.ravel()
        said = self._contacts()
        if said != self._said:
            self._said = said
            holders, touches, meets, rubs = said
            out |= {f"{item.name}.holder": float(k) for item, k in zip(self._objects, holders, strict=True)}
            for k, gripper in enumerate(self._grippers):
                out[f"{gripper.robot}.touches"], out[f"{gripper.robot}.meets"] = float(k in touches), float(k in meets)
            if self._rubbed:
                out |= {f"{item.name}.rubs": float(k in rubs) for k, item in enumerate(self._objects)}
        return out

    def _contacts(self) -> tuple[list[int], set[int], set[int], set[int]]:
        """Return (holder of each object, instruments at fixed parts, instruments at each other, objects that rub)."""
        holders, touches, meets, rubs = [-1] * len(self._objects), set[int](), set[int](), set[int]()
        if not self._data.ncon:
            self._holding = [[] for _ in self._objects]
            return holders, touches, meets, rubs
        contact, whose = self._data.contact, self._whose
        grips: dict[tuple[int, int], set[int]] = {}
        for (g, h), distance in zip(contact.geom.tolist(), contact.dist.tolist(), strict=True):
            if distance >= 0:
                continue
            (item, arm, jaw), (item_h, arm_h, jaw_h) = whose[g], whose[h]
            if g in self._rubbed or h in self._rubbed:
                rubs |= {max(item, item_h)} - {-1}
            if arm < 0:
                item, arm, jaw, item_h, arm_h = item_h, arm_h, jaw_h, item, arm
            if arm < 0:
                continue
            if arm_h >= 0:
                meets |= {arm, arm_h}
            elif item_h < 0:
                touches.add(arm)
            elif jaw >= 0:
                grips.setdefault((item_h, arm), set()).add(jaw)
        for item, before in enumerate(self._holding):
            hold = {a for (i, a), jaws in grips.items() if i == item and len(jaws) == len(self._grippers[a].jaws)}
            self._holding[item] = [a for a in before if a in hold] + sorted(hold.difference(before))
            if hold:
                holders[item] = self._holding[item][-1]
        return holders, touches, meets, rubs


class _Links:
    """The links of all instruments in MuJoCo: free bodies whose positions and velocities are set in every step."""

    def __init__(
        self, grippers: Sequence[Gripper], m: mujoco.MjModel, d: mujoco.MjData, q: Mapping[str, Array], period: float
    ) -> None:
        self._grippers, self._m, self._d, self._period = grippers, m, d, period
        links = [m.joint(f"{g.robot}/{b.name}") for g in grippers for b in g.links]
        jaws = [m.joint(f"{g.robot}/{j.body.name}") for g in grippers for j in g.jaws]
        self._qpos = np.array([j.qposadr[0] + i for j in links for i in range(7)], int)
        self._dofs = np.array([j.dofadr[0] + i for j in links for i in range(6)], int)
        self._jaw_qpos = np.array([j.qposadr[0] for j in jaws], int)
        self._jaw_dofs = np.array([j.dofadr[0] for j in jaws], int)
        self._ratios = np.array([j.ratio for g in grippers for j in g.jaws])
        self._efforts = np.array([g.effort for g in grippers for _ in g.jaws])
        self._wanted, self._angles = np.zeros(len(self._qpos)), np.zeros(len(jaws))
        self._all, self._v = d.qpos.copy(), np.zeros(m.nv)
        each = iter(self._wanted.reshape(-1, 7))
        self._rows = [[(row[:3], row[3:]) for _, row in zip(g.links, each, strict=False)] for g in grippers]
        self._last = [b""] * len(grippers)
        self._locate([q[g.robot] for g in grippers])
        self.settle()
        d.qpos[self._jaw_qpos] = self._angles

    def _locate(self, q: Sequence[Array]) -> None:
        """Compute link poses and jaw angles; `q` has joint values (n,) of each instrument."""
        jaw = 0
        for k, (gripper, values) in enumerate(zip(self._grippers, q, strict=True)):
            count = len(gripper.jaws)
            if (given := values.tobytes()) != self._last[k]:
                self._last[k] = given
                for (point, quat), found in zip(self._rows[k], gripper.place(values), strict=True):
                    point[...] = found[:3]
                    mujoco.mju_mat2Quat(quat, found[3:])
                if count:
                    self._angles[jaw : jaw + count] = self._ratios[jaw : jaw + count] * values[gripper.jaw]
            jaw += count

    def lead(self, q: Sequence[Array]) -> None:
        """Set the torques of the jaws, and the velocities with which the links reach joint values q (n,) in a step."""
        self._locate(q)
        d, dt = self._d, self._period
        self._all[:] = d.qpos
        self._all[self._qpos] = self._wanted
        mujoco.mj_differentiatePos(self._m, self._v, dt, d.qpos, self._all)
        d.qvel[self._dofs] = self._v[self._dofs]
        # a jaw that touches nothing reaches its angle in this step
        off = self._angles - d.qpos[self._jaw_qpos] - d.qvel[self._jaw_dofs] * dt
        torque = np.minimum(_JAW_INERTIA / dt**2 * off, self._efforts)
        d.qfrc_applied[self._jaw_dofs] = np.maximum(torque, -self._efforts)

    def place(self, qpos: Array) -> None:
        """Write the poses of all links and the angles of all jaws at the latest joint values into qpos."""
        qpos[self._qpos], qpos[self._jaw_qpos] = self._wanted, self._angles

    def settle(self) -> None:
        """Set the links exactly to the poses given by the joint values."""
        self._d.qpos[self._qpos] = self._wanted


def _empty(period: float, gravity: tuple[float, float, float]) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.gravity = period, gravity
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
    option.noslip_iterations = 5  # without it, objects creep along surfaces on which friction holds them
    option.tolerance = 1e-12
    option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # objects at rest cost nothing until they are touched
    return spec


def _surface(friction: float, kind: int, touches: int, period: float, shape: str = "") -> dict:
    return {
        "friction": [friction, friction * _PATCH, 0.0],
        "condim": 4 if shape == "ball" else 3,  # other shapes touch at several points, which resist turning
        "contype": kind,
        "conaffinity": touches,
        "solref": [2 * period, 1.0],
        "solimp": [0.99, 0.9999, 1e-4, 0.5, 2.0],
    }


def _whole(body: Body) -> Mesh:
    """Return all parts of a body as one mesh; its convex hull is the collision shape."""
    return Mesh(body.name, np.concatenate([part.vertices for part in body.meshes]), np.zeros((0, 3), np.int32))
