"""What `/robot.json` tells of a robot before anything moves: names, joints, frames, protocols, surroundings."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.api import Robot
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.mechanism import Frame, Joint
from twin.ui.headset.protocol import sevens
from twin.ui.session.desk import Desk
from twin.ui.session.patient import Patient, floor_of, none_there, patient_of


def describe(robot: Robot, desk: Desk, protocols: Mapping[str, str], patients: Mapping[str, Patient]) -> dict[str, Any]:
    """Return the description of a robot; lengths in m, angles in rad, poses as x y z and quaternion x y z w.

    Args:
        robot: as loaded.
        desk: where it stands.
        protocols: what `Robot.protocol` takes, by name.
        patients: of these protocols, see `patients_of`.
    """
    from twin.exchange.write.clip import model_hash

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
        "scenery": _scenery(robot, desk, protocols, patients),
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


def patients_of(robot: Robot, desk: Desk, protocols: Mapping[str, str]) -> dict[str, Patient]:
    """Return the patients of protocols by the protocols' names; a protocol that cannot be read has none here."""
    floor = floor_of(desk.mechanism, desk.assembly.link_poses)
    out = {}
    for name, source in protocols.items():
        with contextlib.suppress(TwinError):  # told when it is asked for
            if (patient := patient_of(robot, robot.protocol(source), floor)) is not None:
                out[name] = patient
    return out


def _scenery(robot: Robot, desk: Desk, protocols: Mapping[str, str], patients: Mapping[str, Patient]) -> dict[str, Any]:
    """Return the floor, and for each protocol its patient with table or why there is none."""
    none = {}
    for name, source in protocols.items():
        with contextlib.suppress(TwinError):
            if name not in patients:
                none[name] = none_there(robot, robot.protocol(source))
    return {
        "floor": floor_of(desk.mechanism, desk.assembly.link_poses),
        "patients": {n: {"replaces": list(p.replaces), "assumed": p.assumed} for n, p in patients.items()},
        "no_patient": none,
    }


def _pose(T: Array) -> list[float]:
    assert spatial.is_pose(T, 1e-6)
    return _numbers(sevens(T))


def _numbers(values: Array) -> list[float]:
    return (np.round(values, 12) + 0.0).tolist()
