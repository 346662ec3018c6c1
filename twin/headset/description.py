"""What `/robot.json` tells of a robot before anything moves: names, joints, frames, protocols, surroundings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin import spatial
from twin.api import Robot
from twin.errors import TwinError
from twin.headset.protocol import sevens
from twin.live.desk import Desk
from twin.mechanism import Frame, Joint, Mechanism
from twin.spatial import Array


def describe(robot: Robot, desk: Desk, protocols: Mapping[str, str]) -> dict[str, Any]:
    """Return the description of a robot; lengths in m, angles in rad, poses as x y z and quaternion x y z w.

    Args:
        robot: as loaded.
        desk: where it stands.
        protocols: what `Robot.protocol` takes, by name.
    """
    from twin.exporting.clip import model_hash

    m = desk.mechanism
    tool = m.frame(m.tool)
    default = "" if robot.files is None else robot.cad.description.default_protocol
    order = [j.name for j in m.active]
    return {
        "schema": "twin-robot",
        "version": 1,
        "name": robot.name,
        "title": "" if robot.files is None else robot.cad.description.title,
        "model_hash": model_hash(robot.mechanism),
        "frame": "z-up right-handed",
        "base": m.base,
        "links": [b.name for b in m.bodies],
        "joints": [_joint(j, order) for j in m.joints],
        "tool": {"link": tool.body, "T_link_tool": _pose(tool.T_body_frame)},
        "frames": [_frame(f) for f in m.frames],
        "points": [{"name": p.name, "link": p.body, "point": _numbers(p.p_body)} for p in m.points],
        "protocols": [{"name": n, "title": _title(robot, p), "is_default": n == default} for n, p in protocols.items()],
        "postures": list(desk.postures),
        "variants": _variants(desk),
        "has_equations": desk.kin is not None,
        "has_workspace": desk.kin is not None and desk.kin.closed_inverse,
        "scenery": _scenery(desk),
        "assumed": [f"{p.name}: {p.note}" for p in m.parameters if p.provenance == "ASSUMED"],
        "T_world_base": _pose(np.eye(4)),
    }


def _joint(j: Joint, order: list[str]) -> dict[str, Any]:
    unit = {"revolute": "rad", "prismatic": "m"}.get(j.type)
    low, high = j.limits or (None, None)
    return {
        "name": j.name,
        "type": j.type,
        "unit": unit,
        "lower": low,
        "upper": high,
        "active": j.active,
        "index": order.index(j.name) if j.active else None,
        "parent": j.parent,
        "link": j.child,
        "axis": {"origin": _numbers(j.T_parent_joint[:3, 3]), "direction": _numbers(j.T_parent_joint[:3, 2])},
    }


def _frame(f: Frame) -> dict[str, Any]:
    return {"name": f.name, "link": f.body, "T_link_frame": _pose(f.T_body_frame)}


def _title(robot: Robot, protocol: str) -> str:
    try:
        return robot.protocol(protocol).title
    except TwinError:  # a file that is wrong is told when it is asked for
        return protocol


def _variants(desk: Desk) -> list[str]:
    """Return what `variant` takes: every equation in each variant that is not its own, and names of them all."""
    if desk.kin is None:
        return []
    own = desk.kin.variants
    single = [f"{e}={v}" for e, vs in desk.kin.choices.items() for v in vs if v != own[e]]
    return list(dict.fromkeys([*(s.partition("=")[2] for s in single), *single]))


def _scenery(desk: Desk) -> dict[str, Any]:
    """Return floor, table and patient, for scale; offsets are from the RCM, or from the tip where there is none."""
    m = desk.mechanism
    at = m.trocar_at if m.trocar else desk.shaft()[0]
    return {
        "assumed": "table and abdomen of 320 x 480 mm are ASSUMED, for scale",
        "at": _numbers(at),
        "floor": _floor(m, desk.assembly.link_poses),
        "patient": {"shape": "half_ellipsoid", "radii": [0.16, 0.24, 0.203], "offset": [0.0, 0.0, -0.203]},
        "table": {"shape": "box", "size": [0.42, 0.66, 0.03], "offset": [0.0, 0.0, -0.218]},
    }


def _floor(m: Mechanism, poses: dict[str, Array]) -> float:
    """Return the height of the lowest point of the robot as it stands, in m."""
    heights = [
        float((v.vertices @ poses[b.name][2, :3]).min() + poses[b.name][2, 3])
        for b in m.bodies
        for v in b.meshes
        if len(v.vertices)
    ]
    return round(min(heights, default=0.0), 6)


def _pose(T: Array) -> list[float]:
    assert spatial.is_pose(T, 1e-6)
    return _numbers(sevens(T))


def _numbers(values: Array) -> list[float]:
    return (np.round(values, 12) + 0.0).tolist()
