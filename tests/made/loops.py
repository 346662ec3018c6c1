"""Small mechanisms with loops of every kind."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

ALONG_X = spatial.pose(spatial.frame_from_axes([1, 0, 0], [0, 0, -1]))
"""Pose (4, 4) of a joint frame whose z axis is the x axis of its body."""


def mechanism(*joints, tool, T_tool=None, rest=None, **more):
    bodies = dict.fromkeys(["base", *(b for j in joints for b in (j.parent, j.child))])
    return Mechanism(
        name="m",
        base="base",
        bodies=tuple(Body(b) for b in bodies),
        joints=joints,
        frames=(Frame("tool", tool, np.eye(4) if T_tool is None else T_tool),),
        rest=rest or {},
        **more,
    )


def slider_crank(closure):
    """Return a crank (0.1 m) about z, a coupler (0.3 m) and a block on the x axis; the block's guide closes the loop.

    `closure` is the type of the guide.
    """
    joints = (
        Joint("crank_joint", "revolute", "base", "crank", active=True),
        Joint("knee", "revolute", "crank", "coupler", spatial.pose(p=[0.1, 0, 0])),
        Joint("wrist", "revolute", "coupler", "block", spatial.pose(p=[0.3, 0, 0])),
        Joint("guide", closure, "base", "block", ALONG_X, ALONG_X),
    )
    rest = {"base": np.eye(4), "crank": np.eye(4), "coupler": spatial.pose(p=[0.1, 0, 0])}
    return mechanism(*joints, tool="block", rest={**rest, "block": spatial.pose(p=[0.4, 0, 0])})


ROD = 0.5


def rod(active="lift"):
    """Return a rod between two ball joints, on carriages on the z axis ("lift") and on the x axis ("push").

    `active` is the driven carriage.
    """
    joints = (
        Joint("lift", "prismatic", "base", "upper", active=active == "lift"),
        Joint("push", "prismatic", "base", "lower", ALONG_X, ALONG_X, active=active == "push"),
        Joint("top", "spherical", "upper", "rod"),
        Joint("foot", "spherical", "rod", "lower", spatial.pose(p=[0, 0, ROD])),
    )
    z, x = 0.3, 0.4
    T_rod = spatial.pose(spatial.frame_from_axes([x, 0, -z], [0, 1, 0]), [0, 0, z])
    rest = {"base": np.eye(4), "upper": spatial.pose(p=[0, 0, z]), "lower": spatial.pose(p=[x, 0, 0]), "rod": T_rod}
    return mechanism(*joints, tool="lower", rest=rest)


def two_links(*couplings, **more):
    """Return two links (0.3 m, 0.2 m) and a hand, all about z; a coupling can keep the hand's direction."""
    joints = (
        Joint("a", "revolute", "base", "upper", active=True),
        Joint("b", "revolute", "upper", "fore", spatial.pose(p=[0.3, 0, 0]), active=True),
        Joint("c", "revolute", "fore", "hand", spatial.pose(p=[0.2, 0, 0])),
    )
    return mechanism(*joints, tool="hand", couplings=couplings, **more)


def through_a_trocar():
    """Return a shaft on a ball joint at the end of a slide; the shaft passes through a tube that pivots in the base."""
    joints = (
        Joint("x", "prismatic", "base", "slide", ALONG_X, ALONG_X, active=True),
        Joint("ball", "spherical", "slide", "shaft", spatial.pose(p=[0, 0, 0.5])),
        Joint("port", "spherical", "base", "tube", spatial.pose(p=[0, 0, 0.3])),
        Joint("through", "prismatic", "tube", "shaft"),
    )
    return mechanism(*joints, tool="shaft", T_tool=spatial.pose(p=[0, 0, -0.4]), trocars=("port",))
