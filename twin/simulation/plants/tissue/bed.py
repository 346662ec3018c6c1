"""The bed (tissue that holds an organ) and the jaws that hold a point of the organ; the bed is freed node by node.

Bed and jaws are constraints of MuJoCo on the joints of the organ's nodes. The position of a material point is a
weighted sum of the nodes, and therefore linear in the joint values. In MuJoCo, such a linear function is a tendon.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from twin.core.spatial import Array, Index
from twin.core.units import MM

GRIPS = 2
"""Number of instruments whose jaws can hold the organ at once."""

_DRAG_RATE = 2.0
"""Damping by the organ's surroundings, divided by the organ's mass, in 1/s; ASSUMED. A freed organ comes to rest."""

_SLIP_STEP = 0.5 * MM
"""Distance in m by which jaws slide in a step at twice the force limit; proportional to the force above the limit."""

_LARGEST_EXCESS = 2.0
"""Largest excess of the force over its limit, as a multiple of the limit, that counts for the slip of a step."""

_IMPEDANCE = [0.99, 0.999, 1e-4, 0.5, 2.0]
"""Impedance of the constraints (`solimp` of MuJoCo): from 0.99 to 0.999 within 1e-4 m of the constraint."""

_REST_FORCE = 1e-4
"""Maximum force in N at which an organ stays at rest."""


@dataclass
class Grip:
    """Jaws that hold a material point.

    Attributes:
        weights: (k,) weights of the nodes; the position of the point is weights @ nodes.
        limit: maximum friction force of the jaws in N.
        p: (3,) position in m in the World at which the jaws hold the point.
        offset: (3,) displacement in m of the point from `p`, caused by slipping.
        force: (3,) force on the organ in the last step in N.
    """

    weights: Array
    limit: float
    p: Array
    offset: Array
    force: Array

    @property
    def slipped(self) -> float:
        """Distance in m by which the point has slipped."""
        return float(np.linalg.norm(self.offset))


def add_constraints(spec: mujoco.MjSpec, held: Index, joints_of_nodes: Mapping[int, Sequence[str]]) -> None:
    """Add the constraints of the bed's nodes and of the jaws.

    `joints_of_nodes`: names of the three joints of each node that can move; the bed holds no other node.
    """
    solref = [2 * spec.option.timestep, 1.0]  # twice the step: the stiffest constraint that is stable
    for node in held.tolist():
        for axis, joint in enumerate(joints_of_nodes.get(node, ())):
            spec.add_equality(
                name=f"bed_{node}_{axis}",
                type=mujoco.mjtEq.mjEQ_JOINT,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                name1=joint,
                solref=solref,
                solimp=_IMPEDANCE,
            )
    for k in range(GRIPS):
        for axis in range(3):
            name = f"grip_{k}_{axis}"
            tendon = spec.add_tendon(name=name)
            for joints in joints_of_nodes.values():
                # `grasp` writes the weights of the held point
                tendon.wrap_joint(joints[axis], 1.0 / len(joints_of_nodes))
            spec.add_equality(
                name=name,
                type=mujoco.mjtEq.mjEQ_TENDON,
                objtype=mujoco.mjtObj.mjOBJ_TENDON,
                name1=name,
                active=False,
                solref=solref,
                solimp=_IMPEDANCE,
            )


class Hold:
    """Attaches an organ to its bed and to jaws.

    Attributes:
        grips: the jaws that hold the organ; the keys are the numbers of the instruments.
        held: indices of the nodes that the bed holds; the nodes that were freed are left out.
    """

    def __init__(
        self, m: mujoco.MjModel, d: mujoco.MjData, held: Index, dofs: Index, free: Index, R_world_grid: Array
    ) -> None:
        """Find the constraints of bed and jaws in the compiled model.

        Args:
            m: the model.
            d: state of the model.
            held: indices of the nodes that the bed holds at the start.
            dofs: (3 k,) indices in qvel of three velocities for each free node, along the axes of the grid.
            free: (k,) indices of the nodes that can move.
            R_world_grid: (3, 3) orientation of the grid.
        """
        self._m = m
        self._d = d
        self._dofs = dofs
        self._free_nodes = free
        self._bed_nodes = held
        self._R_world_grid = R_world_grid
        self._node_masses = m.body_mass[m.dof_bodyid[dofs[::3]]]
        m.dof_damping[dofs] = _DRAG_RATE * np.repeat(self._node_masses, 3)
        self._jaw_equalities: list[list[int]] = []
        self._jaw_tendons: list[list[int]] = []
        for k in range(GRIPS):
            equalities = []
            tendons = []
            for axis in range(3):
                name = f"grip_{k}_{axis}"
                equalities.append(m.equality(name).id)
                tendons.append(m.tendon(name).id)
            self._jaw_equalities.append(equalities)
            self._jaw_tendons.append(tendons)
        self.reset()

    def reset(self) -> None:
        """Attach all nodes of the bed, and open all jaws."""
        self.grips: dict[int, Grip] = {}
        self.held = set(self._bed_nodes.tolist())
        self._pulls = np.zeros((len(self._free_nodes), 3))
        self._d.eq_active[:] = self._m.eq_active0

    def let_go(self, node: int) -> None:
        """Free a node of the bed."""
        self.held.discard(node)
        if node not in self._free_nodes:
            return  # without material around it, it is not held
        for axis in range(3):
            self._d.eq_active[self._m.equality(f"bed_{node}_{axis}").id] = 0

    def grasp(self, k: int, weights: Array, p_world: Array, limit: float) -> None:
        """Let jaws k hold the point `weights @ nodes` at p_world (3,) in m with a force of at most `limit` in N."""
        self.grips[k] = Grip(weights, limit, p_world.copy(), np.zeros(3), np.zeros(3))
        w = weights[self._free_nodes]
        for axis in range(3):
            tendon = self._jaw_tendons[k][axis]
            start = self._m.tendon_adr[tendon]
            self._m.wrap_prm[start : start + len(w)] = w
            # MuJoCo scales the constraint by the inverse mass that it computed for the weights at compilation
            self._m.tendon_invweight0[tendon] = float((w * w / self._node_masses).sum())
            self._d.eq_active[self._jaw_equalities[k][axis]] = 1

    def release(self, k: int) -> None:
        """Open jaws k."""
        if self.grips.pop(k, None) is not None:
            self._d.eq_active[self._jaw_equalities[k]] = 0

    def pull(self, weights: Array, force_world: Array) -> None:
        """Apply a force (3,) in N in the World to the point weights @ nodes in the next step."""
        self._pulls += np.outer(weights[self._free_nodes], force_world)

    def begin(self, rest: Array) -> bool:
        """Set the constraints of the jaws and the forces of `pull` before a step; return whether the organ may move.

        Args:
            rest: (k, 3) positions of the nodes at rest in the World in m.
        """
        for k, grip in self.grips.items():
            displacement = grip.p + grip.offset - grip.weights @ rest
            self._m.eq_data[self._jaw_equalities[k], 0] = displacement @ self._R_world_grid
        pulled = float(np.abs(self._pulls).sum()) > _REST_FORCE
        self._d.qfrc_applied[self._dofs] = (self._pulls @ self._R_world_grid).ravel()
        self._pulls[:] = 0.0
        return bool(self.grips) or pulled or len(self.held) < len(self._bed_nodes)

    def end(self) -> None:
        """Read the forces of the jaws after a step; let the jaws slide if their friction limit is exceeded."""
        d = self._d
        rows = np.flatnonzero(d.efc_type[: d.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        by_equality = dict(zip(d.efc_id[rows].tolist(), d.efc_force[rows].tolist(), strict=True))
        for k, grip in self.grips.items():
            along_grid = np.array([by_equality.get(equality, 0.0) for equality in self._jaw_equalities[k]])
            grip.force = self._R_world_grid @ along_grid
            magnitude = float(np.linalg.norm(grip.force))
            if magnitude > grip.limit:
                # with a largest value, so that a sudden pull does not throw the point out of the jaws in one step
                excess = min(magnitude / grip.limit - 1.0, _LARGEST_EXCESS)
                grip.offset = grip.offset - grip.force / magnitude * excess * _SLIP_STEP
