"""One soft organ of a MuJoCo model: its nodes, volume and contact, and the links that may touch it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import KDTree

from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.surface import inside
from twin.model.tissue import Tissue
from twin.simulation.plants.tissue import bed
from twin.simulation.plants.tissue.volume import Volume

MOST_CELLS = 4
"""Largest number of cells along an axis of a grid; the time of a step grows with the square of the number of cells."""

SURFACE_RADIUS = 0.5 * MM
"""Radius in m by which a surface is thickened for contact."""

SAMPLE_DISTANCE = 5 * MM
"""Distance in m between the sample points of a link; tests whether a link is near or in an organ use these points."""

MOST_ORGANS = 15
"""Largest number of organs. In MuJoCo's contact filter, bit k permits contact of links with organ k, and bit 15 + k
permits contact of organ k with those organs of a larger number that have this bit, too."""


@dataclass(frozen=True)
class Touch:
    """Contact of an organ.

    Attributes:
        triangle: index of the triangle that is pressed deepest; -1: nothing touches the organ.
        force: (3,) total force on the organ in N, in the World.
    """

    triangle: int
    force: Array


NO_TOUCH = Touch(-1, np.zeros(3))


class Organ:
    """An organ in a MuJoCo model; joints of the model move the nodes along the axes of the organ's grid.

    Attributes:
        tissue: the organ at rest.
        nodes: (k, 3) nodes of its grid in the World in m.
        touch: contact in the last step.
        hold: bed and jaws; None if the organ cannot be operated on.
        within: indices of the links that do not touch the organ because they are inside it.
    """

    def __init__(self, tissue: Tissue, index: int, operable: bool) -> None:
        """Compute constants of the organ, before the model is compiled; `index`: number of the organ in the model."""
        self.tissue = tissue
        self._index = index
        self._operable = operable
        self.bit = 1 << index
        self.other_bit = 1 << MOST_ORGANS + index
        # the bed of an operable organ is a constraint for each node, so that it can be freed node by node
        self.fixed = np.zeros(0, int) if operable else tissue.pinned_nodes
        self._triangles = tissue.surface.triangles
        self._origin = tissue.nodes[0]
        self._R_world_grid = tissue.T_world_grid[:3, :3]
        self._volume = Volume(tissue.weights, self._triangles)
        self._rest_volume, self._rest_derivatives = self._volume.at(tissue.nodes - self._origin)
        self._volume_scale = self._rest_volume ** (2 / 3)  # m2; divided by it, the constraint of the volume is in m
        self._surface_tree = KDTree(tissue.surface.vertices)
        corners = tissue.surface.vertices[self._triangles]
        edge = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
        # no point of a triangle is further from all of its corners than the second term
        self._contact_distance = 2 * SAMPLE_DISTANCE + edge / np.sqrt(3)
        self.nodes = tissue.nodes
        self.touch = NO_TOUCH
        self.hold: bed.Hold | None = None
        self.within: set[int] = set()
        self._muted: set[int] = set()

    # -- the model ----------------------------------------------------------------------------------------

    def xml(self, period: float) -> str:
        """Return the organ as an XML element for MuJoCo."""
        t = self.tissue
        affinity = self.bit
        for k in range(self._index):
            affinity |= 1 << MOST_ORGANS + k  # the organs of smaller numbers
        T = t.T_world_grid
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
        mass = t.density * t.surface.volume
        pin = ""
        if len(self.fixed):
            pin = f'<pin id="{_numbers(self.fixed)}"/>'
        return (
            f'<body name="{t.name}:grid" pos="{_numbers(T[:3, 3])}" quat="{_numbers(quaternion)}">'
            f'<flexcomp name="{t.name}" type="direct" dim="2" dof="trilinear" cellcount="{_numbers(t.cells)}" '
            f'mass="{mass!r}" radius="{SURFACE_RADIUS!r}" '
            f'point="{_numbers(t.vertices_in_grid)}" element="{_numbers(self._triangles)}">'
            f'<elasticity young="{t.young!r}" poisson="{t.poisson!r}" damping="{t.damping!r}"/>'
            f'<contact selfcollide="none" contype="{self.other_bit}" conaffinity="{affinity}" condim="3" '
            f'friction="{t.friction!r} 0 0" solref="{2 * period!r} 1" solimp="0.95 0.99 0.0005"/>'
            f"{pin}</flexcomp></body>"
        )

    def constrain(self, spec: mujoco.MjSpec) -> None:
        """Add the constraint of the volume, linear in the joint values of the nodes, and those of bed and jaws.

        Raises:
            WorldError: the pins hold all nodes.
        """
        t = self.tissue
        volume = f"{t.name}_volume"
        self._joints: list[str] = []
        joints_of_nodes: dict[int, list[str]] = {}
        tendon = spec.add_tendon(name=volume)
        nodes_along = [cells + 1 for cells in t.cells]
        for index in np.setdiff1d(np.arange(len(t.nodes)), self.fixed).tolist():
            place = np.unravel_index(index, nodes_along)
            body = spec.body(f"{t.name}_" + "_".join(map(str, place)))  # the name that MuJoCo gave
            if body is None:
                continue  # the cells around this node are empty, and no vertex depends on it
            joints_of_nodes[index] = []
            # MuJoCo scales the constraint by these
            factors = (self._rest_derivatives[index] @ self._R_world_grid / self._volume_scale).tolist()
            for axis, joint, factor in zip("xyz", body.joints, factors, strict=True):
                joint.name = f"{body.name}_{axis}"
                self._joints.append(joint.name)
                joints_of_nodes[index].append(joint.name)
                tendon.wrap_joint(joint.name, factor)
        if not self._joints:
            raise WorldError(
                f"tissue '{t.name}': its pins hold all {len(t.nodes)} nodes of its grid, so that it cannot move; make "
                "their boxes smaller"
            )
        spec.add_equality(
            name=volume,
            type=mujoco.mjtEq.mjEQ_TENDON,
            objtype=mujoco.mjtObj.mjOBJ_TENDON,
            name1=volume,
            solref=[2 * spec.option.timestep, 1.0],
            solimp=[0.99, 0.999, 1e-4, 0.5, 2.0],
        )
        if self._operable:
            bed.add_constraints(spec, t.pinned_nodes, joints_of_nodes)

    def connect(self, m: mujoco.MjModel, d: mujoco.MjData) -> None:
        """Find the organ in the compiled model."""
        self._m = m
        self._d = d
        first = m.flex_nodeadr[self._index]
        nodes = m.flex_nodebodyid[first : first + m.flex_nodenum[self._index]]
        self._free_nodes = np.flatnonzero(m.body_dofnum[nodes])
        self.qpos = np.zeros(len(self._joints), int)
        self.dofs = np.zeros(len(self._joints), int)
        for i, name in enumerate(self._joints):
            joint = m.joint(name)
            self.qpos[i] = joint.qposadr[0]
            self.dofs[i] = joint.dofadr[0]
        self._volume_equality = m.equality(f"{self.tissue.name}_volume").id
        start = m.tendon_adr[m.tendon(f"{self.tissue.name}_volume").id]
        self._volume_wraps = slice(start, start + len(self._joints))
        if self._operable:
            self.hold = bed.Hold(m, d, self.tissue.pinned_nodes, self.dofs, self._free_nodes, self._R_world_grid)

    # -- a step ---------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Linearise the constraint of the volume at the latest nodes.

        The coefficients of the constraint are the derivatives of the volume with respect to the joints.
        """
        content, by_node = self._volume.at(self.nodes - self._origin)
        coefficients = (by_node[self._free_nodes] @ self._R_world_grid).ravel() / self._volume_scale
        change = (content - self._rest_volume) / self._volume_scale
        self._m.wrap_prm[self._volume_wraps] = coefficients
        self._m.eq_data[self._volume_equality, 0] = coefficients @ self._d.qpos[self.qpos] - change

    def end(self) -> None:
        """Correct the volume error left by the linear constraint, by one step of Newton's method."""
        self.read()
        content, by_node = self._volume.at(self.nodes - self._origin)
        change = (by_node[self._free_nodes] @ self._R_world_grid).ravel()
        self._d.qpos[self.qpos] -= change * ((content - self._rest_volume) / (change @ change))
        self.read()

    def read(self) -> None:
        """Compute the nodes from the joint values."""
        self.nodes = self.tissue.nodes.copy()
        self.nodes[self._free_nodes] += self._d.qpos[self.qpos].reshape(-1, 3) @ self._R_world_grid.T

    @property
    def compression(self) -> float:
        """Smallest ratio of local volume to local volume at rest, over the surface; below 0, the material is inverted.

        The organ keeps its total volume, but MuJoCo's elasticity does not keep the volume of small parts.
        """
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (self.tissue.gradients @ self.nodes).transpose(0, 2, 1)
        determinants = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        return float(determinants.min())

    # -- links ----------------------------------------------------------------------------------------------

    def _nearby_points(self, points: Array, corners: Array, T: Array) -> Array:
        """Return those points (k, 3) of a link that are within 2 `SAMPLE_DISTANCE` of the box around the organ.

        Args:
            points: (n, 3) points of the link in its frame in m.
            corners: (8, 3) corners of the box around the points.
            T: (4, 4) T_world_link.

        Returns:
            The points in m in the World.
        """
        low = self.nodes.min(axis=0) - 2 * SAMPLE_DISTANCE
        high = self.nodes.max(axis=0) + 2 * SAMPLE_DISTANCE
        R = T[:3, :3]
        p = T[:3, 3]
        box = corners @ R.T + p
        # most links are far away: their points need not be moved
        if (box.min(axis=0) > high).any() or (box.max(axis=0) < low).any():
            return np.zeros((0, 3))
        in_world = points @ R.T + p
        is_near = ((in_world > low) & (in_world < high)).all(axis=1)
        return in_world[is_near]

    def approached(self, points: Array, corners: Array, T: Array) -> bool:
        """Return whether a link is so near that it may touch the organ; valid only for an organ at rest."""
        nearby = self._nearby_points(points, corners, T)
        if not len(nearby):
            return False
        distances, _ = self._surface_tree.query(nearby)
        return float(distances.min()) < self._contact_distance

    def contains(self, points: Array, corners: Array, T: Array) -> bool:
        """Return whether a point of a link is inside the organ."""
        nearby = self._nearby_points(points, corners, T)
        if not len(nearby):
            return False
        vertices = self.tissue.weights @ self.nodes
        # One by one, because this usually ends early: if a link is inside, one of its first points usually is.
        return any(inside(point, vertices, self._triangles)[0] for point in nearby)

    def set_inside(self, k: int, is_inside: bool) -> None:
        """Store whether link k is inside the organ."""
        if is_inside:
            self.within.add(k)
        else:
            self.within.discard(k)

    def mute(self, links: Sequence[int], on: bool) -> None:
        """Switch off contact of links with the organ if `on` (jaws hold the organ); otherwise, switch it on again."""
        if on:
            self._muted.update(links)
        else:
            self._muted.difference_update(links)

    def may_touch(self, k: int) -> bool:
        """Return whether contact of link k with the organ is switched on."""
        return k not in self.within and k not in self._muted


def require_valid(t: Tissue) -> None:
    """Raise `WorldError` for a parameter outside the tested range."""
    ranges = (
        ("Young's modulus", t.young, 100.0, 1e6, "Pa"),
        ("Poisson's ratio", t.poisson, 0.0, 0.49, ""),
        ("damping", t.damping, 0.0, 1.0, "s"),
        ("density", t.density, 100.0, 5000.0, "kg/m3"),
        ("friction", t.friction, 0.0, 2.0, ""),
        ("number of cells", min(t.cells), 1, MOST_CELLS, "along an axis"),
        ("number of cells", max(t.cells), 1, MOST_CELLS, "along an axis"),
    )
    for quantity, value, low, high, unit in ranges:
        if not low <= value <= high:
            text = f"tissue '{t.name}': {quantity} is {value:g}; it must be {low:g} to {high:g} {unit}"
            raise WorldError(text.rstrip())


def _numbers(values: np.ndarray | Sequence[float]) -> str:
    numbers = np.asarray(values).ravel().tolist()
    return " ".join(repr(number) for number in numbers)
