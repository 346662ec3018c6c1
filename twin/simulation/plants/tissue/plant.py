"""Soft organs in a World: a plant that follows the joint values of the robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.kinematics.closed_loops import LoopSolver
from twin.kinematics.closed_loops.placing import LinkPoses
from twin.model.mechanism import Mechanism
from twin.model.tissue import Tissue
from twin.simulation.plants.tissue.organs import LONGEST_PERIOD, PERIOD, Organs, Tool
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ORGAN_FORCE, ORGAN_NODES, ORGAN_TOUCHED, ROBOT_Q


class Links:
    """Computes the poses of those links of a robot that can touch organs, from the joint values."""

    def __init__(self, robot: str, mechanism: Mechanism, T_world_base: Array, bodies: Sequence[str], q: Array) -> None:
        """Solve the mechanism at joint values q (n,) at the start.

        Raises:
            WorldError: the robot has no body with one of the given names.
            AssemblyError: the loops of the mechanism cannot be closed.
        """
        bodies_by_name = {body.name: body for body in mechanism.bodies}
        for name in bodies:
            if name not in bodies_by_name:
                raise WorldError(unknown(f"body of {robot}", name, bodies_by_name))
        self.signal = ROBOT_Q.of(robot)
        self.tools = [Tool(robot, bodies_by_name[name]) for name in bodies]
        self._T_world_base = np.array(T_world_base, float)
        self._loops = LinkPoses(LoopSolver(mechanism))
        self._solve(np.array(q, float))

    def poses(self, q: Array | None = None) -> list[Array]:
        """Return T_world_link (4, 4) of each link at joint values q (n,); None: at the latest joint values."""
        if q is not None and not np.array_equal(q, self._q):
            self._solve(q.copy())
        return [self.pose(tool.body.name) for tool in self.tools]

    def pose(self, body: str) -> Array:
        """Return T_world_body (4, 4) of any body at the latest joint values."""
        return self._T_world_base @ self._links[body]

    def _solve(self, q: Array) -> None:
        links = self._loops(q)  # if the loops cannot be closed, the last state remains
        self._q = q
        self._links = links


class Tissues(Block):
    """Reads `<robot>.q`; writes the nodes and contacts of the organs.

    The joint values alone move the links; the organs deform.

    Signals:
        `<organ>.nodes` (3 k,): nodes of the organ's grid in the World in m; the vertices are `Tissue.weights` @ nodes.
        `<organ>.touched`: index of the triangle that is pressed deepest; -1: nothing touches the organ.
        `<organ>.force` (3,): total contact force on the organ in the World in N.
    """

    def __init__(
        self, tissues: Sequence[Tissue], robots: Sequence[Links], period: float = PERIOD, operable_name: str = ""
    ) -> None:
        """Build the organs; `period`: time in s between two steps, a multiple of the tick; for the rest, see `Organs`.

        Raises:
            WorldError: a number is out of range, the period is longer than 20 ms, or a link is inside an organ.
        """
        self.period = period
        self._robots = tuple(robots)
        if not period <= LONGEST_PERIOD:
            raise WorldError(f"organs step every {period * 1e3:g} ms; at most {LONGEST_PERIOD * 1e3:g} ms is allowed")
        tools: list[Tool] = []
        poses: list[Array] = []
        for robot in robots:
            tools.extend(robot.tools)
            poses.extend(robot.poses())
        self.organs = Organs(tissues, tools, poses, period, operable_name)
        self.outputs = self._signals()

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, ArrayLike]:
        """Move the links to their joint values, and the organs by the contact forces."""
        poses: list[Array] = []
        for robot in self._robots:
            poses.extend(robot.poses(signals.now[robot.signal]))
        self.organs.step(poses)
        return self._signals()

    def _signals(self) -> dict[str, ArrayLike]:
        values: dict[str, ArrayLike] = {}
        nodes = self.organs.nodes
        for name, touch in self.organs.touches().items():
            values[ORGAN_NODES.of(name)] = nodes[name].ravel()
            values[ORGAN_FORCE.of(name)] = touch.force
            values[ORGAN_TOUCHED.of(name)] = float(touch.triangle)
        return values
