"""Worlds with a console: two hands move two arms and a camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import twin
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.model.task import ConsoleTask
from twin.simulation.controllers.camera import CameraDragging, HandsToCamera
from twin.simulation.controllers.jaw import GripToJaw, Jaw
from twin.simulation.controllers.pedals import Pedals
from twin.simulation.controllers.pose_to_joints import PoseToJoints
from twin.simulation.controllers.tool_following import FollowingArm, HandToPose
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.tasks.target.task import KIND, Target, Targets
from twin.simulation.world import Block, Placed, World

T_VIEW_HAND = spatial.pose(spatial.rotation_z(90 * DEG), (0.1, 0, 0))
START = (0.2, 0.1, -0.3)
"""Start position (3,) in m of the right hand in {H}."""


ROBOT = "davinci_psm"


def start(kin):
    """Return joint values from which an arm can move a little in all directions."""
    return kin.inverse(kin.program.pose_of_coordinates.one(np.array(kin.formula.seeds[1], float)))


class Hands(Block):
    """Two hands and the pedals, from a function of the time.

    `script` returns displacements (3,) in m of the right and the left hand, the rotation of both about z in rad,
    clutch, camera and scale. The grippers open and close in the first 0.1 s, which the arms require before they follow.
    """

    def __init__(self, script):
        self.script = script
        self.outputs = {n: np.eye(4).ravel() for n in ("right.pose", "left.pose")}
        self.outputs |= dict.fromkeys(("right.grip", "left.grip", "pedals.clutch", "pedals.camera"), 0.0)
        self.outputs |= {"pedals.scale": 0.5}

    def step(self, signals, t, dt):
        right, left, turn, clutch, camera, scale = self.script(t)
        grip = 50 * DEG * np.sin(np.pi * min(t, 0.1) / 0.1)
        R = spatial.rotation_z(turn)
        return {
            "right.pose": spatial.pose(R, np.add(START, right)).ravel(),
            "left.pose": spatial.pose(R, np.add(START, (-0.3, 0, 0)) + left).ravel(),
            "right.grip": grip,
            "left.grip": grip,
            "pedals.clutch": clutch,
            "pedals.camera": camera,
            "pedals.scale": scale,
        }


def world(device, hazards=(), taps=False):
    """Return a World with the arms `one` and `two`, each moved by a hand.

    With `taps`, the right hand can also select the arm `three` with a tap.
    """
    kin, mechanism = twin.load(ROBOT).kinematics(), twin.load(ROBOT).mechanism
    limits, q = JointLimits.of(mechanism), start(kin)
    places = {n: spatial.pose(None, (x, 0, 0)) for n, x in (("one", 0.5), ("two", -0.5), ("three", 1.5))[: 2 + taps]}
    arms = {n: FollowingArm(n, kin, T) for n, T in places.items()}
    right = [arm for n, arm in arms.items() if n != "two"]
    centre = spatial.pose(spatial.exp_so3(np.array([0.4, 0.2, 0.1])), (0, 0.5, 0.5))
    camera = CameraDragging(np.array([0.05, -0.1, 0.1, 0.2]), 1e-3)
    return World(
        robots=[Placed(n, mechanism, T) for n, T in places.items()],
        devices=[device],
        controllers=[
            Pedals("pedals"),
            HandsToCamera("camera", "right", "left", camera, T_VIEW_HAND, centre),
            HandToPose("right", "pedals", right, [q] * len(right), T_VIEW_HAND, view="camera"),
            HandToPose("left", "pedals", (arms["two"],), (q,), T_VIEW_HAND, view="camera"),
            GripToJaw("right", "one", Jaw(-10 * DEG, 60 * DEG, 0.0, 1e-3)),
            *(PoseToJoints(n, kin, q, limits) for n in arms),
        ],
        plants=[Kinematic(n, q, limits) for n in arms],
        hazards=hazards,
    )


def moving(t):
    """Script of `Hands`: the hands move, press the clutch, drag the camera, and change the scale."""
    way = 5 * MM * np.array([np.sin(8 * t), np.cos(8 * t) - 1, np.sin(5 * t)])
    clutch = 0.35 < t < 0.42
    camera = 0.5 < t < 0.6
    return way, -0.5 * way, 0.1 * np.sin(6 * t), float(clutch), float(camera), 0.5 if t < 0.25 else 0.2


T_VIEW_TOOL = spatial.pose(np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]))
"""Pose (4, 4) of the endoscope arm's tool (z along the line of sight) in the picture's frame, y along the yaw axis."""


def davinci(device):
    """Return a World with two instrument arms and the endoscope arm of the da Vinci, moved by two hands."""
    psm, ecm = twin.load(ROBOT), twin.load("davinci_ecm")
    places = {
        n: spatial.pose(spatial.rotation_z(a), (x, 0, 0)) for n, x, a in (("psm1", 0.1, 0.3), ("psm2", -0.1, -0.3))
    }
    kin, limits, camera = psm.kinematics(), JointLimits.of(psm.mechanism), ecm.kinematics()
    q, arms = start(kin), {n: FollowingArm(n, kin, T) for n, T in places.items()}
    law = CameraDragging(np.array([0.0, 0.0, 0.12, 0.0]), 1e-3)
    hands = HandsToCamera("ecm", "right", "left", law, T_VIEW_HAND, np.eye(4), T_view_tool=T_VIEW_TOOL)
    at = camera.inverse(hands.outputs["ecm.goal"].reshape(4, 4))
    return World(
        robots=[*(Placed(n, psm.mechanism, T) for n, T in places.items()), Placed("ecm", ecm.mechanism)],
        devices=[device],
        controllers=[
            Pedals("pedals"),
            hands,
            HandToPose("right", "pedals", (arms["psm1"],), (q,), T_VIEW_HAND, view="ecm"),
            HandToPose("left", "pedals", (arms["psm2"],), (q,), T_VIEW_HAND, view="ecm"),
            *(GripToJaw(hand, n, Jaw(0.0, 60 * DEG, 0.0, 1e-3)) for hand, n in (("right", "psm1"), ("left", "psm2"))),
            *(PoseToJoints(n, kin, q, limits) for n in arms),
            PoseToJoints("ecm", camera, at, JointLimits.of(ecm.mechanism)),
        ],
        plants=[*(Kinematic(n, q, limits) for n in arms), Kinematic("ecm", at, JointLimits.of(ecm.mechanism))],
    )


def with_near_targets(scene):
    """Return a scene whose only task, "near", takes two seconds: both tips go 5 mm."""
    points = {"right": np.array([14, 44, 914]) * MM, "left": np.array([-14, 44, 914]) * MM}
    goal = Targets((Target("there", points),))
    return replace(scene, tasks={"near": ConsoleTask("near", "5 mm", 1 * MM, 0.1, KIND, goal)})
