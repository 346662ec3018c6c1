"""States of a mechanism, one or at many samples, and how they are read from configurations of its tree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.reference.tree import Tree


@dataclass(frozen=True)
class Assembly:
    """A solved state of the mechanism.

    Attributes:
        T_base_tool: (4, 4) pose of the tool.
        q: (n,) active joint values in m or rad.
        q_full: {name: value in m or rad} of the joints with a single coordinate, including loop joints.
        link_poses: T_base_body (4, 4) by name of the body.
        points: named points (3,) in base, in m.
        gap: {name: (offset in m, rotation in rad)} of the loop joints, in their locked directions.
        x: (nq,) configuration in Pinocchio's coordinates; further solutions can start from this configuration.
    """

    T_base_tool: Array
    q: Array
    q_full: dict[str, float]
    link_poses: dict[str, Array]
    points: dict[str, Array]
    gap: dict[str, tuple[float, float]]
    x: Array

    @property
    def worst_gap(self) -> float:
        """Largest loop offset in m; 0 without loops."""
        return max((g[0] for g in self.gap.values()), default=0.0)


@dataclass(frozen=True)
class SolvedSamples:
    """Solved states at k samples; the first axis of each array is the sample.

    Attributes:
        x: (k, nq) configurations.
        q: (k, n) active joint values in m or rad.
        Ts_base_tool: (k, 4, 4) tool poses.
        q_passive: {name: values (k,) in m or rad} of the passive joints with a single coordinate.
        points: positions (k, 3) of each named point in base, in m.
        gaps: (k, loops, 2) loop gaps: offset in m, rotation in rad.
        loop_names: names of the loops, in the order of the second axis of `gaps`.
    """

    x: Array
    q: Array
    Ts_base_tool: Array
    q_passive: dict[str, Array]
    points: dict[str, Array]
    gaps: Array
    loop_names: tuple[str, ...]


def assembly_at(tree: Tree, x: Array) -> Assembly:
    """Return the assembly at configuration x (nq,), even if its loops are open."""
    run = samples_at(tree, x[None])
    poses, _ = tree.update(x[None])
    coordinates = {}
    for name, place in tree.configuration.items():
        coordinates[name] = float(x[place])
    for name, values in tree.loops.coordinates(poses).items():
        coordinates[name] = float(values[0])
    q_full = {}
    for joint in tree.mechanism.joints:
        if joint.name in coordinates:
            q_full[joint.name] = coordinates[joint.name]
    link_poses = {}
    for body in tree.mechanism.bodies:
        link_poses[body.name] = _body_poses(tree, poses, body.name)[0]
    points = {name: positions[0] for name, positions in run.points.items()}
    gaps = {}
    for name, (offset, tilt) in zip(run.loop_names, run.gaps[0], strict=True):
        gaps[name] = (float(offset), float(tilt))
    return Assembly(
        T_base_tool=run.Ts_base_tool[0],
        q=run.q[0],
        q_full=q_full,
        link_poses=link_poses,
        points=points,
        gap=gaps,
        x=x,
    )


def samples_at(tree: Tree, states: Array) -> SolvedSamples:
    """Return the `SolvedSamples` of configurations (k, nq), even if their loops are open."""
    poses, _ = tree.update(states, closing_only=True)
    loop_values = tree.loops.coordinates(poses)
    passive = {}
    for joint in tree.mechanism.passive:
        place = tree.configuration.get(joint.name)
        if place is None:
            passive[joint.name] = loop_values[joint.name]
        else:
            passive[joint.name] = states[:, place]
    points = {}
    for point in tree.mechanism.points:
        p_body = np.append(point.p_body, 1.0)
        p_base = _body_poses(tree, poses, point.body) @ p_body
        points[point.name] = p_base[:, :3]
    return SolvedSamples(
        x=states,
        q=states[:, tree.active_places],
        Ts_base_tool=tree.tool(poses),
        q_passive=passive,
        points=points,
        gaps=tree.loops.gaps(states, poses),
        loop_names=tree.loops.names,
    )


def link_poses_at(tree: Tree, states: Array) -> dict[str, Array]:
    """Return {name: T_base_body (k, 4, 4)} of all bodies at configurations (k, nq)."""
    poses, _ = tree.update(states)
    return {body.name: _body_poses(tree, poses, body.name) for body in tree.mechanism.bodies}


def _body_poses(tree: Tree, poses: Array, body: str) -> Array:
    """Return T_base_body (k, 4, 4) of a body, from joint poses (k, joints, 4, 4) of `Tree.update`."""
    number, T_joint_body = tree.body(body)
    return poses[:, number] @ T_joint_body
