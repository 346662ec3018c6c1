"""Soft organs and the links of instruments in MuJoCo: the links are where they are put, the organs give way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import KDTree

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array, Index
from twin.core.units import MM
from twin.model.body import Body
from twin.model.surface import inside
from twin.model.tissue import Tissue
from twin.simulation.plants.contact.shapes import add_part
from twin.simulation.plants.tissue import bed

PERIOD = 8e-3
"""Time in s between two steps."""

SLOWEST = 20e-3
"""Longest time in s between two steps for which the organs were tested."""

CELLS = 4
"""Largest number of cells along an axis of a grid; the time of a step grows with the square of their number."""

_LINK_MASS, _LINK_INERTIA = 10.0, 0.1
"""Mass in kg and moment of inertia in kg m2 of a link, so that contact forces do not move it within a step."""

_RADIUS = 0.5 * MM
"""Radius in m by which a surface is thickened for contact."""

_JUMP = 20 * MM
"""Largest distance in m that a link is moved within a step; one that goes further is put there."""

_SAMPLE = 5 * MM
"""Distance in m between the points of a link that are looked for near and inside organs."""

_LOOK = 12
"""Number of steps after which a link inside an organ is looked for again."""

_STILL = 1e-6
"""An organ is at rest if no node is further than this from its place in m, and none is faster than this per step."""


_PREFIX = "link:"
"""Prefix of the names of links in MuJoCo."""


@dataclass(frozen=True)
class Tool:
    """A link that touches organs: the robot's name and its body."""

    robot: str
    body: Body

    @property
    def name(self) -> str:
        """Name, "<robot>/<body>"."""
        return f"{self.robot}/{self.body.name}"


@dataclass(frozen=True)
class Touch:
    """Contact of an organ.

    Attributes:
        triangle: index of the triangle that is pressed deepest; -1: nothing touches the organ.
        force: (3,) total force on the organ in N, in the World.
    """

    triangle: int
    force: Array


_NOTHING = Touch(-1, np.zeros(3))


class Organs:
    """The organs, stepped for given poses of the links.

    Each organ is a model of its own, because organs do not touch each other; one that is at rest and that no link is
    near is not stepped. A link that jumps into an organ, by more than 20 mm within a step, does not touch this organ
    until it is outside again.

    Attributes:
        tissues: the organs.
        tools: the links.
        period: time in s between two steps.
        operable: the organ that can be grasped and freed, or None.
    """

    def __init__(
        self,
        tissues: Sequence[Tissue],
        tools: Sequence[Tool],
        poses: Sequence[Array],
        period: float = PERIOD,
        held: str = "",
    ) -> None:
        """Build the MuJoCo models.

        Args:
            tissues: the organs.
            tools: the links that touch them.
            poses: T_world_link (4, 4) of each link at the start.
            period: time in s between two steps.
            held: name of the organ that can be grasped, and whose pins can let go one by one; see `operable`.

        Raises:
            TwinError: the pins of an organ do not hold it.
            WorldError: a number is out of range, or a link is inside an organ.
        """
        self.tissues, self.tools, self.period = tuple(tissues), tuple(tools), period
        samples = [_samples(tool) for tool in tools]
        links = mujoco.MjSpec()
        for tool in tools:
            _add(links, tool, period)
        self._organs = {t.name: Organ(t, tools, links, samples, poses, period, t.name == held) for t in tissues}
        self.operable = self._organs[held] if held else None

    @property
    def nodes(self) -> dict[str, Array]:
        """Nodes (k, 3) of each organ in the World in m."""
        return {name: organ.nodes for name, organ in self._organs.items()}

    @property
    def within(self) -> dict[str, tuple[str, ...]]:
        """Names of the links that do not touch an organ because they are inside, by organ."""
        return {name: organ.within for name, organ in self._organs.items()}

    def vertices(self, name: str) -> Array:
        """Return the vertices (n, 3) of an organ in the World in m."""
        organ = self._organs[name]
        return organ.tissue.weights @ organ.nodes

    def touches(self) -> dict[str, Touch]:
        """Return the contact of each organ in the last step."""
        return {name: organ.touch for name, organ in self._organs.items()}

    def step(self, poses: Sequence[Array]) -> bool:
        """Move the links to T_world_link (4, 4), and the organs by contact and elasticity; return whether one moved."""
        moved = [organ.step(poses) for organ in self._organs.values()]
        return any(moved)

    def reset(self) -> None:
        """Put all organs to rest where they were drawn."""
        for organ in self._organs.values():
            organ.reset()


class Organ:
    """An organ and the links, in a model whose World is the frame of the organ's grid.

    MuJoCo is fastest if the nodes move along the axes of its World.
    """

    def __init__(
        self,
        tissue: Tissue,
        tools: Sequence[Tool],
        links: mujoco.MjSpec,
        samples: Sequence[Array],
        poses: Sequence[Array],
        period: float,
        operable: bool,
    ) -> None:
        _require_valid(tissue)
        self.tissue, self._tools, self._samples, self._period = tissue, tools, samples, period
        self._corners = [_corners(points) for points in samples]
        self._triangles, self._T_grid_world = tissue.surface.triangles, spatial.inverse(tissue.T_world_grid)
        self._nodes_at_rest = (tissue.nodes - tissue.T_world_grid[:3, 3]) @ tissue.T_world_grid[:3, :3]
        self._volume = _Volume(tissue.weights, self._triangles)
        self._content, by_node = self._volume.at(self._nodes_at_rest)
        self._area = self._content ** (2 / 3)
        self._tree = KDTree(tissue.local)
        corners = tissue.local[self._triangles]
        edge = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
        self._reach = 2 * _SAMPLE + edge / np.sqrt(3)  # no point of a triangle is further from all of its corners
        fixed = tissue.held if not operable else np.zeros(0, int)
        spec = mujoco.MjSpec.from_string(_xml(tissue, fixed, period))
        spec.attach(links.copy(), frame=spec.worldbody.add_frame(), prefix=_PREFIX)
        joints = _keep_volume(spec, tissue, fixed, by_node / self._area)
        if operable:
            bed.add(spec, tissue.held, joints)
        m = self._model = spec.compile()
        d = self._data = mujoco.MjData(m)
        self._bodies = m.flex_nodebodyid.copy()
        self._free = np.flatnonzero(self._bodies)
        self._at = np.array([m.joint(name).qposadr[0] for name in joints], int)
        free = [m.joint(_PREFIX + tool.name) for tool in tools]
        self._qpos = np.array([j.qposadr[0] + i for j in free for i in range(7)], int)
        self._dofs = np.array([j.dofadr[0] + i for j in free for i in range(6)], int)
        self._soft = np.array([m.joint(name).dofadr[0] for name in joints], int)
        self._geoms = [np.flatnonzero(m.geom_bodyid == m.body(_PREFIX + tool.name).id) for tool in tools]
        self._wanted, self._v, self._all = np.zeros(len(self._qpos)), np.zeros(m.nv), d.qpos.copy()
        self._within: set[int] = set()
        self._muted: set[int] = set()
        self.hold = bed.Hold(m, d, tissue.held, self._soft, self._free) if operable else None
        self._steps, self._poses = 0, self._locate(poses)
        self.reset()
        for k, tool in enumerate(tools):
            if self._is_inside(k):
                raise WorldError(
                    f"'{tool.name}' is inside '{tissue.name}' at the start; start the robot outside, or move the organ"
                )

    @property
    def within(self) -> tuple[str, ...]:
        """Names of the links that do not touch the organ because they are inside."""
        return tuple(self._tools[k].name for k in sorted(self._within))

    def reset(self) -> None:
        """Put the organ to rest where it was drawn."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[self._qpos] = self._wanted
        if self.hold is not None:
            self.hold.reset()
        self._read()
        self.touch, self._rests = _NOTHING, True

    def step(self, poses: Sequence[Array]) -> bool:
        """Move the links to T_world_link (4, 4), and the organ; return whether it moved."""
        m, d = self._model, self._data
        before, self._poses = self._poses, self._locate(poses)
        jumped = [k for k, T in enumerate(self._poses) if _moved(self._corners[k], before[k], T) > _JUMP]
        for k in jumped:
            d.qpos[self._qpos[7 * k : 7 * k + 7]] = self._wanted[7 * k : 7 * k + 7]
        self._look(jumped)
        self._steps += 1
        led = self.hold is not None and self.hold.begin(self._nodes_at_rest, self._nodes, self.tissue.T_world_grid)
        if self._rests and not led and not self._approached():
            d.qpos[self._qpos] = self._wanted
            return False
        last, self._rests = self.nodes, False
        self._all[:] = d.qpos
        self._all[self._qpos] = self._wanted
        mujoco.mj_differentiatePos(m, self._v, self._period, d.qpos, self._all)
        d.qvel[self._dofs] = self._v[self._dofs]
        self._set_volume()
        mujoco.mj_step(m, d)
        if self.hold is not None:
            self.hold.end()
        self.touch = self._touch()
        d.qpos[self._qpos] = self._wanted
        off, speed = np.abs(d.qpos[self._at]).max(), np.abs(d.qvel[self._soft]).max()
        if d.ncon == 0 and not led and max(float(off), float(speed) * self._period) < _STILL:
            self.reset()
        else:
            self._read()
            self._correct_volume()
        return not np.array_equal(self.nodes, last)

    def _read(self) -> None:
        """Compute the nodes in the grid and in the World; the joints of a node move it along the axes of the grid."""
        self._nodes = self._nodes_at_rest.copy()
        self._nodes[self._free] += self._data.qpos[self._at].reshape(-1, 3)
        T = self.tissue.T_world_grid
        self.nodes = self._nodes @ T[:3, :3].T + T[:3, 3]

    def _touch(self) -> Touch:
        """Return the contact of the last step."""
        m, d = self._model, self._data
        if d.ncon == 0:
            return _NOTHING
        force, local = np.zeros(3), np.zeros(6)
        deepest: mujoco.MjContact | None = None
        for k, contact in enumerate(d.contact[: d.ncon]):
            mujoco.mj_contactForce(m, d, k, local)
            F = local[:3] @ contact.frame.reshape(3, 3)
            force += F if contact.flex[1] >= 0 else -F  # MuJoCo gives the force on the second one
            if deepest is None or contact.dist < deepest.dist:
                deepest = contact
        assert deepest is not None
        side = int(deepest.flex[1] >= 0)
        element, vertex = int(deepest.elem[side]), int(deepest.vert[side])
        triangle = element if element >= 0 else int(np.argmax((self._triangles == vertex).any(axis=1)))
        return Touch(triangle, self.tissue.T_world_grid[:3, :3] @ force)

    def _set_volume(self) -> None:
        """Set the constraint to the volume and its derivatives with respect to the joints at the latest nodes."""
        m, d = self._model, self._data
        content, by_node = self._volume.at(self._nodes)
        coefficients = by_node[self._free].ravel() / self._area
        change = (content - self._content) / self._area
        m.wrap_prm[: len(coefficients)] = coefficients
        m.eq_data[0, 0] = coefficients @ d.qpos[self._at] - change

    def _correct_volume(self) -> None:
        """Remove what the constraint leaves, because it is linear within a step: one step of Newton's method."""
        content, by_node = self._volume.at(self._nodes)
        change = by_node[self._free].ravel()
        self._data.qpos[self._at] -= change * ((content - self._content) / (change @ change))
        self._read()

    # -- links --------------------------------------------------------------------------------------------

    def _locate(self, poses: Sequence[Array]) -> list[Array]:
        """Return T_grid_link (4, 4) of each link, and store them as MuJoCo needs them."""
        out = [self._T_grid_world @ T for T in poses]
        for k, T in enumerate(out):
            row = self._wanted[7 * k : 7 * k + 7]
            row[:3] = T[:3, 3]
            mujoco.mju_mat2Quat(row[3:], np.ascontiguousarray(T[:3, :3]).ravel())
        return out

    def _near(self, k: int) -> Array:
        """Return the points of a link, in the grid, that are in the box around the organ or beside it."""
        T = self._poses[k]
        low, high = self._nodes.min(axis=0) - 2 * _SAMPLE, self._nodes.max(axis=0) + 2 * _SAMPLE
        corners = self._corners[k] @ T[:3, :3].T + T[:3, 3]
        if (corners.min(axis=0) > high).any() or (corners.max(axis=0) < low).any():
            return np.zeros((0, 3))
        points = self._samples[k] @ T[:3, :3].T + T[:3, 3]
        return points[((points > low) & (points < high)).all(axis=1)]

    def _approached(self) -> bool:
        """Return whether a link is near enough to touch the organ, which is at rest."""
        near = [points for k in range(len(self._tools)) if len(points := self._near(k))]
        return bool(near) and float(self._tree.query(np.concatenate(near))[0].min()) < self._reach

    def _is_inside(self, k: int) -> bool:
        near = self._near(k)
        return len(near) > 0 and bool(inside(near, self.tissue.weights @ self._nodes, self._triangles).any())

    def _look(self, jumped: Sequence[int]) -> None:
        """Let links that jumped into the organ touch nothing, until they are outside."""
        again = self._within if self._steps % _LOOK == 0 else ()
        for k in {*jumped, *again}:
            (self._within.add if self._is_inside(k) else self._within.discard)(k)
            self._let_touch(k)

    def mute(self, robot: str, on: bool) -> None:
        """Let the links of a robot not touch the organ that its jaws hold (`on`), or touch it again once outside."""
        for k in [k for k, tool in enumerate(self._tools) if tool.robot == robot]:
            if on:
                self._muted.add(k)
            elif k in self._muted:
                self._muted.remove(k)
                if self._is_inside(k):
                    self._within.add(k)
            self._let_touch(k)

    def _let_touch(self, k: int) -> None:
        off = k in self._within or k in self._muted
        self._model.geom_contype[self._geoms[k]] = 0 if off else 1
        self._model.geom_conaffinity[self._geoms[k]] = 0 if off else 2


class _Volume:
    """The volume of a surface as a polynomial of third degree in the nodes of its grid.

    The volume is the sum of det(a, b, c) / 6 over the triangles, and each corner is a weighted sum of nodes.
    """

    def __init__(self, weights: Array, triangles: Index) -> None:
        n = weights.shape[1]
        sums = np.zeros((n, n * n))
        for part in np.array_split(triangles, max(1, len(triangles) // 256)):
            a, b, c = (weights[part[:, k]] for k in range(3))
            sums += a.T @ (b[:, :, None] * c[:, None, :]).reshape(len(part), n * n)
        cube = sums.reshape(n, n, n) / 6
        cube = cube + cube.transpose(2, 0, 1) + cube.transpose(1, 2, 0)  # a determinant is the same in cyclic order
        self._j, self._k = np.triu_indices(n, 1)
        self._factors = cube[:, self._j, self._k] - cube[:, self._k, self._j]

    def at(self, nodes: Array) -> tuple[float, Array]:
        """Return the volume in m3 at nodes (k, 3), and its derivatives (k, 3) with respect to them in m2."""
        (ax, ay, az), (bx, by, bz) = nodes[self._j].T, nodes[self._k].T
        by_node = self._factors @ np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
        return float(np.vdot(nodes, by_node)) / 3, by_node


def _xml(t: Tissue, fixed: Index, period: float) -> str:
    return (
        f'<mujoco><option timestep="{period!r}" integrator="discrete" gravity="0 0 0"/><worldbody>'
        f'<flexcomp name="organ" type="direct" dim="2" dof="trilinear" cellcount="{_numbers(t.cells)}" '
        f'mass="{t.density * t.surface.volume!r}" radius="{_RADIUS!r}" '
        f'point="{_numbers(t.local)}" element="{_numbers(t.surface.triangles)}">'
        f'<elasticity young="{t.young!r}" poisson="{t.poisson!r}" damping="{t.damping!r}"/>'
        f'<contact selfcollide="none" contype="2" conaffinity="1" condim="3" friction="{t.friction!r} 0 0" '
        f'solref="{2 * period!r} 1" solimp="0.95 0.99 0.0005"/>'
        + (f'<pin id="{_numbers(fixed)}"/>' if len(fixed) else "")
        + "</flexcomp></worldbody></mujoco>"
    )


def _add(spec: mujoco.MjSpec, tool: Tool, period: float) -> None:
    body = spec.worldbody.add_body(
        name=tool.name, gravcomp=1.0, mass=_LINK_MASS, inertia=[_LINK_INERTIA] * 3, explicitinertial=True
    )
    body.add_freejoint(name=tool.name)
    for part in tool.body.meshes:
        add_part(
            spec, body, part, np.eye(4), tool.name,
            contype=1, conaffinity=2, condim=3, friction=[0, 0, 0], mass=0.0, solref=[2 * period, 1.0],
        )  # fmt: skip


def _keep_volume(spec: mujoco.MjSpec, t: Tissue, fixed: Index, by_node: Array) -> list[str]:
    """Add a constraint that is linear in the joints of the nodes; return the names of the joints, by node.

    Args:
        spec: the model with the organ.
        t: the organ.
        fixed: indices of the nodes without joints.
        by_node: (k, 3) factors of the joints at rest; MuJoCo scales the constraint by them.
    """
    names = []
    tendon = spec.add_tendon(name="volume")
    for index in np.setdiff1d(np.arange(len(t.nodes)), fixed).tolist():
        cells = np.unravel_index(index, [c + 1 for c in t.cells])
        body = spec.body("organ_" + "_".join(map(str, cells)))
        if body is None:
            continue  # the cells around this node are empty, and no vertex depends on it
        for axis, joint, factor in zip("xyz", body.joints, by_node[index].tolist(), strict=True):
            joint.name = f"{body.name}_{axis}"
            names.append(joint.name)
            tendon.wrap_joint(joint.name, factor)
    spec.add_equality(
        name="volume", type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON, name1="volume",
        solref=[2 * spec.option.timestep, 1.0], solimp=[0.99, 0.999, 1e-4, 0.5, 2.0],
    )  # fmt: skip
    return names


def _numbers(values: np.ndarray | Sequence[float]) -> str:
    return " ".join(f"{x!r}" for x in np.asarray(values).ravel().tolist())


def _require_valid(t: Tissue) -> None:
    for what, value, low, high, unit in (
        ("Young's modulus", t.young, 100.0, 1e6, "Pa"),
        ("Poisson's ratio", t.poisson, 0.0, 0.49, ""),
        ("damping", t.damping, 0.0, 1.0, "s"),
        ("density", t.density, 100.0, 5000.0, "kg/m3"),
        ("friction", t.friction, 0.0, 2.0, ""),
        ("number of cells", min(t.cells), 1, CELLS, "along an axis"),
        ("number of cells", max(t.cells), 1, CELLS, "along an axis"),
    ):
        if not low <= value <= high:
            raise WorldError(f"tissue '{t.name}': {what} is {value:g}; it must be {low:g} to {high:g} {unit}".rstrip())


def _samples(tool: Tool) -> Array:
    """Return points (n, 3) on the convex hulls of a link's parts, in its frame in m."""
    import trimesh  # late: it takes a second

    out = [np.zeros((0, 3))]
    for part in tool.body.meshes:
        hull = trimesh.convex.convex_hull(part.vertices)
        points = trimesh.remesh.subdivide_to_size(hull.vertices, hull.faces, _SAMPLE, max_iter=20)[0]
        out.append(np.unique(np.rint(points / (_SAMPLE / 2)), axis=0) * (_SAMPLE / 2))
    return np.unique(np.concatenate(out), axis=0)


def _corners(points: Array) -> Array:
    """Return the corners (8, 3) of the box around points."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3), np.zeros(3))
    return np.array([np.where(corner, high, low) for corner in np.ndindex(2, 2, 2)])


def _moved(points: Array, before: Array, after: Array) -> float:
    """Return the largest distance in m between the places of points (n, 3) of a link at two poses."""
    D = after - before
    return float(np.linalg.norm(points @ D[:3, :3].T + D[:3, 3], axis=1).max())
