"""Numbers that a description adds to the drawing (limits, drives, densities, gaps, motors ...), with provenance."""

from __future__ import annotations

from twin.cad.description import Description, DriveSpec, LimitSpec
from twin.core.provenance import Parameter
from twin.core.units import DEG, MM

SCALES = {"mm": MM, "deg": DEG, "mm/s": MM, "deg/s": DEG, "mm/s2": MM, "deg/s2": DEG, "kg/m3": 1.0}
"""Factors that convert the units of the description to SI."""


def parameters(d: Description) -> list[Parameter]:
    """Return every number that the description adds to the drawing, with unit and provenance."""
    out = []

    def add(name: str, unit: str, shown: float, spec: LimitSpec | DriveSpec) -> None:
        out.append(Parameter(name, shown * SCALES.get(unit, 1.0), unit, shown, spec.provenance, spec.note))

    for limit in d.limit:
        label = ",".join(limit.joints)
        for key in type(limit).model_fields:
            value = getattr(limit, key)
            if key in ("joints", "provenance", "note") or value is None:
                continue
            name, _, unit = key.partition("_mm") if "_mm" in key else key.partition("_deg")
            unit = ("mm" if "_mm" in key else "deg") + unit.replace("_s2", "/s2").replace("_s", "/s")
            if isinstance(value, tuple):
                add(f"{label} {name} from", unit, value[0], limit)
                add(f"{label} {name} to", unit, value[1], limit)
            else:
                add(f"{label} {name}", unit, value, limit)
    angular = {j.name for j in d.joint if j.type == "revolute"}
    for drive in d.drive:
        label = ",".join(drive.joints)
        turns = drive.joints[0] in angular
        add(f"{label} drive stiffness", "N m/rad" if turns else "N/m", drive.stiffness, drive)
        add(f"{label} drive damping", "N m s/rad" if turns else "N s/m", drive.damping, drive)
        if drive.max_effort is not None:
            add(f"{label} drive max_effort", "N m" if turns else "N", drive.max_effort, drive)
    for name, material in d.material.items():
        density = material.density_kg_m3
        out.append(Parameter(f"density {name}", density, "kg/m3", density, material.provenance, material.note))
    for gap in d.gap:
        label = f"gap {gap.lower}-{gap.upper}"
        out.append(Parameter(label, gap.min_gap_mm * MM, "mm", gap.min_gap_mm, gap.provenance, gap.note))
    for c in d.coupling:
        label = f"coupling {c.name}: " + " + ".join(f"{r:g} {j}" for r, j in zip(c.ratios, c.joints, strict=False))
        if c.sum_deg is not None:
            out.append(Parameter(label, c.sum_deg * DEG, "deg", c.sum_deg, c.provenance, c.note))
        elif c.sum_mm is not None:
            out.append(Parameter(label, c.sum_mm * MM, "mm", c.sum_mm, c.provenance, c.note))
    for a in d.actuator:
        angle = a.kind == "angle"
        limits, speed = a.limits_deg or a.limits_mm, a.max_speed_deg_s or a.max_speed_mm_s
        unit = "deg" if angle else "mm"
        for name, value, per in (
            ("limits from", limits and limits[0], unit),
            ("limits to", limits and limits[1], unit),
            ("max_speed", speed, f"{unit}/s"),
            ("max_effort", a.max_effort, "N m" if angle else "N"),
            ("rotor_inertia", a.rotor_inertia, "kg m2" if angle else "kg"),
            ("stiffness", a.stiffness, "N m/rad" if angle else "N/m"),
            ("damping", a.damping or None, "N m s/rad" if angle else "N s/m"),
        ):
            if value is not None:
                label = f"actuator {a.name} {name}"
                out.append(Parameter(label, value * SCALES.get(per, 1.0), per, value, a.provenance, a.note))
    for t in d.transmission:
        for joint, row in zip(t.joints, t.matrix, strict=True):
            for motor, ratio in zip(t.actuators, row, strict=True):
                if ratio:
                    label = f"transmission {t.name}: {joint} per {motor}"
                    out.append(Parameter(label, ratio, "", ratio, t.provenance, t.note))
    return out
