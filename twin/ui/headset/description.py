"""Content of the file `/robot.json`: names, joints, frames, protocols, surroundings."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from twin.api import Robot
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.model.body import Frame
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.model.scene import Place
from twin.ui.headset.stream_frames import sevens
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.patient import Patient, floor_of, none_there, patient_of
from twin.ui.session.readings import LIVE_TOLERANCE


def describe(
    robot: Robot,
    movable: MovableRobot,
    protocols: Mapping[str, str],
    patients: Mapping[str, Patient],
    place: Place | None = None,
) -> JsonObject:
    """Return the content of robot.json; lengths in m, angles in rad, poses as x y z and quaternion x y z w.

    Args:
        robot: the robot.
        movable: state of the robot.
        protocols: arguments of `Robot.protocol`, by protocol name.
        patients: patients by protocol name, from `patients_of`.
        place: place of the robot in a scene; None: a single robot, whose description contains floor and patients.
    """
    from twin.exchange.write.model_hash import model_hash

    mechanism = movable.mechanism
    tool = mechanism.frame(mechanism.tool)
    title = ""
    default = ""
    if robot.files is not None:
        title = robot.cad.description.title
        default = robot.cad.description.default_protocol
    name = robot.name
    T_world_base = np.eye(4)
    scenery = None
    if place is None:
        scenery = _scenery(robot, movable, protocols, patients)
    else:
        default = place.protocol_name
        name = place.name
        T_world_base = place.T_world_base
    order = [j.name for j in mechanism.active]
    return {
        "schema": "twin-robot",
        "version": 1,
        "name": name,
        "title": title,
        "model_hash": model_hash(robot.mechanism),
        "frame": "z-up right-handed",
        "base": mechanism.base,
        "links": [b.name for b in mechanism.bodies],
        "joints": [_joint(j, order) for j in mechanism.joints],
        "tool": {"link": tool.body, "T_link_tool": pose(tool.T_body_frame)},
        "frames": [_frame(f) for f in mechanism.frames],
        "points": _points(mechanism),
        "protocols": _protocols(robot, protocols, default),
        "postures": list(movable.postures),
        "variants": _variants(movable),
        "has_equations": movable.kin is not None,
        "live_tolerance": LIVE_TOLERANCE,
        "has_workspace": movable.kin is not None and movable.kin.closed_inverse,
        "scenery": scenery,
        "assumed": assumptions([*_equations(movable), *mechanism.parameters]),
        "T_world_base": pose(T_world_base),
    }


def _equations(movable: MovableRobot) -> Sequence[Parameter]:
    """Return the parameters of the equations; none without equations."""
    return () if movable.kin is None else movable.kin.formula.parameters


def assumptions(parameters: Iterable[Parameter]) -> list[str]:
    """Return a text "name: note" for each assumed parameter."""
    texts = []
    for parameter in parameters:
        if parameter.provenance == "ASSUMED":
            texts.append(f"{parameter.name}: {parameter.note}")
    return texts


def _points(m: Mechanism) -> list[JsonObject]:
    entries = []
    for point in m.points:
        entries.append({"name": point.name, "link": point.body, "point": numbers(point.p_body)})
    return entries


def _protocols(robot: Robot, protocols: Mapping[str, str], default: str) -> list[JsonObject]:
    entries = []
    for name, source in protocols.items():
        entries.append({"name": name, "title": _title(robot, source), "is_default": name == default})
    return entries


def _joint(joint: Joint, order: list[str]) -> JsonObject:
    unit = {"revolute": "rad", "prismatic": "m"}.get(joint.type)
    low, high = joint.limits or (None, None)
    return {
        "name": joint.name,
        "type": joint.type,
        "unit": unit,
        "lower": low,
        "upper": high,
        "active": joint.active,
        "index": order.index(joint.name) if joint.active else None,
        "parent": joint.parent,
        "link": joint.child,
        "axis": {"origin": numbers(joint.T_parent_joint[:3, 3]), "direction": numbers(joint.T_parent_joint[:3, 2])},
    }


def _frame(f: Frame) -> JsonObject:
    return {"name": f.name, "link": f.body, "T_link_frame": pose(f.T_body_frame)}


def _title(robot: Robot, protocol: str) -> str:
    try:
        return robot.protocol(protocol).title
    except TwinError:  # an invalid protocol is reported when a client requests it
        return protocol


def _variants(movable: MovableRobot) -> list[str]:
    """Return the values that the message `variant` accepts: for each variant not in use, "name" and "equation=name"."""
    if movable.kin is None:
        return []
    names: list[str] = []
    full_names = []
    for equation, choices in movable.kin.choices.items():
        for name in choices:
            if name == movable.kin.variants[equation]:
                continue
            full_names.append(f"{equation}={name}")
            # several equations may have a variant of the same name
            if name not in names:
                names.append(name)
    return names + full_names


def patients_of(robot: Robot, movable: MovableRobot, protocols: Mapping[str, str]) -> dict[str, Patient]:
    """Return the patients by protocol name; invalid protocols and protocols without a patient are omitted.

    `protocols` contains the argument of `Robot.protocol` for each protocol, by protocol name.
    """
    floor = floor_of(movable.mechanism, movable.assembly.link_poses)
    patients = {}
    for name, source in protocols.items():
        with contextlib.suppress(TwinError):  # reported when a client requests the protocol
            patient = patient_of(robot, robot.protocol(source), floor)
            if patient is not None:
                patients[name] = patient
    return patients


def _scenery(
    robot: Robot, movable: MovableRobot, protocols: Mapping[str, str], patients: Mapping[str, Patient]
) -> JsonObject:
    """Return the floor's height in m and, for each protocol, its patient or the reason why it has no patient."""
    reasons = {}
    for name, source in protocols.items():
        with contextlib.suppress(TwinError):
            if name not in patients:
                reasons[name] = none_there(robot, robot.protocol(source))
    entries = {}
    for name, patient in patients.items():
        entries[name] = {"replaces": list(patient.replaces), "assumed": patient.assumed}
    return {
        "floor": floor_of(movable.mechanism, movable.assembly.link_poses),
        "patients": entries,
        "no_patient": reasons,
    }


def pose(T: Array) -> list[float]:
    """Return a pose (4, 4) as seven numbers: x y z in m, quaternion x y z w."""
    assert spatial.is_pose(T, 1e-6)
    return numbers(sevens(T))


def numbers(values: Array) -> list[float]:
    """Return numbers as a list for JSON, rounded so that the file does not depend on the processor."""
    return (np.round(values, 12) + 0.0).tolist()
