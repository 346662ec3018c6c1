"""Check the time samples of a stage: what has them, at which time codes, and the time range that the stage states."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.poses import Array
from twin.exchange.formats.usd.audit.odd_values import differing_from_most

_MOVING_ATTRIBUTES = re.compile(r"xformOp:.*|state:.*|points|normals|extent")
"""Attributes that change during a motion: poses, joint values, and the surfaces of deformables."""


def check_sampled_joints(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report joints without samples of their coordinate if most others have some."""
    sampled: dict[str, bool] = {}
    for prim in stage.Traverse():
        for token in ("angular", "linear"):
            attribute = prim.GetAttribute(f"state:{token}:physics:position")
            if attribute and attribute.HasAuthoredValue():
                sampled[prim.GetName()] = attribute.GetNumTimeSamples() > 0
    for name, has_samples, most_have, count in differing_from_most(sampled):
        if most_have and not has_samples:
            text = f"joint '{name}' has no samples of its coordinate; {count} others have some."
            ledger.add("usd.state", "warning", text, name, suggestion="bake the motion again")


def check_sample_times(stage: Usd.Stage, links: Sequence[str], ledger: Ledger) -> None:
    """Report links whose poses have samples at other time codes than those of most links."""
    times: dict[str, tuple[float, ...]] = {}
    for prim in stage.Traverse():
        if prim.GetName() in links and prim.HasAPI(UsdPhysics.RigidBodyAPI):
            samples: set[float] = set()
            for op in UsdGeom.Xformable(prim).GetOrderedXformOps():
                samples |= set(op.GetTimeSamples())
            times[prim.GetName()] = tuple(sorted(samples))
    for link, own_times, common_times, count in differing_from_most(times):
        if not own_times:  # at rest during the motion
            continue
        differing = sorted(set(own_times) ^ set(common_times))
        text = (
            f"the poses of link '{link}' have a time sample at the time code {differing[0]:g} that those of {count} "
            "other links lack."
        )
        if differing[0] in common_times:
            text = (
                f"the poses of link '{link}' lack the time sample at the time code {differing[0]:g}, which {count} "
                "other links have."
            )
        ledger.add("usd.sample_times", "warning", text, link, suggestion="bake the motion again")


def check_changing_attributes(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report what changes with time besides poses, joint values and the points of deformables: a player shows it."""
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            name = attribute.GetName()
            if attribute.GetNumTimeSamples() == 0 or _MOVING_ATTRIBUTES.fullmatch(name):
                continue
            path = str(attribute.GetPath())
            text = f"{name} of {prim.GetPath()} has time samples; only poses, joint values and points may change."
            ledger.wrong("usd.changing", text, path, suggestion="remove the time samples, and write one value")


def _hidden_samples(stage: Usd.Stage) -> str:
    """Return the first attribute whose time samples a default of a stronger layer hides, as text; "" without one."""
    for prim in stage.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetNumTimeSamples():
                continue
            stronger = ""  # the strongest layer with a default value
            for spec in attribute.GetPropertyStack():
                file = spec.layer.GetDisplayName()
                if stronger and spec.layer.GetNumTimeSamplesForPath(spec.path):
                    return (
                        f"no link moves: {file} has time samples of {attribute.GetPath()}, but the value in "
                        f"{stronger}, a stronger layer, hides them."
                    )
                if not stronger and spec.HasDefaultValue():
                    stronger = file
    return ""


def check_time_range(stage: Usd.Stage, codes: Array, ledger: Ledger) -> None:
    """Report a time range that is not that of the samples."""
    first = stage.GetStartTimeCode()
    last = stage.GetEndTimeCode()
    hidden = "" if len(codes) else _hidden_samples(stage)
    if last > first and hidden:
        advice = "list the layer of the motion above the layer of the robot in the sublayers"
        ledger.wrong("usd.range", hidden, "subLayers", suggestion=advice)
        return
    if last > first and not len(codes):
        text = (
            f"startTimeCode .. endTimeCode is {first:g} .. {last:g}, but no link has time samples: the layer of the "
            "motion is missing among the sublayers, or has none."
        )
        ledger.wrong("usd.range", text, "endTimeCode", suggestion="add the layer of the motion to the sublayers")
        return
    expected: Sequence[float] = (0.0, 0.0)
    if len(codes):
        expected = (float(codes[0]), float(codes[-1]))
    if not np.allclose((first, last), expected, rtol=0.0, atol=1e-6):
        text = (
            f"startTimeCode .. endTimeCode is {first:g} .. {last:g}; the time codes of the samples are "
            f"{expected[0]:g} .. {expected[1]:g}."
        )
        ledger.add("usd.range", "warning", text, "endTimeCode", suggestion="write the range of the samples")
