"""The World's blocks of a console with one hand, which moves its robot by tool rates while a pedal is pressed."""

from __future__ import annotations

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.model.console import CameraTable, ConsoleTable, TeleoperationTable
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.simulation.controllers.camera import FixedCamera
from twin.simulation.controllers.jacobian_step import ToolToJoints
from twin.simulation.controllers.pen_handle import PedalFollowing, PenToHandle
from twin.simulation.controllers.teleoperation import Gains, HandToTool, Teleoperation, scales_of
from twin.simulation.limits import JointLimits
from twin.simulation.setup import Setup
from twin.simulation.trial import INNER
from twin.simulation.world import Block
from twin.simulation.world.signal_kinds import DEVICE_SCALE, HAND_HANDLE, PEDALS

HAND = "right"
"""The hand of such a console."""


def law_of(table: TeleoperationTable, kin: Kinematics, scale: float, dt: float) -> Teleoperation:
    """Return the law of a console with the motion scale `scale`, for ticks of the World of dt in s."""
    gains = Gains(scale=scales_of(kin, scale), kp=table.kp_per_s, ki=table.ki_per_s2, kd=table.kd)
    return Teleoperation(gains, INNER * dt, table.clutch, len(kin.formula.coordinates.units))


def controllers(setup: Setup, table: ConsoleTable, device: Block, q: Array, dt: float) -> list[Block]:
    """Return the controllers that move the console's robot.

    Args:
        setup: scene and robots.
        table: the console, with `teleoperation`.
        device: the input device. If it writes no `<hand>.handle`, its pose of the hand is converted.
        q: (n,) joint values of the robot at the start.
        dt: duration of a tick in s.

    Raises:
        TwinError: the camera is not on the base of its robot.
    """
    assert table.teleoperation is not None, "the caller has checked it"
    name = table.right[0]
    place = setup.places[name]
    member = setup.members[name]
    kin = member.kin
    T_world_view = fixed_view(setup, table)
    law = law_of(table.teleoperation, kin, table.scale, dt)
    blocks: list[Block] = [FixedCamera(setup.scene.cameras[table.camera].robot, T_world_view)]
    if HAND_HANDLE.of(HAND) not in device.outputs:
        R_base_hand = place.T_world_base[:3, :3].T @ T_world_view[:3, :3]
        blocks.append(PenToHandle(HAND, PEDALS, kin, q, R_base_hand, law.dt))
    limits = JointLimits.of(member.mechanism)
    blocks.append(HandToTool(name, HAND, kin, q, law, DEVICE_SCALE.of(PEDALS)))
    blocks.append(PedalFollowing(name, HAND, kin, q, law))
    blocks.append(ToolToJoints(name, kin, q, limits, INNER))
    return blocks


def fixed_view(setup: Setup, table: ConsoleTable) -> Array:
    """Return the pose (4, 4), in the World, of the picture of a camera that does not move.

    Raises:
        TwinError: the camera is not on the base of its robot.
    """
    camera = setup.scene.cameras[table.camera]
    mechanism = setup.members[camera.robot].mechanism
    _require_fixed(setup.scene, table.camera, camera, mechanism)
    T_base_frame = mechanism.frame(camera.frame).T_body_frame
    return setup.places[camera.robot].T_world_base @ T_base_frame @ camera.in_frame @ PICTURE


def _require_fixed(scene: Scene, name: str, camera: CameraTable, mechanism: Mechanism) -> None:
    body = mechanism.frame(camera.frame).body
    if body != mechanism.base:
        raise TwinError(
            f"{scene.file}: camera '{name}' is on {body}; the camera of a console with teleoperation does not move: "
            f"give a frame on {mechanism.base}, the base of {camera.robot}"
        )


PICTURE = np.diag([1.0, -1.0, -1.0, 1.0])
"""Pose (4, 4) of a picture's frame (y up, z out of it) in its camera's frame (z along the view, y down).

It is a rotation: the two frames have one origin.
"""
