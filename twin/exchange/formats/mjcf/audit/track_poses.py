"""Compute the poses of an MJCF's bodies along a track: MuJoCo places them at the joint values of each key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.chain_poses import ChainStep, solve_chain
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.file_joints import WORLD
from twin.exchange.audit.ledger import Ledger, um
from twin.exchange.audit.pose_deviation import or_infinite
from twin.exchange.audit.poses import Array
from twin.exchange.formats.mjcf.audit.equality_residuals import gap_text, largest_gap
from twin.exchange.formats.mjcf.audit.mujoco_conventions import BALL, FREE, HINGE, SLIDE, W_XYZ, XYZ_W

LOOP_TOL = 1e-6
"""Maximum residual of an equality constraint at the joint values of a track, in m or (rotation of a weld) in rad."""


def play_track(model: mujoco.MjModel, bodies: Mapping[str, int], clip: FileClip, ledger: Ledger) -> FileClip:
    """Return the clip of poses T_world_link (k, 4, 4) that MuJoCo computes from a track; report open loops.

    `bodies` maps links to MuJoCo's body numbers. Joint values that the track does not state are computed from the poses
    of the links in the track.
    """
    coordinates = TrackCoordinates(model, clip).all_keys()
    data = mujoco.MjData(model)
    count = len(clip.times)
    positions = np.zeros((count, model.nbody, 3))
    quaternions = np.zeros((count, model.nbody, 4))
    worst_gap = 0.0
    loop = ""
    when = ""
    for key in range(count):
        data.qpos[:] = coordinates[key]
        mujoco.mj_fwdPosition(model, data)
        positions[key] = data.xpos
        quaternions[key] = data.xquat
        gap, equality = largest_gap(model, data)
        gap = or_infinite(gap)
        if gap > worst_gap:
            worst_gap = gap
            loop = equality
            when = f"t = {clip.times[key]:.4g} s"
    if model.neq:
        ledger.row(f"clip '{clip.name}': loops in MuJoCo", worst_gap, "m", LOOP_TOL, where=loop, when=when)
    if worst_gap > LOOP_TOL:
        text = f"clip '{clip.name}': equality '{loop}' is open by {gap_text(model, loop, worst_gap)}."
        if not np.isfinite(worst_gap):
            text = f"clip '{clip.name}': the residual of equality '{loop}' is not a finite number."
        ledger.wrong("mjcf.loop", text, loop, size=um(worst_gap, LOOP_TOL), when=when)
    T_world_body = poses.pose(poses.rotation(quaternions[..., XYZ_W]), positions)
    numbers = {WORLD: 0, **bodies}  # a base named world is MuJoCo's own fixed body
    links: dict[str, Array] = {}
    for name, body in numbers.items():
        if name in clip.links:
            links[name] = T_world_body[:, body]
    return FileClip(clip.name, clip.times, links)


class TrackCoordinates:
    """The coordinates `qpos` of a model at the keys of a track."""

    def __init__(self, model: mujoco.MjModel, clip: FileClip) -> None:
        self._model = model
        self._clip = clip

    def all_keys(self) -> Array:
        """Return qpos (k, nq) at the k keys; coordinates of which the track says nothing are those at home."""
        qpos = np.tile(self._model.qpos0, (len(self._clip.times), 1))
        for body in range(1, self._model.nbody):
            self._set(body, qpos)
        return qpos

    def _set(self, body: int, qpos: Array) -> None:
        """Set the coordinates of one body's joints at all keys, from the track's joint values or link poses."""
        model = self._model
        first = model.body_jntadr[body]
        joints = range(first, first + model.body_jntnum[body])
        if not joints:
            return
        if model.jnt_type[first] == FREE:  # every pose of the body is a pose of the joint
            T_parent_body = self._relative_pose(body)
            if T_parent_body is not None:
                address = model.jnt_qposadr[first]
                qpos[:, address : address + 3] = T_parent_body[:, :3, 3]
                qpos[:, address + 3 : address + 7] = poses.quaternion(T_parent_body[:, :3, :3])[:, W_XYZ]
            return
        steps: list[ChainStep] = []
        stated: list[Array | None] = []
        owners: list[int] = []
        is_incomplete = False
        for step, values, owner in self._chain(body, joints):
            steps.append(step)
            stated.append(values)
            owners.append(owner)
            if values is None and step.kind != "fixed":
                is_incomplete = True
        if is_incomplete:
            T_parent_body = self._relative_pose(body)
            if T_parent_body is not None:
                stated = solve_chain(steps, stated, T_parent_body)
        for joint in joints:
            joint_values: list[Array] = []
            for values, owner in zip(stated, owners, strict=True):
                if owner == joint and values is not None:
                    joint_values.append(values)
            if joint_values:
                self._set_joint(joint, joint_values, qpos)

    def _set_joint(self, joint: int, values: list[Array], qpos: Array) -> None:
        """Set the coordinates of a joint: those of a ball from its three turns, those of others from one value (k,)."""
        address = self._model.jnt_qposadr[joint]
        if self._model.jnt_type[joint] != BALL:
            qpos[:, address] = values[0] + self._model.qpos0[address]
            return
        about_x, about_y, about_z = values
        R = poses.about([1, 0, 0], about_x) @ poses.about([0, 1, 0], about_y) @ poses.about([0, 0, 1], about_z)
        qpos[:, address : address + 4] = poses.quaternion(R)[:, W_XYZ]

    def _chain(self, body: int, joints: range) -> Iterator[tuple[ChainStep, Array | None, int]]:
        """Yield (step, values, joint) for each step of the chain from a body's parent to the body.

        `values` (k,) are the joint values in m or rad, None if unknown. `joint` is MuJoCo's joint number, or -1 for a
        step without a joint.
        """
        model = self._model
        R_parent_body = poses.rotation(model.body_quat[body][XYZ_W])
        yield ChainStep(poses.pose(R_parent_body, model.body_pos[body])), None, -1
        for joint in joints:
            anchor = poses.pose(None, model.jnt_pos[joint])
            if model.jnt_type[joint] == BALL:
                x, y, z = np.eye(3)
                yield ChainStep(anchor, "turn", x), None, joint
                yield ChainStep(np.eye(4), "turn", y), None, joint
                yield ChainStep(np.eye(4), "turn", z), None, joint
            elif model.jnt_type[joint] in (HINGE, SLIDE):
                kind = "turn" if model.jnt_type[joint] == HINGE else "slide"
                values = self._clip.joints.get(model.joint(joint).name)
                if values is not None:
                    values = values - model.qpos0[model.jnt_qposadr[joint]]  # MuJoCo's poses are those at `ref`
                yield ChainStep(anchor, kind, model.jnt_axis[joint].copy()), values, joint
            yield ChainStep(poses.inverse(anchor)), None, -1

    def _relative_pose(self, body: int) -> Array | None:
        """Return T_parent_body (k, 4, 4) from the track: poses of `body` or of a body welded to it; None if unknown."""
        T_world_parent = self._pose(self._model.body_parentid[body])
        T_world_body = self._pose(body)
        if T_world_body is None:
            T_world_body = self._pose_by_weld(body)
        if T_world_parent is None or T_world_body is None:
            return None
        return poses.inverse(T_world_parent) @ T_world_body

    def _pose(self, body: int) -> Array | None:
        """Return T_world_body (k, 4, 4) in the track; None if the track does not state it."""
        if body == 0:
            return np.broadcast_to(np.eye(4), (len(self._clip.times), 4, 4))
        return self._clip.links.get(self._model.body(body).name)

    def _pose_by_weld(self, body: int) -> Array | None:
        """Return T_world_body (k, 4, 4) from the pose of a body that a weld of two sites holds to it."""
        model = self._model
        for equality in range(model.neq):
            if (
                model.eq_type[equality] != mujoco.mjtEq.mjEQ_WELD
                or model.eq_objtype[equality] != mujoco.mjtObj.mjOBJ_SITE
            ):
                continue
            first = int(model.eq_obj1id[equality])
            second = int(model.eq_obj2id[equality])
            for site, welded_site in ((first, second), (second, first)):
                T_world_other = self._pose(int(model.site_bodyid[welded_site]))
                if model.site_bodyid[site] == body and T_world_other is not None:
                    return T_world_other @ self._site(welded_site) @ poses.inverse(self._site(site))
        return None

    def _site(self, site: int) -> Array:
        """Return T_body_site (4, 4)."""
        R_body_site = poses.rotation(self._model.site_quat[site][XYZ_W])
        return poses.pose(R_body_site, self._model.site_pos[site])
