"""Soft organs and links of instruments in MuJoCo: links have given poses, and organs deform in contact with them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import permutations

import mujoco
import numpy as np

from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body
from twin.model.hull import require_hull
from twin.model.surface import inside
from twin.model.tissue import Tissue
from twin.simulation.plants.contact.shapes import add_part
from twin.simulation.plants.tissue.organ import MOST, NOTHING, RADIUS, SAMPLE, Organ, Touch, require_valid

PERIOD = 8e-3
"""Time in s between two steps."""

SLOWEST = 20e-3
"""Longest time in s between two steps for which the organs were tested."""

_LINK_MASS, _LINK_INERTIA = 10.0, 0.1
"""Mass in kg and moment of inertia in kg m2 of a link, so large that contact forces do not move links within a step."""

_JUMP = 20 * MM
"""Largest distance in m that a link moves in contact within a step; a link that moves farther is set to its new
pose."""

_LOOK = 12
"""Number of steps between two tests whether a link is inside an organ."""

_STILL = 5e-6
"""Organs are at rest if no node is farther than this distance in m from its rest position, and no node moves farther
than this distance in a step. The distance is less than a step of the quantised vertices in the stream."""

_ITERATIONS = 400
"""Maximum number of iterations of MuJoCo's solvers. With MuJoCo's default of 100, the solver of the stiffness ended at
a relative residual of 1.02e-8 instead of 1e-8 for a gallbladder half out of its bed."""

_CROSSED = 3 * RADIUS
"""Depth in m of a contact above which the surfaces of two organs cross: each surface is thickened by `RADIUS`, and
contact keeps the surfaces apart within 0.2 mm. If surfaces cross, contact forces would lock the organs together."""

_PIERCED = 0.3
"""Limit of `Organ.compression` below which a link that touches the organ counts as inside the organ; ASSUMED.
MuJoCo's elasticity cannot prevent such a compression: a finite force inverts a cell."""

_BEFORE = 0.3
"""Smallest mean scalar product of contact normals and surface normals at which a link is in front of a surface. The
mean is 0.5 to 1 if a link presses, and less than 0.1 if the surface has jumped over the link."""

_PREFIX = "link:"
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
        held: str = "",
    ) -> None:
        """Build the MuJoCo model.

        Args:
            tissues: the organs.
            tools: the links that can touch the organs.
            poses: T_world_link (4, 4) of each link at the start.
            period: time in s between two steps.
            held: name of the organ that can be grasped, and whose pins can be freed one by one; see `operable`.

        Raises:
            TwinError: the pins of an organ do not hold the organ in place.
            WorldError: a number is out of range, two organs overlap, or a link is inside an organ.
        """
        self.tissues, self.tools, self.period = tuple(tissues), tuple(tools), period
        for t in tissues:
            require_valid(t)
        if len(tissues) > MOST:
            raise WorldError(f"there are {len(tissues)} organs; at most {MOST} are simulated")
        self.crossed = set[tuple[int, int]]()
        self._organs = {t.name: Organ(t, k, t.name == held) for k, t in enumerate(tissues)}
        self.operable = self._organs[held] if held else None
        self._samples = [_samples(tool) for tool in tools]
        self._corners = [_corners(points) for points in self._samples]
        m = self._model = self._compiled()
        d = self._data = mujoco.MjData(m)
        for organ in self._organs.values():
            organ.connect(m, d)
        self._soft = _joined(organ.qpos for organ in self._organs.values())
        self._soft_dofs = _joined(organ.dofs for organ in self._organs.values())
        free = [m.joint(_PREFIX + tool.name) for tool in tools]
        self._qpos = np.array([j.qposadr[0] + i for j in free for i in range(7)], int)
        self._dofs = np.array([j.dofadr[0] + i for j in free for i in range(6)], int)
        self._geoms = [np.flatnonzero(m.geom_bodyid == m.body(_PREFIX + tool.name).id) for tool in tools]
        self._link_of = np.zeros(m.ngeom, int)
        for k, geoms in enumerate(self._geoms):
            self._link_of[geoms] = k
        self._wanted, self._v, self._all = np.zeros(len(self._qpos)), np.zeros(m.nv), d.qpos.copy()
        self._steps, self._poses = 0, [np.array(T, float) for T in poses]
        self._place(poses)
        self.reset()
        for organ in self._organs.values():
            for k, tool in enumerate(tools):
                if organ.contains(self._samples[k], self._corners[k], self._poses[k]):
                    raise WorldError(
                        f"'{tool.name}' is inside '{organ.tissue.name}' at the start; start the robot outside, or move "
                        "the organ"
                    )
        self._require_apart()

    def _compiled(self) -> mujoco.MjModel:
        elements = "".join(organ.xml(self.period) for organ in self._organs.values())
        spec = mujoco.MjSpec.from_string(
            f'<mujoco><option timestep="{self.period!r}" integrator="discrete" gravity="0 0 0" '
            f'iterations="{_ITERATIONS}"/>'
            f"<worldbody>{elements}</worldbody></mujoco>"
        )
        links = mujoco.MjSpec()
        for tool in self.tools:
            _add(links, tool, self.period, sum(organ.bit for organ in self._organs.values()))
        spec.attach(links, frame=spec.worldbody.add_frame(), prefix=_PREFIX)
        for organ in self._organs.values():
            organ.constrain(spec)
        return spec.compile()

    def _require_apart(self) -> None:
        """Raise `WorldError` if two organs touch at rest, or if one is inside another one."""
        m, d = self._model, self._data
        mujoco.mj_forward(m, d)
        names = [t.name for t in self.tissues]
        for c in d.contact[: d.ncon]:
            if (c.flex >= 0).all():
                a, b = (names[k] for k in c.flex)
                raise WorldError(
                    f"'{a}' and '{b}' overlap or are less than {2 * RADIUS / MM:g} mm apart at the start; draw them "
                    "further apart"
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
        return {name: tuple(self.tools[k].name for k in sorted(organ.within)) for name, organ in self._organs.items()}

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
        self._data.qpos[self._qpos] = self._wanted
        for organ in self._organs.values():
            if organ.hold is not None:
                organ.hold.reset()
            organ.touch = NOTHING
            organ.read()
        for pair in tuple(self.crossed):
            self._let_meet(pair, True)
        self._rests = True

    def step(self, poses: Sequence[Array]) -> bool:
        """Set the links to `poses` T_world_link (4, 4), step the organs, and return whether an organ moved."""
        m, d, organs = self._model, self._data, self._organs.values()
        before = self._poses
        jumped, moved = self._place(poses), any(map(_differ, before, poses))
        for k in jumped:
            d.qpos[self._qpos[7 * k : 7 * k + 7]] = self._wanted[7 * k : 7 * k + 7]
        self._look(jumped)
        self._part()
        self._steps += 1
        led = any(organ.hold is not None and organ.hold.begin(organ.tissue.nodes) for organ in organs)
        if self._rests and not led and not (moved and self._approached()):
            d.qpos[self._qpos] = self._wanted
            return False
        self._all[:] = d.qpos
        self._all[self._qpos] = self._wanted
        mujoco.mj_differentiatePos(m, self._v, self.period, d.qpos, self._all)
        d.qvel[self._dofs] = self._v[self._dofs]
        last = [organ.nodes for organ in organs]
        for organ in organs:
            organ.begin()
        mujoco.mj_step(m, d)
        self._require_finite()
        for organ in organs:
            organ.read()
            if organ.hold is not None:
                organ.hold.end()
        self._touch()
        d.qpos[self._qpos] = self._wanted
        self._rests = d.ncon == 0 and not led and self._still()
        if self._rests:
            self.reset()
        else:
            for organ in organs:
                organ.end()
        return not all(map(np.array_equal, (organ.nodes for organ in organs), last))

    def _require_finite(self) -> None:
        """Raise `WorldError` for a state that is not finite, which MuJoCo resets with only a warning."""
        w = mujoco.mjtWarning
        if any(self._data.warning[k].number for k in (w.mjWARN_BADQPOS, w.mjWARN_BADQVEL, w.mjWARN_BADQACC)):
            names = ", ".join(f"'{t.name}'" for t in self.tissues)
            raise WorldError(
                f"the simulation of the organs {names} became unstable in step {self._steps} of {self.period * 1e3:g} "
                "ms; move the instruments more slowly, or give the organs a smaller Young's modulus"
            )

    def _still(self) -> bool:
        if not len(self._soft):
            return True
        d = self._data
        off, speed = np.abs(d.qpos[self._soft]).max(), np.abs(d.qvel[self._soft_dofs]).max()
        return bool(max(off, speed * self.period) < _STILL)

    def _touch(self) -> None:
        """Read the contacts of the last step."""
        m, d = self._model, self._data
        for organ in self._organs.values():
            organ.touch = NOTHING
        if not d.ncon:
            return
        local, contact = np.zeros((d.ncon, 6)), d.contact
        for k, row in enumerate(local):
            mujoco.mj_contactForce(m, d, k, row)
        F = np.einsum("ki,kij->kj", local[:, :3], contact.frame.reshape(-1, 3, 3))
        flex, dist, elements, corners = contact.flex, contact.dist, contact.elem, contact.vert
        for pair in {(min(x), max(x)) for x in flex[(flex >= 0).all(axis=1) & (dist < -_CROSSED)].tolist()}:
            self._let_meet(pair, False)
        for index, organ in enumerate(self._organs.values()):
            here = flex == index
            which = np.flatnonzero(here.any(axis=1))
            if not len(which):
                continue
            pressed = organ.compression < _PIERCED
            self._look_through(index, organ, pressed)
            for pair in {(min(x), max(x)) for x in flex[which].tolist() if pressed and min(x) >= 0}:
                self._let_meet(pair, False)
            k = which[np.argmin(dist[which])]
            side = int(np.argmax(here[k]))
            triangles, element = organ.tissue.surface.triangles, int(elements[k, side])
            if element < 0:
                element = int(np.argmax((triangles == corners[k, side]).any(axis=1)))
            # MuJoCo gives the force on the second body of a contact
            organ.touch = Touch(element, F[here[:, 1]].sum(axis=0) - F[here[:, 0]].sum(axis=0))

    # -- organs that cross ---------------------------------------------------------------------------------

    def _let_meet(self, pair: tuple[int, int], on: bool) -> None:
        """Let two organs touch each other (`on`), or pass through each other."""
        (self.crossed.discard if on else self.crossed.add)(pair)
        first, second = pair
        bit = self._organs[self.tissues[first].name].other_bit
        if on:
            self._model.flex_conaffinity[second] |= bit
        else:
            self._model.flex_conaffinity[second] &= ~bit

    def _part(self) -> None:
        """Let organs that have crossed touch each other again if they are apart."""
        if not self.crossed or self._steps % _LOOK:
            return
        m, d, pairs = self._model, self._data, tuple(self.crossed)
        for pair in pairs:
            self._let_meet(pair, True)
        mujoco.mj_fwdPosition(m, d)
        meet = {(min(x), max(x)) for x in d.contact.flex[: d.ncon].tolist()}
        for pair in meet.intersection(pairs):
            self._let_meet(pair, False)

    # -- links --------------------------------------------------------------------------------------------

    def _place(self, poses: Sequence[Array]) -> list[int]:
        """Store poses T_world_link (4, 4) in MuJoCo's format; return the indices of the links that jumped."""
        jumped = []
        for k, T in enumerate(poses):
            row = self._wanted[7 * k : 7 * k + 7]
            row[:3] = T[:3, 3]
            mujoco.mju_mat2Quat(row[3:], np.ascontiguousarray(T[:3, :3]).ravel())
            if _moved(self._corners[k], self._poses[k], T) > _JUMP:
                jumped.append(k)
        self._poses = [np.array(T, float) for T in poses]
        return jumped

    def _approached(self) -> bool:
        """Return whether a link is so near that it may touch an organ; valid only for organs at rest."""
        return any(
            organ.approached(self._samples[k], self._corners[k], self._poses[k])
            for organ in self._organs.values()
            for k in range(len(self.tools))
        )

    def _look(self, jumped: Sequence[int]) -> None:
        """Switch off contact between an organ and the links that jumped into it, until these links are outside."""
        for organ in self._organs.values():
            for k in {*jumped, *(organ.within if self._steps % _LOOK == 0 else ())}:
                self._look_at(organ, k)

    def _look_through(self, index: int, organ: Organ, pressed: bool) -> None:
        """Treat touching links as inside an organ that is compressed too far (`pressed`) or has jumped over them."""
        contact = self._data.contact
        at = np.flatnonzero((contact.flex[:, 1] == index) & (contact.geom[:, 0] >= 0) & (contact.elem[:, 1] >= 0))
        if not len(at):
            return
        links = self._link_of[contact.geom[at, 0]]
        if not pressed:
            corners = organ.tissue.surface.triangles[contact.elem[at, 1]] + self._model.flex_vertadr[index]
            a, b, c = (self._data.flexvert_xpos[corners[:, k]] for k in range(3))
            outwards = np.cross(b - a, c - a)
            outwards /= np.linalg.norm(outwards, axis=1, keepdims=True) + 1e-30
            # a contact's normal points from the link to the organ: inwards, if the link is outside
            inwards, weights = -np.einsum("ij,ij->i", contact.frame[at, :3], outwards), -contact.dist[at]
            least = _BEFORE * np.bincount(links, weights, len(self.tools))
            links = links[(np.bincount(links, inwards * weights, len(self.tools)) < least)[links]]
        for k in {*links.tolist()}:
            organ.look(k, True)
            self._let_touch(organ, k)

    def _look_at(self, organ: Organ, k: int) -> None:
        organ.look(k, organ.contains(self._samples[k], self._corners[k], self._poses[k]))
        self._let_touch(organ, k)

    def mute(self, robot: str, on: bool) -> None:
        """Switch off contact of a robot's links with the operable organ (`on`), or switch it on for links outside."""
        organ = self.operable
        assert organ is not None
        links = [k for k, tool in enumerate(self.tools) if tool.robot == robot]
        organ.mute(links, on)
        for k in links:
            if on:
                self._let_touch(organ, k)
            else:
                self._look_at(organ, k)

    def _let_touch(self, organ: Organ, k: int) -> None:
        bits = self._model.geom_contype
        if organ.may_touch(k):
            bits[self._geoms[k]] |= organ.bit
        else:
            bits[self._geoms[k]] &= ~organ.bit


def _add(spec: mujoco.MjSpec, tool: Tool, period: float, bits: int) -> None:
    body = spec.worldbody.add_body(
        name=tool.name, gravcomp=1.0, mass=_LINK_MASS, inertia=[_LINK_INERTIA] * 3, explicitinertial=True
    )
    body.add_freejoint(name=tool.name)
    for part in tool.body.meshes:
        add_part(
            spec, body, part, np.eye(4), tool.name,
            contype=bits, conaffinity=0, condim=3, friction=[0, 0, 0], mass=0.0, solref=[2 * period, 1.0],
        )  # fmt: skip


def _samples(tool: Tool) -> Array:
    """Return points (n, 3) on the convex hulls of a link's parts, in its frame in m."""
    import trimesh  # imported here, because the import takes a second

    out = [np.zeros((0, 3))]
    for part in tool.body.meshes:
        require_hull(f"{tool.name}: part '{part.name}'", part.vertices)
        hull = trimesh.convex.convex_hull(part.vertices)
        points = trimesh.remesh.subdivide_to_size(hull.vertices, hull.faces, SAMPLE, max_iter=20)[0]
        out.append(np.unique(np.rint(points / (SAMPLE / 2)), axis=0) * (SAMPLE / 2))
    return np.unique(np.concatenate(out), axis=0)


def _corners(points: Array) -> Array:
    """Return the corners (8, 3) of the box around points."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3), np.zeros(3))
    return np.array([np.where(corner, high, low) for corner in np.ndindex(2, 2, 2)])


def _joined(parts: Iterable[Array]) -> Array:
    return np.concatenate([np.zeros(0, int), *parts])


def _differ(a: Array, b: Array) -> bool:
    return not np.array_equal(a, b)


def _moved(points: Array, before: Array, after: Array) -> float:
    """Return the largest distance in m between the positions of points (n, 3) of a link at two poses."""
    D = after - before
    return float(np.linalg.norm(points @ D[:3, :3].T + D[:3, 3], axis=1).max())
