"""Compare two layers, with tolerances for their numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from pxr import Sdf

_NUMBER = re.compile(r"(?<![\w.])-?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?![\w.])")

ABSOLUTE, RELATIVE = 5e-8, 1e-6
"""Absolute and relative tolerance of numbers, for joint frames and meshes in single precision.

In baked motions, joint angles near 0 differ by up to 1e-8 deg between processors.
"""


def same_layer(a: Path, b: Path) -> bool:
    """Return whether two layer files have the same content, with numbers equal within `ABSOLUTE` and `RELATIVE`.

    Files of the same robot may differ in some bytes, because processors round sums differently.
    """
    texts = [Sdf.Layer.OpenAsAnonymous(str(p)).ExportToString() for p in (a, b)]
    if _NUMBER.sub("#", texts[0]) != _NUMBER.sub("#", texts[1]):
        return False
    first, second = (np.array(_NUMBER.findall(t), float) for t in texts)
    return bool(np.allclose(first, second, rtol=RELATIVE, atol=ABSOLUTE, equal_nan=True))
