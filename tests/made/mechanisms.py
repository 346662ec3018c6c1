"""Small closed-loop mechanisms with an exact closed form.

`four_bar`: a planar crank-rocker, tilted in space, so that exchanged axes and wrong orders cause errors; a revolute
joint outside the tree closes its loop. `slider`: a chain with a prismatic, a spherical, a cylindrical and a fixed
joint.
"""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.provenance import Parameter
from twin.core.units import DEG, MM
from twin.model.body import Body, Frame, Mesh, Point
from twin.model.inertia import Inertia
from twin.model.joint import Drive, Joint
from twin.model.mechanism import Mechanism

GROUND, CRANK, COUPLER, ROCKER = 0.3, 0.1, 0.28, 0.22
"""Lengths in m; crank + ground < coupler + rocker, so the crank turns fully."""


CRANK_AT_REST = 70 * DEG


T_TILT = spatial.pose(spatial.exp_so3([0.3, -0.2, 0.5]), [0.05, -0.02, 0.4])
"""T_base_plane (4, 4): pose of the plane of the four-bar linkage in base."""


H = spatial.pose(np.diag([1.0, -1.0, -1.0]))


def box(name: str, center, size, color=(0.7, 0.2, 0.1, 1.0)) -> Mesh:
    """Return the closed mesh of a box with centre and edge lengths in m; its triangles are oriented outwards."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])]
    return Mesh(name, corners * size + center, np.array(triangles, np.int32), color)


def solid(mass: float, center, size, R=None) -> Inertia:
    """Return the inertia of a solid box: mass in kg, centre and edge lengths in m, rotation R of the box."""
    x, y, z = np.asarray(size, float) ** 2
    R = np.eye(3) if R is None else R
    return Inertia(mass, np.asarray(center, float), R @ np.diag(mass / 12 * np.array([y + z, x + z, x + y])) @ R.T)


def bar(name: str, length: float, color) -> Body:
    """Return a link: a bar of a length in m along x from its own origin."""
    center, size = [length / 2, 0, 0], [length + 0.02, 0.02, 0.01]
    return Body(name, (box(f"{name}_visual", center, size, color),), solid(0.2, center, size))


def four_bar_angles(crank: float) -> tuple[float, float]:
    """Return the angles (coupler, rocker) in rad from the x axis of the plane, for the angle of the crank from x."""
    pin = CRANK * np.array([np.cos(crank), np.sin(crank)])
    to = np.array([GROUND, 0.0]) - pin
    d = np.hypot(*to)
    along = (d**2 + COUPLER**2 - ROCKER**2) / (2 * d)
    up = np.sqrt(COUPLER**2 - along**2)
    meet = pin + (along * to + up * np.array([-to[1], to[0]])) / d
    coupler = np.arctan2(*(meet - pin)[::-1])
    rocker = np.arctan2(*(meet - [GROUND, 0.0])[::-1])
    return float(coupler), float(rocker)


def four_bar_state(crank: float):
    """Return (link_poses, q_full) for the angle in rad of the crank from the x axis of the plane."""
    coupler, rocker = four_bar_angles(crank)
    pin = [CRANK * np.cos(crank), CRANK * np.sin(crank), 0]

    def at(p, angle):
        return T_TILT @ spatial.pose(spatial.rotation_z(angle), p)

    poses = {
        "base": np.eye(4),
        "crank": at([0, 0, 0], crank),
        "coupler": at(pin, coupler),
        "rocker": at([GROUND, 0, 0], rocker),
    }
    q = {
        "crank_joint": crank,
        "elbow": coupler - crank,
        "rocker_joint": rocker,
        "closing": coupler - rocker,
    }
    return poses, q


def four_bar(**changes) -> Mechanism:
    """Return the crank-rocker; keyword arguments replace fields."""
    rest, _ = four_bar_state(CRANK_AT_REST)

    def revolute(name, parent, child, T_parent, T_child=None, **more):
        return Joint(name, "revolute", parent, child, T_parent, np.eye(4) if T_child is None else T_child, **more)

    ground = Body(
        "base",
        (box("base_visual", [0, 0, 0.2], [0.1, 0.12, 0.4], (0.2, 0.2, 0.25, 1.0)),),
        solid(3.0, [0, 0, 0.2], [0.1, 0.12, 0.4], spatial.exp_so3([0.1, 0.2, 0.3])),
    )
    fields = {
        "name": "bars",
        "base": "base",
        "bodies": (
            ground,
            bar("crank", CRANK, (0.8, 0.1, 0.1, 1.0)),
            bar("coupler", COUPLER, (0.1, 0.8, 0.1, 1.0)),
            bar("rocker", ROCKER, (0.1, 0.1, 0.8, 0.5)),
        ),
        "joints": (
            revolute(
                "crank_joint",
                "base",
                "crank",
                T_TILT,
                active=True,
                limits=(-170 * DEG, 175 * DEG),
                soft_limits=(-160 * DEG, 160 * DEG),
                max_speed=90 * DEG,
                max_acceleration=3.0,
                max_jerk=40.0,
                drive=Drive(200.0, 20.0, 15.0),
                mating=("base_visual", "crank_visual"),
            ),
            revolute("elbow", "crank", "coupler", spatial.pose(p=[CRANK, 0, 0]), limits=(-np.pi, np.pi)),
            revolute("rocker_joint", "base", "rocker", T_TILT @ spatial.pose(p=[GROUND, 0, 0])),
            revolute(
                "closing",
                "rocker",
                "coupler",
                spatial.pose(p=[ROCKER, 0, 0]),
                spatial.pose(p=[COUPLER, 0, 0]),
            ),
        ),
        "frames": (Frame("tool", "coupler", spatial.pose(spatial.exp_so3([1, 2, 0.3]), [COUPLER / 3, 0.01, 0.02])),),
        "points": (
            Point("marker", "rocker", np.array([1 / 3, 0.01, 1 / 7])),
            Point("tool", "base", np.ones(3)),
        ),
        "rest": rest,
        "postures": {"home": {"crank_joint": CRANK_AT_REST}, "park": {"crank_joint": 0.1}},
        "tool": "tool",
        "parameters": (
            Parameter("zeta", 0.3, "mm", 300.0, "ASSUMED", "first in order, last by name"),
            Parameter("alpha", 1.0, "deg", 57.3, "PUBLISHED", "table 1"),
        ),
        "source": "/home/someone/bars.toml",
    }
    return Mechanism(**{**fields, **changes})


def slider_state(stroke: float, turn: float, tilt=(0.1, -0.2, 0.3)):
    """Return (link_poses, q_full) of `slider` at a stroke in m.

    The cylindrical joint is rotated by `turn` in rad and displaced by 0.02 m/rad times `turn`; `tilt` (3,) is the
    rotation vector of the spherical joint in rad.
    """
    T_cart = T_TILT @ spatial.pose(p=[0, 0, stroke])
    T_ball = T_cart @ spatial.pose(p=[0.1, 0, 0]) @ spatial.pose(spatial.exp_so3(tilt))
    T_rod = T_ball @ spatial.pose(p=[0.05, 0, 0]) @ spatial.pose(spatial.rotation_z(turn), [0, 0, 0.02 * turn])
    poses = {"base": np.eye(4), "cart": T_cart, "ball": T_ball, "rod": T_rod, "plate": T_rod}
    return poses, {"slide": stroke}


def slider() -> Mechanism:
    """Return a mechanism with a prismatic, a spherical, a cylindrical and a fixed joint."""
    small = [0.03, 0.03, 0.03]
    return Mechanism(
        name="slider",
        base="base",
        bodies=tuple(
            Body(n, (box(f"{n}_visual", [0, 0, 0], small),), solid(0.1, [0, 0, 0], small))
            for n in ("base", "cart", "ball", "rod", "plate")
        ),
        joints=(
            Joint(
                "slide",
                "prismatic",
                "base",
                "cart",
                T_TILT,
                active=True,
                limits=(-80 * MM, 90 * MM),
                max_speed=0.05,
                max_acceleration=0.4,
                max_jerk=6.0,
                drive=Drive(5e3, 300.0, 80.0),
            ),
            Joint("ball_joint", "spherical", "cart", "ball", spatial.pose(p=[0.1, 0, 0]), cone=35 * DEG),
            # parent and child are exchanged: the tree must reverse this joint
            Joint("sleeve", "cylindrical", "rod", "ball", H, spatial.pose(p=[0.05, 0, 0]) @ H),
            Joint("weld", "fixed", "rod", "plate"),
        ),
        frames=(Frame("tool", "plate", np.eye(4)),),
        rest=slider_state(30 * MM, 0.7)[0],
        postures={"home": {"slide": 0.0}},
    )


def gaps(mechanism: Mechanism, poses) -> dict[str, float]:
    """Return the gap of each joint at body poses: the largest entry of the relative pose in a locked direction."""
    out = {}
    for joint in mechanism.joints:
        A = joint.relative(poses[joint.parent], poses[joint.child])
        locked = [A[0, 3], A[1, 3]] if joint.type in ("cylindrical", "prismatic") else list(A[:3, 3])
        if joint.type != "spherical":
            locked += [A[0, 2], A[1, 2], A[2, 2] - 1]
        out[joint.name] = float(np.max(np.abs(locked)))
    return out
