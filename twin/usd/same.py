"""Compare two layers, with tolerances for their numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from pxr import Sdf

from twin.core.spatial import Array
from twin.core.units import DEG

_NUMBER_FORM = re.compile(r"(?<![\w.])-?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?![\w.])")

ABSOLUTE_TOL = 1e-9
"""Absolute tolerance in m and rad for joint frames and meshes in single precision."""

RELATIVE_TOL = 1e-6
"""Relative tolerance for joint frames and meshes in single precision."""


def same_layer(first: Path, second: Path) -> bool:
    """Return whether two layer files have the same content; numbers within `ABSOLUTE_TOL` and `RELATIVE_TOL` are equal.

    Files of the same robot may differ in some bytes, because processors round sums differently.
    """
    text_a = Sdf.Layer.OpenAsAnonymous(str(first)).ExportToString()
    text_b = Sdf.Layer.OpenAsAnonymous(str(second)).ExportToString()
    if _NUMBER_FORM.sub("#", text_a) != _NUMBER_FORM.sub("#", text_b):
        return False
    numbers_a, tolerances = _numbers(text_a)
    numbers_b, _ = _numbers(text_b)
    close = np.isclose(numbers_a, numbers_b, rtol=RELATIVE_TOL, atol=tolerances, equal_nan=True)
    return bool(close.all())


def _numbers(text: str) -> tuple[Array, Array]:
    """Return (numbers of a layer file, absolute tolerance of each number).

    The angles of joint drives and joint states, and the tolerances of these angles, are in degrees.
    """
    numbers: list[str] = []
    tolerances: list[float] = []
    tolerance = ABSOLUTE_TOL
    for line in text.splitlines():
        if " = " in line:  # an attribute begins; its samples are in the next lines
            tolerance = ABSOLUTE_TOL
            if ":angular:" in line:
                tolerance = ABSOLUTE_TOL / DEG
        in_line = _NUMBER_FORM.findall(line)
        numbers += in_line
        tolerances += [tolerance] * len(in_line)
    return np.array(numbers, float), np.array(tolerances)
