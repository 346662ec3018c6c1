"""Compare what a stage lists for twin in its customData with what it states for engines: cones and couplings."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.reduced_couplings import reduced_couplings

_CONE_TOL = 1e-5
"""Difference in rad of two equal half angles of a cone: the schema has them in degrees, in single precision."""


def assumed_numbers(stage: Usd.Stage) -> dict[str, str]:
    """Return {name: reason} for the assumed numbers of a stage."""
    root = stage.GetDefaultPrim()
    if not root:
        return {}
    parameters = root.GetCustomDataByKey("twin:parameters") or {}
    reasons = {}
    for name, parameter in parameters.items():
        if parameter.get("provenance") == "ASSUMED":
            reasons[name] = str(parameter.get("note", ""))
    return reasons


_COUPLING_TOL = 1e-5
"""Difference of two equal ratios (1, m/rad or rad/m) or sums (m or rad): engines get single precision."""


def check_cones(stage: Usd.Stage, mechanism: FileMechanism, ledger: Ledger) -> None:
    """Compare the cones of ball joints with the parameters "<joint>,<joint> cone" that the stage itself lists."""
    listed: dict[str, float] = {}
    for parameter, row in custom_data(stage, "twin:parameters").items():
        joints, _, field = str(parameter).rpartition(" ")
        if field == "cone" and "value" in row:
            for joint_name in joints.split(","):
                listed[joint_name] = float(row["value"])
    for joint in mechanism.joints:
        name = " ".join(joint.names)
        if name not in listed or joint.drive.cone is None:
            continue
        expected = listed[name]
        stated = max(joint.drive.cone, key=lambda half_angle: abs(half_angle - expected))
        if not abs(stated - expected) < _CONE_TOL:
            difference_text = f"{stated * 180 / np.pi:.6g} deg, but its parameter is {expected * 180 / np.pi:.6g} deg"
            text = f"joint '{name}' has a cone of {difference_text}."
            ledger.wrong("usd.cone", text, name, suggestion="export the stage again")


def custom_data(stage: Usd.Stage, key: str) -> JsonObject:
    """Return an entry of the customData of the default prim; {} without one."""
    root = stage.GetDefaultPrim()
    if not root:
        return {}
    return root.GetCustomDataByKey(key) or {}


def check_couplings(stage: Usd.Stage, mechanism: FileMechanism, ledger: Ledger) -> None:
    """Compare the couplings that the stage lists for twin with those that it states for physics engines."""
    listed: dict[str, tuple[dict[str, float], float]] = {}
    for name, coupling in custom_data(stage, "twin:couplings").items():
        listed[name] = (dict(coupling["ratios"]), float(coupling["total"]))
    stated = mechanism.couplings or {}
    if len(listed) != len(stated):  # engines cannot hold every coupling
        return
    for_engines = reduced_couplings(stated)
    for joint, (ratios, total) in reduced_couplings(listed).items():
        others, other_total = for_engines.get(joint, ({}, 0.0))
        off = abs(total - other_total)
        for name in {*ratios, *others}:
            off = max(off, abs(ratios.get(name, 0.0) - others.get(name, 0.0)))
        if off > _COUPLING_TOL:
            text = f"the coupling of joint '{joint}' in the list for twin is not that for physics engines."
            ledger.wrong("usd.coupling", text, joint, suggestion="export the stage again")
