"""Numbers, texts and angles as TOML, with all digits of a double."""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM


def number(value: float) -> str:
    """Return a number with all its digits."""
    text = repr(float(value) + 0.0)  # no -0.0
    return text if np.isfinite(value) else ("inf" if value > 0 else "-inf")


def numbers(values: Iterable[float]) -> str:
    """Return an array of numbers."""
    return f"[{', '.join(number(v) for v in values)}]"


def string(text: str) -> str:
    """Return a quoted text: JSON's strings are TOML's, but for a character that TOML wants escaped."""
    return json.dumps(text).replace("\x7f", "\\u007f")


def one_line(text: str) -> str:
    """Return one line without control characters, for a comment."""
    return "".join(c if c.isprintable() else " " for c in text)


def frame(T: Array) -> str:
    """Return a given frame of a description, position and angles of T (4, 4)."""
    angles = numbers(spatial.euler_angles(T[:3, :3], "zyx") / DEG)
    return f"{{ position_mm = {numbers(T[:3, 3] / MM)}, angles_deg = {angles} }}"
