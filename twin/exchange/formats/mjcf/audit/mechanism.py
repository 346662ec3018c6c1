"""Read the mechanism data of an MJCF from the model that MuJoCo compiles."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.mechanism_data import VACUUM, FileFrame, FileMass, FileMechanism
from twin.exchange.audit.motion_lines import JointLine
from twin.exchange.formats.mjcf.audit.drives import read_drives, read_motors
from twin.exchange.formats.mjcf.audit.equalities import (
    is_between_sites,
    loop_joints,
    nonempty_names,
    opening_under_load,
    read_couplings,
)
from twin.exchange.formats.mjcf.audit.mujoco_conventions import BALL, HINGE, NO_GRAVITY, SLIDE, XYZ_W, pose_of

FRAME_PREFIX = "frame_"
"""Prefix in the names of sites that represent named frames."""

POINT_PREFIX = "point_"
"""Prefix in the names of sites that represent named points. All other sites belong to loop closures."""


def compiled_mechanism(model: mujoco.MjModel, bodies: dict[str, int]) -> FileMechanism:
    """Return the mechanism data of a compiled model.

    `bodies` maps link names to MuJoCo's body numbers; the world may be one of the links.
    """
    gravity = np.zeros(3) if model.opt.disableflags & NO_GRAVITY else np.array(model.opt.gravity)
    mechanism = FileMechanism(tuple(bodies), complete=True, gravity=gravity, couplings=read_couplings(model))
    mechanism.medium = VACUUM
    if model.opt.density or model.opt.viscosity:  # without them, wind has no effect
        mechanism.medium = (model.opt.density, model.opt.viscosity, *model.opt.wind.tolist())
    mechanism.motors = read_motors(model)
    mechanism.all_motors = True
    mechanism.self_collision = _self_collision(model)
    fixed_links: set[str] = set()
    weight_shares: dict[str, float] = {}
    shown: dict[str, bool] = {}
    for name, body in bodies.items():
        weight_shares[name] = float(model.body_gravcomp[body])
        if body:  # the world has floors and walls
            shown[name] = bool(model.body_geomnum[body])
        # A body fixed to the world needs no mass: 0 means "not stated".
        if body and (model.body_mass[body] or model.body_weldid[body]):
            R = poses.rotation(model.body_iquat[body][XYZ_W])
            inertia = R @ np.diag(model.body_inertia[body]) @ R.T
            mechanism.masses[name] = FileMass(float(model.body_mass[body]), model.body_ipos[body].copy(), inertia)
        if body == 0 or (model.body_parentid[body] == 0 and not model.body_jntnum[body]):
            fixed_links.add(name)
    mechanism.weight_shares = weight_shares
    mechanism.shown = shown
    names = [model.body(number).name for number in range(model.nbody)]
    drives = read_drives(model, mechanism.motors)
    for body in range(1, model.nbody):
        mechanism.joints.append(_tree_joint(model, body, names, drives))
    mechanism.fixed_to_world = frozenset(fixed_links)
    mechanism.joints += loop_joints(model, names)
    _read_sites(model, names, mechanism)
    mechanism.opening = opening_under_load(model)
    return mechanism


def _self_collision(model: mujoco.MjModel) -> bool:
    """Return whether shapes of any two moving bodies are allowed to collide, also if they never meet.

    MuJoCo filters collisions by the bits of two shapes: one's contype and the other's conaffinity share a bit.
    """
    robot = model.body_weldid[model.geom_bodyid] > 0  # not fixed to the world, as floors and the base are
    types = np.bitwise_or.reduce(model.geom_contype[robot], initial=0)
    affinities = np.bitwise_or.reduce(model.geom_conaffinity[robot], initial=0)
    return bool(types & affinities)


def _tree_joint(model: mujoco.MjModel, body: int, names: list[str], drives: list[FileDrive]) -> FileJoint:
    """Return the joint between a body and its parent; a body may have several joints of MuJoCo, or none."""
    T = pose_of(model.body_pos[body], model.body_quat[body])
    first = model.body_jntadr[body]
    joints = range(first, first + model.body_jntnum[body])
    labels: list[str] = []
    motions: list[JointLine] = []
    driven: list[FileDrive] = []
    for joint in joints:
        labels.append(model.joint(joint).name)
        if drives[joint].driven:
            driven.append(drives[joint])
        for line in _motions(model, joint):
            motions.append(line.transformed(T))
    if len(joints) == 1 and model.jnt_type[first] in (HINGE, SLIDE):  # a body is placed at `ref`, not at zero
        T = motions[0].motion(-float(model.qpos0[model.jnt_qposadr[first]])) @ T
    drive = FileDrive()
    if len(joints) == 1:
        drive = drives[first]
    elif len(driven) == 1:
        drive = driven[0]
    parent = names[model.body_parentid[body]]
    return FileJoint(nonempty_names(labels), parent, names[body], T, tuple(motions), drive)


def _read_sites(model: mujoco.MjModel, names: list[str], mechanism: FileMechanism) -> None:
    """Add the named frames and points of the sites to `mechanism`; sites that equality constraints join are neither."""
    loop_sites: set[int] = set()
    for equality in range(model.neq):
        if is_between_sites(model, equality):
            loop_sites.update((int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])))
    for site in range(model.nsite):
        if site in loop_sites:
            continue
        label = model.site(site).name
        T = pose_of(model.site_pos[site], model.site_quat[site])
        body = names[model.site_bodyid[site]]
        if label.startswith(POINT_PREFIX):
            mechanism.points[label.removeprefix(POINT_PREFIX)] = FileFrame(body, poses.pose(None, T[:3, 3]))
            mechanism.fully_listed |= {"point"}
            continue
        mechanism.frames[label.removeprefix(FRAME_PREFIX)] = FileFrame(body, T)
        if label.startswith(FRAME_PREFIX):
            mechanism.fully_listed |= {"frame"}


def _motions(model: mujoco.MjModel, joint: int) -> list[JointLine]:
    point = model.jnt_pos[joint].copy()
    axis = model.jnt_axis[joint].copy()
    if model.jnt_type[joint] == SLIDE:
        return [JointLine("slide", point, axis)]
    if model.jnt_type[joint] == HINGE:
        return [JointLine("turn", point, axis)]
    slides: list[JointLine] = []
    turns: list[JointLine] = []
    for direction in np.eye(3):
        slides.append(JointLine("slide", point, direction))
        turns.append(JointLine("turn", point, direction))
    if model.jnt_type[joint] == BALL:
        return turns
    return slides + turns
