"""Check time samples: their range, and the interpolation between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Sdf, Usd

from twin.core.findings import Finding, Kind, disagreement
from twin.core.quantity import Quantity, deg
from twin.core.units import DEG
from twin.usd import gf
from twin.usd.check.bodies import QUATERNION_TOL, non_unit
from twin.usd.scan import RawStage

MAX_STEP = 90 * DEG
"""Maximum rotation in rad between two samples. Players use the shorter rotation, which is wrong above 180 deg."""


_QUATERNION_SIGN = Kind(
    "stage.quaternion_sign",
    "disagreement",
    "negate quaternions so that successive quaternions have a positive dot product",
)
_SAMPLE_STEP = Kind("stage.sample_step", "disagreement", "bake more samples")


def check_samples(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on all attributes with time samples."""
    is_reported = False
    for prim in scene.prims:
        for attribute in prim.GetAuthoredAttributes():
            codes = attribute.GetTimeSamples()
            if not codes:
                continue
            path = str(attribute.GetPath())
            if scene.stage.HasAuthoredTimeCodeRange():
                yield from _check_range(scene, path, codes)
            elif not is_reported:
                is_reported = True
                text = (
                    f"{path} has time samples, but the stage has no startTimeCode and endTimeCode: players show only "
                    "one frame"
                )
                yield disagreement("stage.time_range", path, text, suggestion="author startTimeCode and endTimeCode")
            kind = attribute.GetTypeName().type
            if kind in (Sdf.ValueTypeNames.Quatf.type, Sdf.ValueTypeNames.Quatd.type):
                yield from _check_quaternions(attribute, codes)


def _check_range(scene: RawStage, path: str, codes: list[float]) -> Iterator[Finding]:
    start = scene.stage.GetStartTimeCode()
    end = scene.stage.GetEndTimeCode()
    outside = [code for code in codes if not start <= code <= end]
    if not outside:
        return
    farthest = max(outside, key=lambda code: max(start - code, code - end))
    limit = start
    if farthest > end:
        limit = end
    yield disagreement(
        "stage.time_range",
        path,
        f"{path}: {len(outside)} of {len(codes)} samples are never played, because their time codes are "
        f"outside {start:g} .. {end:g}; the farthest time code",
        Quantity(farthest),
        Quantity(limit),
        "widen startTimeCode .. endTimeCode, or remove the samples",
    )


def _check_quaternions(attribute: Usd.Attribute, codes: list[float]) -> Iterator[Finding]:
    path = str(attribute.GetPrim().GetPath())
    name = attribute.GetName()
    query = Usd.AttributeQuery(attribute)  # resolves the layers once instead of at every sample
    quaternions = []
    for code in codes:
        quaternions.append(query.Get(Usd.TimeCode(code)))
    q = gf.quat_array_wxyz(quaternions)
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
        first_code = codes[int(flips[0])]
        text = (
            f"{path}: quaternion {name} changes sign; where it does, players that interpolate components (Unity) "
            "rotate by up to 180°. Number of sign changes"
        )
        yield _QUATERNION_SIGN(path, text, Quantity(len(flips)), 0, when=f"time code {first_code:g}")
    steps = 2 * np.arccos(np.clip(np.abs(dots), 0, 1))
    worst_step = int(np.argmax(steps))
    if steps[worst_step] > MAX_STEP:
        text = (
            f"{path} rotates too far between the time codes {codes[worst_step]:g} and {codes[worst_step + 1]:g} "
            "(above 180°, players rotate backwards)"
        )
        yield _SAMPLE_STEP(path, text, deg(steps[worst_step]), deg(MAX_STEP), when=f"time code {codes[worst_step]:g}")
