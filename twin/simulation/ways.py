"""Ways of an arm of a scene around everything else: props, the other robots where they are, and movable objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics
from twin.model.body import Body
from twin.model.mechanism import Mechanism
from twin.model.movable import Movable
from twin.model.scene import Place
from twin.planning.around import around
from twin.reference import ReferenceModel
from twin.reference.pairs import Still
from twin.reference.space import JointSpace

_STEP, _TURN = 8 * MM, 10 * DEG
"""Largest motion of the tool between two poses of a way."""

_FINE = 200
"""Number of places on a path between which the motion of the tool is measured."""

CLEARANCE = 2 * MM
"""Distance in m that a way usually keeps; ASSUMED."""


class Ways:
    """Plans ways for the arms of a scene, one arm at a time, with `planning.around`."""

    def __init__(
        self,
        arms: Mapping[str, tuple[Place, Mechanism, Kinematics]],
        props: Mechanism | None,
        objects: Sequence[Movable],
    ) -> None:
        """Set up; nothing is computed yet.

        Args:
            arms: place, mechanism and equations of every robot, by name.
            props: mechanism of the props.
            objects: the movable objects.
        """
        self._arms, self._props, self._objects = dict(arms), props, tuple(objects)

    @cached_property
    def _models(self) -> dict[str, ReferenceModel]:
        return {name: ReferenceModel(mechanism) for name, (_, mechanism, _) in self._arms.items()}

    @cached_property
    def _fixed(self) -> list[tuple[str, Body, Array]]:
        """Name, body and pose in the World of each body of the props."""
        if self._props is None:
            return []
        poses = ReferenceModel(self._props).home().link_poses
        return [(f"props/{b.name}", b, poses[b.name]) for b in self._props.bodies]

    def joints(self, robot: str, T_world_tool: Array, q: Array) -> Array:
        """Return the joint values (n,) for a pose (4, 4) of the tool; the auxiliary joints are those of q (n,).

        Raises:
            KinematicsError: the pose cannot be reached.
        """
        place, _, kin = self._arms[robot]
        found = kin.inverse(spatial.inverse(place.T_world_base) @ T_world_tool)
        return np.where(kin.auxiliary, q, found)

    def room(self, robot: str, q: Array) -> float:
        """Return the distance of joint values (n,) to the nearest limit, as a fraction of the range of that joint."""
        _, mechanism, kin = self._arms[robot]
        low, high = mechanism.limits.T
        return float((np.minimum(q - low, high - q) / (high - low))[~kin.auxiliary].min())

    def plan(
        self,
        robot: str,
        goal: Array,
        q: Mapping[str, Array],
        objects: Mapping[str, Array],
        clearance: float = CLEARANCE,
        seed: int = 0,
    ) -> list[Array]:
        """Return poses (4, 4) of the tool in the World along a way that keeps the clearance, the last one at the goal.

        Args:
            robot: the arm that moves.
            goal: its joint values (n,) at the end.
            q: present joint values (n,) of all robots.
            objects: present poses (4, 4) of the objects in the World that are in the way.
            clearance: distance in m to keep.
            seed: random seed of the search.

        Raises:
            ProtocolError: start or goal is not free, or no way was found.
        """
        place, _, kin = self._arms[robot]
        T_base_world = spatial.inverse(place.T_world_base)
        bodies = list(self._fixed)
        for name, (other, mechanism, _) in self._arms.items():
            if name != robot:
                links = self._models[name].solve(q[name]).link_poses
                bodies += [(f"{name}/{b.name}", b, other.T_world_base @ links[b.name]) for b in mechanism.bodies]
        bodies += [(o.name, Body(o.name, (o.mesh(),)), objects[o.name]) for o in self._objects if o.name in objects]
        stills = [Still(name, body, T_base_world @ T) for name, body, T in bodies]
        space = JointSpace(lambda: self._models[robot], clearance, around=lambda: stills)
        path = around(space, q[robot], goal, seed=seed)
        Ts = np.array([place.T_world_base @ kin.forward(x) for x in path(np.linspace(0.0, 1.0, _FINE))])
        return [Ts[k] for k in _stations(Ts)]


def _stations(Ts: Array) -> list[int]:
    """Return the indices of poses (k, 4, 4) that are at most `_STEP` and `_TURN` apart, with the last one."""
    moved = np.linalg.norm(np.diff(Ts[:, :3, 3], axis=0), axis=1) / _STEP
    turns = [spatial.log_so3(a[:3, :3].T @ b[:3, :3]) for a, b in pairwise(Ts)]
    turned = np.linalg.norm(turns, axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.maximum(moved, turned / _TURN))])
    count = max(1, int(np.ceil(along[-1])))
    return [int(np.searchsorted(along, along[-1] * i / count)) for i in range(1, count)] + [len(Ts) - 1]
