"""Write numbers, texts and angles as TOML, with all digits of a double."""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM


def number(value: float) -> str:
    """Return a number as TOML with all its digits."""
    text = repr(float(value) + 0.0)  # turns -0.0 into 0.0
    return text if np.isfinite(value) else ("inf" if value > 0 else "-inf")


def numbers(values: Iterable[float]) -> str:
    """Return numbers as a TOML array."""
    return f"[{', '.join(number(v) for v in values)}]"


def string(text: str) -> str:
    """Return a text as a TOML string: a JSON string, in which TOML requires one more character to be escaped."""
    return json.dumps(text).replace("\x7f", "\\u007f")


def one_line(text: str) -> str:
    """Return a text as one line without control characters, for a comment."""
    return "".join(c if c.isprintable() else " " for c in text)


def frame(T: Array) -> str:
    """Return a frame T (4, 4) as TOML with position_mm and angles_deg."""
    angles = numbers(spatial.euler_angles(T[:3, :3], "zyx") / DEG)
    return f"{{ position_mm = {numbers(T[:3, 3] / MM)}, angles_deg = {angles} }}"
