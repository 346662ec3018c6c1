"""Write a mechanism as the text of a robot's description, in TOML.

All frames are written as numbers, relative to the base frame, at the rest pose with closed loops. Lengths are printed
with all digits of a double, so that writing does not enlarge the gaps of the loops.
"""

from __future__ import annotations

from collections.abc import Mapping, Set

import numpy as np

from twin.core import spatial
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.toml_text import one_line, rows, table, toml
from twin.core.units import DEG, MM, display_unit
from twin.exchange.read.assumed_drives import NOTE
from twin.exchange.read.mesh_output import mesh_file
from twin.model.body import Body
from twin.model.joint import Joint
from twin.model.mechanism import EARTH, Mechanism
from twin.model.transmission import Actuator

NOTES = "IMPORT.md"
"""Name of the file that lists changed, guessed, missing and omitted data."""


def describe(
    mechanism: Mechanism, source: str, assumed: Set[str] = frozenset(), unlimited: Set[str] = frozenset()
) -> str:
    """Return a mechanism's description in TOML.

    `assumed` names the joints and actuators whose drives are ASSUMED, `unlimited` the joints that have no limits.
    """
    cited = {"provenance": "CITED", "note": source}
    head: JsonObject = {
        "name": mechanism.name,
        "title": mechanism.name,
        "source": source,
        "default_protocol": "first",
        "base": mechanism.base,
    }
    head["tool"] = mechanism.tool
    # A description has one key for one trocar, and another one for several.
    if len(mechanism.trocars) == 1:
        head["trocar"] = mechanism.trocars[0]
    elif mechanism.trocars:
        head["trocars"] = mechanism.trocars
    if mechanism.gravity != EARTH:
        head["gravity_m_s2"] = mechanism.gravity
    lines = [
        f"# {mechanism.name}, made by `twin new` from {one_line(source)}; omitted and guessed data are listed in "
        f"../{NOTES}.",
        "# All frames are in the base frame at the rest pose, with loops closed.",
        *rows(head),
        *TOLERANCE,
    ]
    for body in mechanism.bodies:
        lines += _body(mechanism, body, cited)
    for joint in mechanism.joints:
        lines += _joint(mechanism, joint)
    for joint in mechanism.joints:
        lines += _limits(joint, cited, unlimited=joint.name in unlimited)
        drive = joint.drive
        if drive is not None:
            gains = {"stiffness": drive.stiffness, "damping": drive.damping, "max_effort": drive.max_effort}
            provenance = _ASSUMED_GAINS if joint.name in assumed else cited
            lines += table("[[drive]]", joints=[joint.name], **gains, **provenance)
    for coupling in mechanism.couplings:
        unit, scale = display_unit(mechanism.joint(coupling.joints[0]).is_angle)
        total = {f"sum_{unit}": coupling.total / scale}
        lines += table(
            "[[coupling]]", name=coupling.name, joints=coupling.joints, ratios=coupling.ratios, **total, **cited
        )
    for actuator in mechanism.actuators:
        provenance = _ASSUMED_GAINS if actuator.name in assumed else cited
        lines += _actuator(actuator, provenance)
    for transmission in mechanism.transmissions:
        parts = {"joints": transmission.joints, "actuators": transmission.actuators, "matrix": transmission.matrix}
        lines += table("[[transmission]]", name=transmission.name, **parts, **cited)
    for named_frame in mechanism.frames:
        T_base_frame = mechanism.rest[named_frame.body] @ named_frame.T_body_frame
        lines += table(f"[frame.{named_frame.name}]", body=named_frame.body, at=frame_table(T_base_frame))
    for point in mechanism.points:
        T = mechanism.rest[point.body]
        position = T[:3, :3] @ point.p_body + T[:3, 3]
        lines += table(f"[point.{point.name}]", body=point.body, position_mm=position / MM)
    for posture, values in mechanism.postures.items():
        lines += _posture(mechanism, posture, values)
    return "\n".join(lines) + "\n"


def _joint(mechanism: Mechanism, joint: Joint) -> list[str]:
    """Return the lines of a joint, with its frames on both bodies relative to the base at rest."""
    return table(
        "[[joint]]",
        name=joint.name,
        type=joint.type,
        parent=joint.parent,
        child=joint.child,
        active=joint.active or None,
        on_parent=frame_table(mechanism.rest[joint.parent] @ joint.T_parent_joint),
        on_child=frame_table(mechanism.rest[joint.child] @ joint.T_child_joint),
    )


def _posture(mechanism: Mechanism, name: str, values: Mapping[str, float]) -> list[str]:
    """Return the lines of a posture {joint: value in m or rad}, whose keys state the units."""
    posture_values = {}
    for joint, q in values.items():
        unit, scale = display_unit(mechanism.joint(joint).is_angle)
        posture_values[f"{joint}_{unit}"] = q / scale
    return table(f"[posture.{name}]", **posture_values)


TOLERANCE = ("", "[tolerance]", "gross_mm = 1", "gross_deg = 1", "meeting_um = 1", "meeting_deg = 0.001")
"""Lines of the section [tolerance] of a new description."""

_ASSUMED_GAINS = {"provenance": "ASSUMED", "note": NOTE}


def _body(mechanism: Mechanism, body: Body, cited: Mapping[str, str]) -> list[str]:
    """Return the lines of a body: its mass properties in the frame of the base, and its meshes."""
    # True is the default of a description, so the key is written only for meshes that show a part of the body.
    states_whole = None if body.whole else False
    lines = table(f"[body.{body.name}]", whole=states_whole)
    if body.inertia is not None:
        T = mechanism.rest[body.name]
        com = T[:3, :3] @ body.inertia.p_body_com + T[:3, 3]
        I = T[:3, :3] @ body.inertia.I_com @ T[:3, :3].T  # noqa: E741
        tensor = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
        lines += [
            f"[body.{body.name}.mass]",
            *rows({"mass_kg": body.inertia.mass, "com_mm": com / MM}),
            f"inertia_kg_m2 = {toml(tensor)} # xx yy zz xy xz yz, about the centre of mass",
            *rows(cited),
        ]
    for mesh in body.meshes:
        color = mesh.color_rgba[:3]
        if mesh.color_rgba[3] != 1:
            color = mesh.color_rgba
        lines += table(f"[[body.{body.name}.meshes]]", file=f"meshes/{mesh_file(mesh)}", unit="m", color=color)
    return lines


def _limits(joint: Joint, cited: Mapping[str, str], *, unlimited: bool) -> list[str]:
    """Return the lines of the limits of a joint; [] if it has none of which a description could state something."""
    unit, scale = display_unit(joint.is_angle)
    # A description refuses soft limits beside "none"; they are kept, for they are numbers of the file.
    is_stated_unlimited = unlimited and joint.limits is None and joint.soft_limits is None
    # Without a limit, `and` leaves None, and the key is not written.
    values = {
        "limits": "none" if is_stated_unlimited else None,
        f"limits_{unit}": joint.limits and np.divide(joint.limits, scale),
        f"soft_limits_{unit}": joint.soft_limits and np.divide(joint.soft_limits, scale),
        f"max_speed_{unit}_s": joint.max_speed and joint.max_speed / scale,
        f"max_acceleration_{unit}_s2": joint.max_acceleration and joint.max_acceleration / scale,
        f"max_jerk_{unit}_s3": joint.max_jerk and joint.max_jerk / scale,
        "cone_deg": joint.cone and joint.cone / DEG,
    }
    if not rows(values):
        return []
    return table("[[limit]]", joints=[joint.name], **values, **cited)


def _actuator(actuator: Actuator, provenance: Mapping[str, str]) -> list[str]:
    unit, scale = display_unit(actuator.is_angle)
    values = {
        f"limits_{unit}": actuator.limits and np.divide(actuator.limits, scale),
        "max_effort": actuator.max_effort,
        "rotor_inertia": actuator.rotor_inertia,
        "stiffness": actuator.stiffness,
        "damping": actuator.damping or None,
        f"max_speed_{unit}_s": actuator.max_speed and actuator.max_speed / scale,
    }
    return table("[[actuator]]", name=actuator.name, kind=actuator.kind, **values, **provenance)


def frame_table(T: Array) -> JsonObject:
    """Return a frame T (4, 4) as the inline table of a description, with position_mm and angles_deg."""
    return {"position_mm": T[:3, 3] / MM, "angles_deg": spatial.euler_angles(T[:3, :3], "zyx") / DEG}
