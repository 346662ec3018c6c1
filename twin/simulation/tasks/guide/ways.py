"""Plan paths ("ways") of one arm around obstacles: props, movable objects, and other robots at given poses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.body import Body
from twin.planning.obstacle_avoidance import around
from twin.reference import ReferenceModel
from twin.reference.obstacles import obstacles
from twin.reference.pairs import Still
from twin.reference.space import JointSpace
from twin.simulation.setup import Setup

_STEP, _TURN = 8 * MM, 10 * DEG
"""Largest motion of the tool, in m and rad, between two poses of a way."""

_FINE = 200
"""Number of points on a path between which the motion of the tool is measured."""


class Ways:
    """Plans ways (collision-free paths) for the arms of a scene, one at a time, with `planning.obstacle_avoidance`."""

    def __init__(self, setup: Setup) -> None:
        """Prepare for the robots, props and objects of a scene; nothing is computed yet."""
        self._scene, self._members, self._props = setup.scene, setup.members, setup.props
        self._places = setup.places

    @property
    def clearance(self) -> float:
        """Usual minimum clearance of a way in m: the required clearance of the scene."""
        return self._scene.clearance

    @cached_property
    def _models(self) -> dict[str, ReferenceModel]:
        return {n: ReferenceModel(m.mechanism) for n, m in self._members.items()}

    def joints(self, robot: str, T_world_tool: Array, q: Array) -> Array:
        """Return the joint values (n,) for a tool pose (4, 4); auxiliary joints keep their values in q (n,).

        Raises:
            KinematicsError: the pose cannot be reached.
        """
        kin = self._members[robot].kin
        found = kin.inverse(spatial.inverse(self._places[robot].T_world_base) @ T_world_tool)
        return np.where(kin.auxiliary, q, found)

    def room(self, robot: str, q: Array) -> float:
        """Return the distance of joint values (n,) to the nearest limit, as a fraction of the range of that joint."""
        mechanism, kin = self._members[robot].mechanism, self._members[robot].kin
        low, high = mechanism.limits.T
        return float((np.minimum(q - low, high - q) / (high - low))[~kin.auxiliary].min())

    def obstacles(self, robot: str, q: Mapping[str, Array], objects: Mapping[str, Array]) -> list[Still]:
        """Return the obstacles of an arm (other robots, props, objects) in its base; for the arguments, see `plan`."""
        T_world_base, poses = self._places[robot].T_world_base, {}
        for name in q.keys() - {robot}:
            links = self._models[name].solve(q[name]).link_poses
            poses[name] = {body: self._places[name].T_world_base @ T for body, T in links.items()}
        mechanisms = {n: m.mechanism for n, m in self._members.items()}
        fixed = obstacles(self._scene, {robot: ""}, T_world_base, mechanisms, self._props, poses)
        T_base_world = spatial.inverse(T_world_base)
        moved = [(o, objects[o.name]) for o in self._scene.objects if o.name in objects]
        return fixed + [Still(o.name, Body(o.name, (o.mesh(),)), T_base_world @ T) for o, T in moved]

    def plan(
        self,
        robot: str,
        goal: Array,
        q: Mapping[str, Array],
        objects: Mapping[str, Array],
        clearance: float,
        seed: int = 0,
    ) -> list[Array]:
        """Return poses (4, 4) of the tool in the World along a way with the clearance; the last pose is at the goal.

        Args:
            robot: the arm that moves.
            goal: joint values (n,) of this arm at the end.
            q: {robot: present joint values (n,)} of this arm and of other robots; robots without values are in their
                rest pose.
            objects: {object: present pose (4, 4) in the World} of the objects that are obstacles.
            clearance: minimum distance in m from bodies that do not touch the arm by design.
            seed: random seed of the search.

        Raises:
            ProtocolError: start or goal is not free, or no way was found.
        """
        T_world_base, kin = self._places[robot].T_world_base, self._members[robot].kin
        around_it = self.obstacles(robot, q, objects)
        space = JointSpace(lambda: self._models[robot], clearance, around=lambda: around_it)
        path = around(space, q[robot], goal, seed=seed)
        Ts = np.array([T_world_base @ kin.forward(x) for x in path(np.linspace(0.0, 1.0, _FINE))])
        return [Ts[k] for k in _stations(Ts)]


def _stations(Ts: Array) -> list[int]:
    """Return the indices of some of the poses (k, 4, 4) along a way, among them the last pose.

    Between neighbouring selected poses, the tool moves at most about `_STEP` and turns at most about `_TURN`.
    """
    moved = np.linalg.norm(np.diff(Ts[:, :3, 3], axis=0), axis=1) / _STEP
    turns = [spatial.log_so3(a[:3, :3].T @ b[:3, :3]) for a, b in pairwise(Ts)]
    turned = np.linalg.norm(turns, axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.maximum(moved, turned / _TURN))])
    count = max(1, int(np.ceil(along[-1])))
    return [int(np.searchsorted(along, along[-1] * i / count)) for i in range(1, count)] + [len(Ts) - 1]
