"""Convert the expected mechanism to the common form of mechanism data, for comparison with files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_drives import FileDrive, FileMotor, JointDynamics, drive_of_motors
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.mechanism_data import VACUUM, FileFrame, FileMass, FileMechanism
from twin.exchange.audit.motion_lines import motion_lines

if TYPE_CHECKING:
    from twin.model.mechanism import Mechanism


def mechanism_truth(mechanism: Mechanism) -> FileMechanism:
    """Return a mechanism in the common form of mechanism data; its loops need not be closed."""
    masses = {}
    shown = {}
    links = []
    for body in mechanism.bodies:
        links.append(body.name)
        if body.inertia:
            masses[body.name] = FileMass(body.inertia.mass, body.inertia.p_body_com, body.inertia.I_com)
        if body.whole:  # else its meshes show only a part of the body
            shown[body.name] = bool(body.meshes)
    couplings = {}
    for coupling in mechanism.couplings:
        ratios = dict(zip(coupling.joints, coupling.ratios, strict=True))
        couplings[coupling.name] = (ratios, coupling.total)
    points = {}
    for point in mechanism.points:
        points[point.name] = FileFrame(point.body, poses.pose(None, point.p_body))
    frames = {}
    for frame in mechanism.frames:
        frames[frame.name] = FileFrame(frame.body, frame.T_body_frame)
    motors = _motors(mechanism)
    collides = {}
    for link, has_mesh in shown.items():
        if has_mesh:
            collides[link] = True  # every exported mesh does
    return FileMechanism(
        tuple(links),
        masses,
        shown=shown,
        collides=collides,
        joints=_joints(mechanism, motors),
        frames=frames,
        points=points,
        fully_listed=frozenset({"frame", "point"}),
        gravity=np.array(mechanism.gravity),
        medium=VACUUM,
        fixed_to_world=frozenset({mechanism.base}),
        tool=mechanism.tool,
        trocars=frozenset(mechanism.trocars),
        couplings=couplings,
        motors=motors,
        all_motors=True,
        opening=0.0,
        robot=mechanism.name,
        postures=mechanism.postures,
        motion_declarations={},
        program_settings={},
        weight_shares=dict.fromkeys(links, 0.0),
        complete=True,
    )


def _motors(mechanism: Mechanism) -> dict[str, FileMotor]:
    """Return the actuators with the joint factors of their transmissions, which are in general coupled."""
    rows = {}
    for transmission in mechanism.transmissions:
        # q = M m for joints q and motors m; a row of the inverse gives a motor's coordinate.
        for name, factors in zip(transmission.actuators, np.linalg.inv(transmission.matrix), strict=True):
            row = {}
            for joint, factor in zip(transmission.joints, factors, strict=True):
                if factor:
                    row[joint] = float(factor)
            rows[name] = row
    motors = {}
    for actuator in mechanism.actuators:
        motors[actuator.name] = FileMotor(
            rows[actuator.name],
            actuator.kind,
            actuator.limits or (-np.inf, np.inf),
            actuator.max_effort or np.inf,
            actuator.max_speed or np.inf,
            actuator.rotor_inertia or 0.0,
            actuator.stiffness or 0.0,
            actuator.damping,
            "force",
        )
    return motors


def _joints(mechanism: Mechanism, motors: Mapping[str, FileMotor]) -> list[FileJoint]:
    joints = []
    for joint in mechanism.joints:
        T = joint.T_parent_joint @ poses.inverse(joint.T_child_joint)
        motions = motion_lines(joint.type, joint.T_parent_joint)
        drive = _drive(mechanism, joint.name, motors)
        joints.append(FileJoint((joint.name,), joint.parent, joint.child, T, motions, drive))
    return joints


def _drive(mechanism: Mechanism, name: str, motors: Mapping[str, FileMotor]) -> FileDrive:
    """Return the drive at a joint: its own, or that of the motors behind a transmission, felt at the joint."""
    joint = mechanism.joint(name)
    if joint.type == "spherical":
        if joint.cone is None:
            return FileDrive(cone=(np.inf, np.inf))
        return FileDrive(cone=(joint.cone, joint.cone), cone_axis=joint.T_parent_joint[:3, 2])
    if joint.type not in ("revolute", "prismatic"):
        return FileDrive()
    stiffness = None
    damping = None
    effort = None
    if joint.drive is not None:
        stiffness = joint.drive.stiffness
        damping = joint.drive.damping
        effort = joint.drive.max_effort
    by_motors = drive_of_motors(motors, joint.name)
    if by_motors is not None:
        stiffness, damping = by_motors
        effort = None
    return FileDrive(
        joint.limits or (-np.inf, np.inf),
        joint.active,
        stiffness,
        damping,
        effort,
        joint.max_speed,
        JointDynamics(),
        "force",
        np.inf,
        soft=joint.soft_limits or joint.limits or (-np.inf, np.inf),
        control=joint.limits or (-np.inf, np.inf),
        acceleration=joint.max_acceleration,
        jerk=joint.max_jerk,
    )
