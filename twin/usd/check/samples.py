"""Time samples: their range, and what players do between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Sdf, Usd

from twin.core.findings import Finding
from twin.core.units import DEG
from twin.usd import gf
from twin.usd.check.bodies import QUATERNION_TOL, non_unit
from twin.usd.scan import Scene

MAX_STEP = 90 * DEG
"""Largest turn between two samples: USD and glTF turn the short way, so that half a turn is lost."""


def check_samples(scene: Scene) -> Iterator[Finding]:
    """Yield findings on all attributes with time samples."""
    stage = scene.stage
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    ranged = stage.HasAuthoredTimeCodeRange()
    told = False
    for prim in scene.prims:
        for attribute in prim.GetAuthoredAttributes():
            codes = attribute.GetTimeSamples()
            if not codes:
                continue
            path = str(attribute.GetPath())
            if not ranged and not told:
                told = True
                yield Finding(
                    "stage.time_range",
                    "disagreement",
                    f"{path} has time samples, but the stage has no startTimeCode and endTimeCode: players "
                    "show one frame.",
                    where=path,
                    suggestion="author startTimeCode and endTimeCode",
                )
            outside = [c for c in codes if not start <= c <= end]
            if ranged and outside:
                far = max(outside, key=lambda c: max(start - c, c - end))
                yield Finding(
                    "stage.time_range",
                    "disagreement",
                    f"{path}: {len(outside)} of {len(codes)} samples, as far as time code {far:g}, lie "
                    f"outside {start:g} .. {end:g} and never play.",
                    where=path,
                    size=float(far),
                    limit=float(end if far > end else start),
                    suggestion="widen startTimeCode .. endTimeCode, or drop the samples",
                )
            kind = attribute.GetTypeName().type
            if kind in (Sdf.ValueTypeNames.Quatf.type, Sdf.ValueTypeNames.Quatd.type):
                yield from _check_quaternions(attribute, codes)


def _check_quaternions(attribute: Usd.Attribute, codes: list[float]) -> Iterator[Finding]:
    path, name = str(attribute.GetPrim().GetPath()), attribute.GetName()
    query = Usd.AttributeQuery(attribute)  # resolves the layers once, not at every sample
    q = gf.quat_array_wxyz([query.Get(Usd.TimeCode(c)) for c in codes])
    length = np.linalg.norm(q, axis=1)
    worst = int(np.argmax(np.abs(length - 1)))
    if not abs(length[worst] - 1) < QUATERNION_TOL:
        yield non_unit(path, name, float(length[worst]), f"time code {codes[worst]:g}")
        return
    if len(codes) < 2:
        return
    dots = np.sum(q[1:] * q[:-1], axis=1) / (length[1:] * length[:-1])
    flips = np.flatnonzero(dots < 0)
    if len(flips):
        k = int(flips[0])
        yield Finding(
            "stage.quaternion_sign",
            "disagreement",
            f"{path}: {name} changes sign {len(flips)} times, first between time codes {codes[k]:g} and "
            f"{codes[k + 1]:g}: players that interpolate the numbers (Unity) glitch by up to 180 deg.",
            where=path,
            when=f"time code {codes[k]:g}",
            size=float(len(flips)),
            limit=0.0,
            suggestion="negate quaternions so that neighbours have a positive dot product",
        )
    turn = 2 * np.arccos(np.clip(np.abs(dots), 0, 1))
    k = int(np.argmax(turn))
    if turn[k] > MAX_STEP:
        yield Finding(
            "stage.sample_step",
            "disagreement",
            f"{path} turns {turn[k] / DEG:.4g} deg between time codes {codes[k]:g} and {codes[k + 1]:g} "
            f"(limit {MAX_STEP / DEG:g}): above 180 it plays backwards.",
            where=path,
            when=f"time code {codes[k]:g}",
            size=float(turn[k] / DEG),
            unit="deg",
            limit=MAX_STEP / DEG,
            suggestion="bake more samples",
        )
