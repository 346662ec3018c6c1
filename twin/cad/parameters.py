"""Numbers of the description that are not in the CAD (limits, drives, densities, gaps, motors ...), with provenance."""

from __future__ import annotations

from collections.abc import Iterator

from twin.cad.description import ActuatorSpec, CouplingSpec, Description, DriveSpec, LimitSpec, TransmissionSpec
from twin.core.provenance import Parameter
from twin.schema import Row


def parameters(d: Description) -> list[Parameter]:
    """Return every number of the description that is not in the CAD, with unit and provenance."""
    out: list[Parameter] = []
    for limit in d.limit:
        out += limit.parameters(",".join(limit.joints), _limit(limit))
    angular = {j.name for j in d.joint if j.type == "revolute"}
    for drive in d.drive:
        out += drive.parameters(",".join(drive.joints) + " drive", _drive(drive, drive.joints[0] in angular))
    for name, material in d.material.items():
        out += material.parameters("density", [(name, material.density_kg_m3, "kg/m3")])
    for gap in d.gap:
        out += gap.parameters("gap", [(f"{gap.lower}-{gap.upper}", gap.min_gap_mm, "mm")])
    for c in d.coupling:
        out += c.parameters("coupling", _coupling(c))
    for a in d.actuator:
        out += a.parameters(f"actuator {a.name}", _actuator(a))
    for t in d.transmission:
        out += t.parameters(f"transmission {t.name}:", _transmission(t))
    return out


def _limit(limit: LimitSpec) -> Iterator[Row]:
    for key in type(limit).model_fields:
        value = getattr(limit, key)
        if key in ("joints", "provenance", "note"):
            continue
        base = "mm" if "_mm" in key else "deg"
        name, _, per = key.partition(f"_{base}")
        unit = base + per.replace("_s2", "/s2").replace("_s", "/s")
        if isinstance(value, tuple):
            yield f"{name} from", value[0], unit
            yield f"{name} to", value[1], unit
        else:
            yield name, value, unit


def _drive(drive: DriveSpec, angle: bool) -> Iterator[Row]:
    yield "stiffness", drive.stiffness, "N m/rad" if angle else "N/m"
    yield "damping", drive.damping, "N m s/rad" if angle else "N s/m"
    yield "max_effort", drive.max_effort, "N m" if angle else "N"


def _coupling(c: CouplingSpec) -> Iterator[Row]:
    label = f"{c.name}: " + " + ".join(f"{r:g} {j}" for r, j in zip(c.ratios, c.joints, strict=False))
    yield label, c.sum_deg, "deg"
    yield label, c.sum_mm, "mm"


def _actuator(a: ActuatorSpec) -> Iterator[Row]:
    angle, limits = a.kind == "angle", a.limits
    unit = "deg" if angle else "mm"
    yield "limits from", limits and limits[0], unit
    yield "limits to", limits and limits[1], unit
    yield "max_speed", a.max_speed, f"{unit}/s"
    yield "max_effort", a.max_effort, "N m" if angle else "N"
    yield "rotor_inertia", a.rotor_inertia, "kg m2" if angle else "kg"
    yield "stiffness", a.stiffness, "N m/rad" if angle else "N/m"
    yield "damping", a.damping or None, "N m s/rad" if angle else "N s/m"


def _transmission(t: TransmissionSpec) -> Iterator[Row]:
    for joint, row in zip(t.joints, t.matrix, strict=True):
        for motor, ratio in zip(t.actuators, row, strict=True):
            yield f"{joint} per {motor}", ratio or None, ""
