"""A posture and a time as text, for the address of a page: "q=308,502.5,265&t=3.200"."""

from __future__ import annotations

import math
from collections.abc import Sequence
from urllib.parse import parse_qs

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.joint import Joint

MAX_LENGTH = 200
"""Maximum number of characters: a page sends no longer text."""


def posture_text(joints: Sequence[Joint], q: Array, t: float | None) -> str:
    """Return joint values q (n,) in rad or m as degrees and millimetres, with a time t in s; None: no time.

    Numbers have six decimals, or three or one if the text would be longer than `MAX_LENGTH`. Return "" if even one
    decimal is too many.
    """
    for digits in (6, 3, 1):
        numbers = []
        for joint, value in zip(joints, q, strict=True):
            unit = DEG if joint.is_angle else MM
            rounded = round(float(value) / unit, digits) + 0.0  # -0.0 + 0.0 is 0.0, without a sign
            numbers.append(f"{rounded:.12g}")
        text = "q=" + ",".join(numbers)
        if t is not None:
            text += f"&t={t:.3f}"
        if len(text) <= MAX_LENGTH:
            return text
    return ""


def read_posture(text: str, joints: Sequence[Joint]) -> tuple[Array, float | None]:
    """Return joint values (n,) in rad or m, and the time in s (None: no time), of a text as `posture_text` writes it.

    A "#" before the text is left out; a negative time is read as 0.

    Raises:
        TwinError: the text has another form, another number of joints, or a number that is not finite.
    """
    values_by_key = parse_qs(text.strip().removeprefix("#"), keep_blank_values=True)
    values = []
    if "q" in values_by_key:
        values = values_by_key["q"][0].split(",")
    if len(values) != len(joints) or not values:
        names = []
        for joint in joints:
            unit = "°" if joint.is_angle else "mm"
            names.append(f"{joint.name} [{unit}]")
        raise TwinError(
            f"a posture is q=NUMBER,NUMBER,... with {len(joints)} numbers ({', '.join(names)}), and &t=SECONDS; "
            f"'{text[:80]}' has {len(values)}"
        )
    q = np.zeros(len(joints))
    for k, (joint, value) in enumerate(zip(joints, values, strict=True)):
        unit = DEG if joint.is_angle else MM
        q[k] = _number(value, joint.name) * unit
    t = None
    if "t" in values_by_key:
        t = max(0.0, _number(values_by_key["t"][0], "t"))
    return q, t


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TwinError(f"posture: {name} = '{text[:40]}' is not a finite number")
    return value
