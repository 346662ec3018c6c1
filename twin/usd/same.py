"""Compare two layers, with tolerances for their numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from pxr import Sdf

from twin.core.spatial import Array
from twin.core.units import DEG

_NUMBER = re.compile(r"(?<![\w.])-?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?![\w.])")

ABSOLUTE, RELATIVE = 1e-9, 1e-6
"""Absolute tolerance in m and rad, and relative tolerance, for joint frames and meshes in single precision."""


def same_layer(a: Path, b: Path) -> bool:
    """Return whether two layer files have the same content, with numbers equal within `ABSOLUTE` and `RELATIVE`.

    Files of the same robot may differ in some bytes, because processors round sums differently.
    """
    texts = [Sdf.Layer.OpenAsAnonymous(str(p)).ExportToString() for p in (a, b)]
    if _NUMBER.sub("#", texts[0]) != _NUMBER.sub("#", texts[1]):
        return False
    (first, tolerance), (second, _) = map(_numbers, texts)
    return bool((np.isclose(first, second, rtol=RELATIVE, atol=tolerance, equal_nan=True)).all())


def _numbers(text: str) -> tuple[Array, Array]:
    """Return (numbers of a layer file, absolute tolerance of each number).

    The angles of joint drives and joint states, and the tolerances of these angles, are in degrees.
    """
    numbers, tolerances, unit = [], [], 1.0
    for line in text.splitlines():
        if " = " in line:  # an attribute begins; its samples are in the next lines
            unit = DEG if ":angular:" in line else 1.0
        found = _NUMBER.findall(line)
        numbers += found
        tolerances += [ABSOLUTE / unit] * len(found)
    return np.array(numbers, float), np.array(tolerances)
