"""Numbers, texts and angles as TOML, with all digits of a double."""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np

from twin import spatial
from twin.spatial import Array
from twin.units import DEG, MM


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
    return f"{{ position_mm = {numbers(T[:3, 3] / MM)}, angles_deg = {numbers(zyx(T[:3, :3]) / DEG)} }}"


def zyx(R: Array) -> Array:
    """Return (psi, theta, phi) in rad with R = Rz(psi) Ry(theta) Rx(phi), exact to rounding in every pose."""
    psi = np.arctan2(R[1, 0], R[0, 0])
    theta = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    ex, ey, ez = np.eye(3)
    # phi from what the other two leave: it holds where theta is 90° and psi may be anything
    rest = (spatial.exp_so3(psi * ez) @ spatial.exp_so3(theta * ey)).T @ R
    return np.array([psi, theta, np.arctan2(rest[2, 1] - rest[1, 2], rest[1, 1] + rest[2, 2])]) + 0.0 * ex
