"""Soft organs and links of instruments in MuJoCo: links have given poses, and organs deform in contact with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import mujoco
import numpy as np

from twin.core.errors import WorldError
from twin.core.spatial import Array, Index
from twin.core.units import MM
from twin.model.body import Body
from twin.model.hull import require_hull
from twin.model.surface import inside
from twin.model.tissue import Tissue
from twin.simulation.plants.contact.collision_shapes import add_part
from twin.simulation.plants.tissue.organ import (
    MOST_ORGANS,
    NO_TOUCH,
    SAMPLE_DISTANCE,
    SURFACE_RADIUS,
    Organ,
    Touch,
    require_valid,
)

PERIOD = 8e-3
"""Time in s between two steps."""

LONGEST_PERIOD = 20e-3
"""Longest time in s between two steps for which the organs were tested."""

_LINK_MASS = 10.0
_LINK_INERTIA = 0.1
"""Mass in kg and moment of inertia in kg m2 of a link, so large that contact forces do not move links within a step."""

_LARGEST_LINK_STEP = 20 * MM
"""Largest distance in m that a link moves in contact within a step; a link that moves farther is set to its new
pose."""

_STEPS_PER_TEST = 12
"""Number of steps between two tests whether a link is inside an organ."""

_REST_DISTANCE = 5e-6
"""Organs are at rest if no node is farther than this distance in m from its rest position, and no node moves farther
than this distance in a step. The distance is less than a step of the quantised vertices in the stream."""

_ITERATIONS = 400
"""Maximum number of iterations of MuJoCo's solvers. With MuJoCo's default of 100, the solver of the stiffness ended at
a relative residual of 1.02e-8 instead of 1e-8 for a gallbladder half out of its bed."""

_CROSSING_DEPTH = 3 * SURFACE_RADIUS
"""Depth in m of a contact above which the surfaces of two organs cross: each surface is thickened by `SURFACE_RADIUS`,
and contact keeps the surfaces apart within 0.2 mm. If surfaces cross, contact forces would lock the organs together."""

_LEAST_COMPRESSION = 0.3
"""Limit of `Organ.compression` below which a link that touches the organ counts as inside the organ; ASSUMED.
MuJoCo's elasticity cannot prevent such a compression: a finite force inverts a cell."""

_LEAST_FRONT_PRODUCT = 0.3
"""Smallest mean scalar product of contact normals and surface normals at which a link is in front of a surface. The
mean is 0.5 to 1 if a link presses, and less than 0.1 if the surface has jumped over the link."""

_LINK_PREFIX = "link:"
"""Prefix of the names of links in MuJoCo."""


@dataclass(frozen=True)
class Tool:
    """A link that can touch organs: the name of the robot, and the body of the link."""

    robot: str
    body: Body

    @property
    def name(self) -> str:
        """Name, "<robot>/<body>"."""
        return f"{self.robot}/{self.body.name}"


class Organs:
    """Steps organs that touch each other and links; the poses of the links are given.

    The organs are not stepped while all of them are at rest and no link moves near an organ. A link that jumps into an
    organ, by more than 20 mm within a step, does not touch this organ until the link is outside again. Two organs whose
    surfaces cross, because an instrument has pressed one through the other, do not touch each other until they are
    apart.

    Attributes:
        tissues: the organs.
        tools: the links.
        period: time in s between two steps.
        operable: the organ that can be grasped and freed, or None.
        crossed: pairs of organs whose surfaces cross, as pairs of their indices.
    """

    def __init__(
        self,
        tissues: Sequence[Tissue],
        tools: Sequence[Tool],
        poses: Sequence[Array],
        period: float = PERIOD,
        operable_name: str = "",
    ) -> None:
        """Build the MuJoCo model.

        Args:
            tissues: the organs.
            tools: the links that can touch the organs.
            poses: T_world_link (4, 4) of each link at the start.
            period: time in s between two steps.
            operable_name: name of the organ that can be grasped, and whose pins can be freed one by one.

        Raises:
            TwinError: the pins of an organ do not hold the organ in place.
            WorldError: a number is out of range, two organs overlap, or a link is inside an organ.
        """
        self.tissues = tuple(tissues)
        self.tools = tuple(tools)
        self.period = period
        for tissue in tissues:
            require_valid(tissue)
        if len(tissues) > MOST_ORGANS:
            raise WorldError(f"there are {len(tissues)} organs; at most {MOST_ORGANS} are simulated")
        self.crossed: set[tuple[int, int]] = set()
        self._organs: dict[str, Organ] = {}
        for k, tissue in enumerate(tissues):
            self._organs[tissue.name] = Organ(tissue, k, tissue.name == operable_name)
        self.operable = self._organs[operable_name] if operable_name else None
        self._samples: list[Array] = []
        self._corners: list[Array] = []
        for tool in tools:
            points = _sample_points(tool)
            self._samples.append(points)
            self._corners.append(_corners(points))
        self._model = self._compiled()
        self._data = mujoco.MjData(self._model)
        for organ in self._organs.values():
            organ.connect(self._model, self._data)
        qpos = [np.zeros(0, int)]
        dofs = [np.zeros(0, int)]
        for organ in self._organs.values():
            qpos.append(organ.qpos)
            dofs.append(organ.dofs)
        self._organ_qpos = np.concatenate(qpos)
        self._organ_dofs = np.concatenate(dofs)
        self._find_links()
        self._link_qpos = np.zeros(len(self._link_qpos_indices))
        self._velocities = np.zeros(self._model.nv)
        self._target_qpos = self._data.qpos.copy()
        self._steps = 0
        self._poses = [np.array(T, float) for T in poses]
        self._place(poses)
        self.reset()
        self._require_links_outside()
        self._require_apart()

    def _find_links(self) -> None:
        """Find the joints and geoms of the links in the compiled model."""
        m = self._model
        qpos: list[int] = []
        dofs: list[int] = []
        self._geoms: list[Index] = []
        self._link_of = np.zeros(m.ngeom, int)
        for k, tool in enumerate(self.tools):
            joint = m.joint(_LINK_PREFIX + tool.name)
            qpos.extend(range(joint.qposadr[0], joint.qposadr[0] + 7))
            dofs.extend(range(joint.dofadr[0], joint.dofadr[0] + 6))
            geoms = np.flatnonzero(m.geom_bodyid == m.body(_LINK_PREFIX + tool.name).id)
            self._geoms.append(geoms)
            self._link_of[geoms] = k
        self._link_qpos_indices = np.array(qpos, int)
        self._link_dof_indices = np.array(dofs, int)

    def _require_links_outside(self) -> None:
        """Raise `WorldError` if a link is inside an organ."""
        for organ in self._organs.values():
            for k, tool in enumerate(self.tools):
                if organ.contains(self._samples[k], self._corners[k], self._poses[k]):
                    raise WorldError(
                        f"'{tool.name}' is inside '{organ.tissue.name}' at the start; start the robot outside, or move "
                        "the organ"
                    )

    def _compiled(self) -> mujoco.MjModel:
        elements = ""
        bits = 0
        for organ in self._organs.values():
            elements += organ.xml(self.period)
            bits |= organ.bit
        spec = mujoco.MjSpec.from_string(
            f'<mujoco><option timestep="{self.period!r}" integrator="discrete" gravity="0 0 0" '
            f'iterations="{_ITERATIONS}"/>'
            f"<worldbody>{elements}</worldbody></mujoco>"
        )
        links = mujoco.MjSpec()
        for tool in self.tools:
            _add_link(links, tool, self.period, bits)
        spec.attach(links, frame=spec.worldbody.add_frame(), prefix=_LINK_PREFIX)
        for organ in self._organs.values():
            organ.constrain(spec)
        return spec.compile()

    def _require_apart(self) -> None:
        """Raise `WorldError` if two organs touch at rest, or if one is inside another one."""
        d = self._data
        mujoco.mj_forward(self._model, d)
        for contact in d.contact[: d.ncon]:
            first, second = contact.flex
            if first >= 0 and second >= 0:  # MuJoCo's index of a soft body; -1: a link
                first_name = self.tissues[first].name
                second_name = self.tissues[second].name
                least_mm = 2 * SURFACE_RADIUS / MM
                raise WorldError(
                    f"'{first_name}' and '{second_name}' overlap or are less than {least_mm:g} mm apart at the "
                    "start; draw them further apart"
                )
        for a, b in permutations(self.tissues, 2):
            if inside(a.surface.vertices[:1], b.surface.vertices, b.surface.triangles)[0]:
                raise WorldError(f"'{a.name}' is inside '{b.name}' at the start; draw them apart")
        self.reset()

    @property
    def nodes(self) -> dict[str, Array]:
        """Nodes (k, 3) of each organ in the World in m."""
        return {name: organ.nodes for name, organ in self._organs.items()}

    @property
    def within(self) -> dict[str, tuple[str, ...]]:
        """For each organ, the names of the links that are inside the organ, and therefore do not touch the organ."""
        names: dict[str, tuple[str, ...]] = {}
        for name, organ in self._organs.items():
            links = []
            for k in sorted(organ.within):
                links.append(self.tools[k].name)
            names[name] = tuple(links)
        return names

    def vertices(self, name: str) -> Array:
        """Return the vertices (n, 3) of an organ in the World in m."""
        organ = self._organs[name]
        return organ.tissue.weights @ organ.nodes

    def touches(self) -> dict[str, Touch]:
        """Return the contact of each organ in the last step."""
        return {name: organ.touch for name, organ in self._organs.items()}

    def reset(self) -> None:
        """Reset all organs to their drawn shape, at rest."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[self._link_qpos_indices] = self._link_qpos
        for organ in self._organs.values():
            if organ.hold is not None:
                organ.hold.reset()
            organ.touch = NO_TOUCH
            organ.read()
        for pair in tuple(self.crossed):
            self._let_meet(pair, True)
        self._is_at_rest = True

    def step(self, poses: Sequence[Array]) -> bool:
        """Set the links to `poses` T_world_link (4, 4), step the organs, and return whether an organ moved."""
        d = self._data
        organs = self._organs.values()
        before = self._poses
        jumped = self._place(poses)
        links_moved = not all(map(np.array_equal, before, poses))
        for k in jumped:
            d.qpos[self._link_qpos_indices[7 * k : 7 * k + 7]] = self._link_qpos[7 * k : 7 * k + 7]
        self._test_inside(jumped)
        self._reconnect()
        self._steps += 1
        is_held = self._begin_holds()
        if self._is_at_rest and not is_held and not (links_moved and self._is_approached()):
            d.qpos[self._link_qpos_indices] = self._link_qpos
            return False
        # The velocities of the links bring them to their poses at the end of the step.
        self._target_qpos[:] = d.qpos
        self._target_qpos[self._link_qpos_indices] = self._link_qpos
        mujoco.mj_differentiatePos(self._model, self._velocities, self.period, d.qpos, self._target_qpos)
        d.qvel[self._link_dof_indices] = self._velocities[self._link_dof_indices]
        nodes_before = [organ.nodes for organ in organs]
        for organ in organs:
            organ.begin()
        mujoco.mj_step(self._model, d)
        self._require_finite()
        for organ in organs:
            organ.read()
            if organ.hold is not None:
                organ.hold.end()
        self._read_contacts()
        d.qpos[self._link_qpos_indices] = self._link_qpos
        self._is_at_rest = d.ncon == 0 and not is_held and self._is_still()
        if self._is_at_rest:
            self.reset()
        else:
            for organ in organs:
                organ.end()
        return any(not np.array_equal(organ.nodes, nodes) for organ, nodes in zip(organs, nodes_before, strict=True))

    def _begin_holds(self) -> bool:
        """Set the constraints of bed and jaws; return whether they may move the operable organ."""
        if self.operable is None or self.operable.hold is None:
            return False
        return self.operable.hold.begin(self.operable.tissue.nodes)

    def _require_finite(self) -> None:
        """Raise `WorldError` for a state that is not finite, which MuJoCo resets with only a warning."""
        warnings = mujoco.mjtWarning
        for kind in (warnings.mjWARN_BADQPOS, warnings.mjWARN_BADQVEL, warnings.mjWARN_BADQACC):
            if not self._data.warning[kind].number:
                continue
            names = ", ".join(f"'{tissue.name}'" for tissue in self.tissues)
            raise WorldError(
                f"the simulation of the organs {names} became unstable in step {self._steps} of {self.period * 1e3:g} "
                "ms; move the instruments more slowly, or give the organs a smaller Young's modulus"
            )

    def _is_still(self) -> bool:
        if not len(self._organ_qpos):
            return True
        displacement = np.abs(self._data.qpos[self._organ_qpos]).max()
        speed = np.abs(self._data.qvel[self._organ_dofs]).max()
        return bool(max(displacement, speed * self.period) < _REST_DISTANCE)

    def _read_contacts(self) -> None:
        """Read the contacts of the last step."""
        d = self._data
        for organ in self._organs.values():
            organ.touch = NO_TOUCH
        if not d.ncon:
            return
        contact = d.contact
        local = np.zeros((d.ncon, 6))
        for k, row in enumerate(local):
            mujoco.mj_contactForce(self._model, d, k, row)
        F = np.einsum("ki,kij->kj", local[:, :3], contact.frame.reshape(-1, 3, 3))
        flex = contact.flex
        of_two_organs = (flex >= 0).all(axis=1)
        self._let_cross(flex[of_two_organs & (contact.dist < -_CROSSING_DEPTH)])
        for index, organ in enumerate(self._organs.values()):
            at_organ = flex == index
            rows = np.flatnonzero(at_organ.any(axis=1))
            if not len(rows):
                continue
            is_compressed = organ.compression < _LEAST_COMPRESSION
            self._test_pierced(index, organ, is_compressed)
            if is_compressed:
                self._let_cross(flex[rows])
            deepest = rows[np.argmin(contact.dist[rows])]
            side = int(np.argmax(at_organ[deepest]))
            # MuJoCo gives the force on the second body of a contact
            force = F[at_organ[:, 1]].sum(axis=0) - F[at_organ[:, 0]].sum(axis=0)
            organ.touch = Touch(self._triangle(organ, deepest, side), force)

    def _triangle(self, organ: Organ, contact: int, side: int) -> int:
        """Return the organ's triangle at a contact; if MuJoCo names only a vertex, its first triangle."""
        element = int(self._data.contact.elem[contact, side])
        if element >= 0:
            return element
        vertex = self._data.contact.vert[contact, side]
        at_vertex = (organ.tissue.surface.triangles == vertex).any(axis=1)
        return int(np.argmax(at_vertex))

    # -- organs that cross ---------------------------------------------------------------------------------

    def _let_meet(self, pair: tuple[int, int], on: bool) -> None:
        """Let two organs touch each other (`on`), or pass through each other."""
        first, second = pair
        bit = self._organs[self.tissues[first].name].other_bit
        if on:
            self.crossed.discard(pair)
            self._model.flex_conaffinity[second] |= bit
        else:
            self.crossed.add(pair)
            self._model.flex_conaffinity[second] &= ~bit

    def _let_cross(self, flex: Index) -> None:
        """Let the organs of contacts (k, 2) pass through each other; rows with a link (-1) are ignored."""
        for first, second in np.sort(flex, axis=1).tolist():
            if first >= 0:
                self._let_meet((first, second), False)

    def _reconnect(self) -> None:
        """Let organs that have crossed touch each other again if they are apart."""
        if not self.crossed or self._steps % _STEPS_PER_TEST:
            return
        pairs = tuple(self.crossed)
        for pair in pairs:
            self._let_meet(pair, True)
        mujoco.mj_fwdPosition(self._model, self._data)
        for first, second in np.sort(self._data.contact.flex[: self._data.ncon], axis=1).tolist():
            if (first, second) in pairs:
                self._let_meet((first, second), False)

    # -- links --------------------------------------------------------------------------------------------

    def _place(self, poses: Sequence[Array]) -> list[int]:
        """Store poses T_world_link (4, 4) in MuJoCo's format; return the indices of the links that jumped."""
        jumped = []
        for k, T in enumerate(poses):
            row = self._link_qpos[7 * k : 7 * k + 7]
            row[:3] = T[:3, 3]
            mujoco.mju_mat2Quat(row[3:], np.ascontiguousarray(T[:3, :3]).ravel())
            if _largest_motion(self._corners[k], self._poses[k], T) > _LARGEST_LINK_STEP:
                jumped.append(k)
        self._poses = [np.array(T, float) for T in poses]
        return jumped

    def _is_approached(self) -> bool:
        """Return whether a link is so near that it may touch an organ; valid only for organs at rest."""
        for organ in self._organs.values():
            for k, T in enumerate(self._poses):
                if organ.approached(self._samples[k], self._corners[k], T):
                    return True
        return False

    def _test_inside(self, jumped: Sequence[int]) -> None:
        """Switch off contact between an organ and the links that jumped into it, until these links are outside."""
        for organ in self._organs.values():
            links = set(jumped)
            if self._steps % _STEPS_PER_TEST == 0:
                links |= organ.within
            for k in links:
                self._test_link(organ, k)

    def _test_pierced(self, index: int, organ: Organ, is_compressed: bool) -> None:
        """Treat touching links as inside an organ that `is_compressed` too far, or has jumped over them."""
        contact = self._data.contact
        by_links = (contact.flex[:, 1] == index) & (contact.geom[:, 0] >= 0) & (contact.elem[:, 1] >= 0)
        rows = np.flatnonzero(by_links)
        if not len(rows):
            return
        links = self._link_of[contact.geom[rows, 0]]
        if not is_compressed:
            corners = organ.tissue.surface.triangles[contact.elem[rows, 1]] + self._model.flex_vertadr[index]
            a = self._data.flexvert_xpos[corners[:, 0]]
            b = self._data.flexvert_xpos[corners[:, 1]]
            c = self._data.flexvert_xpos[corners[:, 2]]
            outwards = np.cross(b - a, c - a)
            outwards /= np.linalg.norm(outwards, axis=1, keepdims=True) + 1e-30
            # a contact's normal points from the link to the organ: inwards, if the link is outside
            inwards = -np.einsum("ij,ij->i", contact.frame[rows, :3], outwards)
            weights = -contact.dist[rows]
            limits = _LEAST_FRONT_PRODUCT * np.bincount(links, weights, len(self.tools))
            in_front = np.bincount(links, inwards * weights, len(self.tools))
            links = links[(in_front < limits)[links]]
        for k in set(links.tolist()):
            organ.set_inside(k, True)
            self._let_touch(organ, k)

    def _test_link(self, organ: Organ, k: int) -> None:
        organ.set_inside(k, organ.contains(self._samples[k], self._corners[k], self._poses[k]))
        self._let_touch(organ, k)

    def mute(self, robot: str, on: bool) -> None:
        """Switch off contact of a robot's links with the operable organ (`on`), or switch it on for links outside."""
        organ = self.operable
        assert organ is not None
        links = []
        for k, tool in enumerate(self.tools):
            if tool.robot == robot:
                links.append(k)
        organ.mute(links, on)
        for k in links:
            if on:
                self._let_touch(organ, k)
            else:
                self._test_link(organ, k)

    def _let_touch(self, organ: Organ, k: int) -> None:
        bits = self._model.geom_contype
        if organ.may_touch(k):
            bits[self._geoms[k]] |= organ.bit
        else:
            bits[self._geoms[k]] &= ~organ.bit


def _add_link(spec: mujoco.MjSpec, tool: Tool, period: float, bits: int) -> None:
    body = spec.worldbody.add_body(
        name=tool.name, gravcomp=1.0, mass=_LINK_MASS, inertia=[_LINK_INERTIA] * 3, explicitinertial=True
    )
    body.add_freejoint(name=tool.name)
    # conaffinity 0: links never touch each other; the friction is that of the organ, the larger of the two
    surface = {
        "contype": bits,
        "conaffinity": 0,
        "condim": 3,
        "friction": [0, 0, 0],
        "mass": 0.0,
        "solref": [2 * period, 1.0],
    }
    for part in tool.body.meshes:
        add_part(spec, body, part, np.eye(4), tool.name, **surface)


def _sample_points(tool: Tool) -> Array:
    """Return points (n, 3) on the convex hulls of a link's parts, in its frame in m."""
    import trimesh  # imported here, because the import takes a second

    samples = [np.zeros((0, 3))]
    for part in tool.body.meshes:
        require_hull(f"{tool.name}: part '{part.name}'", part.vertices)
        hull = trimesh.convex.convex_hull(part.vertices)
        points = trimesh.remesh.subdivide_to_size(hull.vertices, hull.faces, SAMPLE_DISTANCE, max_iter=20)[0]
        # rounded, so that points that nearly coincide become one
        rounded = np.unique(np.rint(points / (SAMPLE_DISTANCE / 2)), axis=0)
        samples.append(rounded * (SAMPLE_DISTANCE / 2))
    return np.unique(np.concatenate(samples), axis=0)


def _corners(points: Array) -> Array:
    """Return the corners (8, 3) of the box around points."""
    if not len(points):
        return np.zeros((8, 3))
    low = points.min(axis=0)
    high = points.max(axis=0)
    return np.array([np.where(corner, high, low) for corner in np.ndindex(2, 2, 2)])


def _largest_motion(points: Array, before: Array, after: Array) -> float:
    """Return the largest distance in m between the positions of points (n, 3) of a link at two poses."""
    D = after - before
    return float(np.linalg.norm(points @ D[:3, :3].T + D[:3, 3], axis=1).max())
