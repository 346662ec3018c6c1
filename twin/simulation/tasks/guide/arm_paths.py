"""Plan paths of one arm around obstacles: props, movable objects, and other robots at given poses."""

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
from twin.reference.collision_pairs import Obstacle
from twin.reference.joint_space import JointSpace
from twin.reference.obstacles import obstacles
from twin.simulation.setup import Setup

_LARGEST_STEP = 8 * MM
"""Largest motion of the tool in m between two poses of a path."""

_LARGEST_TURN = 10 * DEG
"""Largest rotation of the tool in rad between two poses of a path."""

_PATH_POINTS = 200
"""Number of points on a path between which the motion of the tool is measured."""


class ArmPaths:
    """Plans collision-free paths for the arms of a scene, one at a time, with `planning.obstacle_avoidance`."""

    def __init__(self, setup: Setup) -> None:
        """Prepare for the robots, props and objects of a scene; nothing is computed yet."""
        self._scene = setup.scene
        self._members = setup.members
        self._props = setup.props
        self._places = setup.places

    @property
    def clearance(self) -> float:
        """Usual minimum clearance of a path in m: the required clearance of the scene."""
        return self._scene.clearance

    @cached_property
    def _models(self) -> dict[str, ReferenceModel]:
        models = {}
        for name, member in self._members.items():
            models[name] = ReferenceModel(member.mechanism)
        return models

    def joints(self, robot: str, T_world_tool: Array, q: Array) -> Array:
        """Return the joint values (n,) for a tool pose (4, 4); auxiliary joints keep their values in q (n,).

        Raises:
            KinematicsError: the pose cannot be reached.
        """
        kin = self._members[robot].kin
        T_base_world = spatial.inverse(self._places[robot].T_world_base)
        q_tool = kin.inverse(T_base_world @ T_world_tool)
        return np.where(kin.auxiliary, q, q_tool)

    def room(self, robot: str, q: Array) -> float:
        """Return the distance of joint values (n,) to the nearest limit, as a fraction of the range of that joint."""
        member = self._members[robot]
        low, high = member.mechanism.limits.T
        fractions = np.minimum(q - low, high - q) / (high - low)
        # the jaws of an instrument do not move its tool
        return float(fractions[~member.kin.auxiliary].min())

    def obstacles(self, robot: str, q: Mapping[str, Array], objects: Mapping[str, Array]) -> list[Obstacle]:
        """Return the obstacles of an arm (other robots, props, objects) in its base; for the arguments, see `plan`."""
        T_world_base = self._places[robot].T_world_base
        poses: dict[str, dict[str, Array]] = {}
        for other_robot, q_other in q.items():
            if other_robot == robot:
                continue
            T_world_other = self._places[other_robot].T_world_base
            poses[other_robot] = {}
            for body, T in self._models[other_robot].solve(q_other).link_poses.items():
                poses[other_robot][body] = T_world_other @ T
        mechanisms = {name: member.mechanism for name, member in self._members.items()}
        found = obstacles(self._scene, {robot: ""}, T_world_base, mechanisms, self._props, poses)
        T_base_world = spatial.inverse(T_world_base)
        for item in self._scene.objects:
            if item.name in objects:
                body = Body(item.name, (item.mesh(),))
                found.append(Obstacle(item.name, body, T_base_world @ objects[item.name]))
        return found

    def plan(
        self,
        robot: str,
        goal: Array,
        q: Mapping[str, Array],
        objects: Mapping[str, Array],
        clearance: float,
        seed: int = 0,
    ) -> list[Array]:
        """Return poses (4, 4) of the tool in the World along a path with the clearance; the last pose is at the goal.

        Args:
            robot: the arm that moves.
            goal: joint values (n,) of this arm at the end.
            q: {robot: present joint values (n,)} of this arm and of other robots; robots without values are in their
                rest pose.
            objects: {object: present pose (4, 4) in the World} of the objects that are obstacles.
            clearance: minimum distance in m from bodies that do not touch the arm by design.
            seed: random seed of the search.

        Raises:
            ProtocolError: start or goal is not free, or no path was found.
        """
        obstacles = self.obstacles(robot, q, objects)
        space = JointSpace(lambda: self._models[robot], clearance, around=lambda: obstacles)
        path = around(space, q[robot], goal, seed=seed)
        T_world_base = self._places[robot].T_world_base
        kin = self._members[robot].kin
        poses = []
        for q_on_path in path(np.linspace(0.0, 1.0, _PATH_POINTS)):
            poses.append(T_world_base @ kin.forward(q_on_path))
        return [poses[k] for k in _stations(np.array(poses))]


def _stations(Ts: Array) -> list[int]:
    """Return the indices of some of the poses (k, 4, 4) along a path, among them the last pose.

    Between neighbouring selected poses, the tool moves at most about `_LARGEST_STEP`, and turns at most about
    `_LARGEST_TURN`.
    """
    distances = np.linalg.norm(np.diff(Ts[:, :3, 3], axis=0), axis=1)
    turns = []
    for before, after in pairwise(Ts):
        turns.append(spatial.log_so3(before[:3, :3].T @ after[:3, :3]))
    angles = np.linalg.norm(turns, axis=1)
    # length of the path in units of the largest motion between two stations
    along = np.concatenate([[0.0], np.cumsum(np.maximum(distances / _LARGEST_STEP, angles / _LARGEST_TURN))])
    count = max(1, int(np.ceil(along[-1])))
    stations = []
    for i in range(1, count):
        stations.append(int(np.searchsorted(along, along[-1] * i / count)))
    stations.append(len(Ts) - 1)
    return stations
