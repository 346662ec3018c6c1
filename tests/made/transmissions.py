"""A small arm with a transmission: a directly driven lift, and three joints that three motors drive by cables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from made.mechanisms import box, solid
from twin.core import spatial
from twin.model.body import Body, Frame
from twin.model.joint import Drive, Joint
from twin.model.mechanism import Mechanism
from twin.model.transmission import Actuator, Transmission

MATRIX = np.array([[0.05, 0.0, 0.0], [-0.02, 0.04, 0.0], [0.01, -0.015, 0.03]])
"""Joint angles per motor angle (3, 3), in rad/rad: the cables of outer joints run over the inner joints."""

ALONG_Y = spatial.pose(spatial.frame_from_axes([0, 1, 0], [1, 0, 0]))
"""Pose (4, 4) of a joint frame whose z axis is the y axis of its body."""

MOTORS = tuple(
    Actuator(f"m{i + 1}", "angle", (-60.0, 80.0 + i), 10.0 + i, 0.2 + i / 10, 1e-5 * (i + 1), 2.0 + i, 0.02)
    for i in range(3)
)


SCREW = Actuator("screw", "angle", (-300.0, 320.0), 80.0, 0.1, 4e-6, 0.3, 0.004)


def raven(matrix=MATRIX) -> Mechanism:
    """Return the arm: a lift along z, a revolute joint about z, and two about y; cables drive the revolute joints."""
    size = (0.02, 0.02, 0.2)
    bodies = tuple(
        Body(n, (box(f"{n}_box", (0, 0, 0.1), size),), solid(0.3, (0, 0, 0.1), size))
        for n in ("base", "post", "shoulder", "upper", "fore")
    )
    up = spatial.pose(p=[0, 0, 0.2])
    joints = (
        Joint("lift", "prismatic", "base", "post", up, active=True, limits=(-0.1, 0.1), drive=Drive(2e4, 400.0, 300.0)),
        Joint("q1", "revolute", "post", "shoulder", up, active=True, limits=(-2.0, 2.5)),
        Joint("q2", "revolute", "shoulder", "upper", up @ ALONG_Y, ALONG_Y, active=True, limits=(-1.5, 1.5)),
        Joint("q3", "revolute", "upper", "fore", up @ ALONG_Y, ALONG_Y, active=True, limits=(-2.0, 2.0)),
    )
    rest = {b.name: spatial.pose(p=[0, 0, 0.2 * i]) for i, b in enumerate(bodies)}
    names = tuple(a.name for a in MOTORS)
    return Mechanism(
        "raven",
        "base",
        bodies,
        joints,
        (Frame("tool", "fore", up),),
        rest=rest,
        postures={"home": dict.fromkeys(("lift", "q1", "q2", "q3"), 0.0)},
        actuators=MOTORS,
        transmissions=(Transmission("cables", ("q1", "q2", "q3"), names, np.asarray(matrix, float)),),
        source="raven",
    )


def screwed() -> Mechanism:
    """Return the arm with a lead screw (2 mm per turn) that moves the lift: an angle is converted to a length."""
    m = raven()
    return replace(
        m,
        joints=(replace(m.joints[0], drive=None), *m.joints[1:]),
        actuators=(SCREW, *m.actuators),
        transmissions=(
            Transmission("spindle", ("lift",), ("screw",), np.array([[0.002 / (2 * np.pi)]])),
            *m.transmissions,
        ),
    )
