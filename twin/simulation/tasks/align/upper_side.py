"""Measure the angle of the upper side of a green rectangle in a picture, as in the paper: mask, upper side, slope.

The mask has the green fraction of every pixel, so that an edge is measured to a fraction of a pixel. The paper uses two
points of the upper side; here, a line is fitted to all columns of the upper side.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from twin.core.errors import TwinError
from twin.core.sampling import spread
from twin.core.spatial import Array

_GREEN = 0.02
"""Minimum difference between green and the larger of red and blue (all linear) at the greenest pixel."""

_SHORTEST = 60
"""Minimum number of columns of an upper side; with fewer columns, the angle error may exceed 0.05 degrees."""

_OFF = 0.75
"""Maximum distance in pixels of a point of the upper side from its line; without smoothing, up to 0.5 is normal."""

_FULL = 0.97
"""Minimum green fraction of a fully green pixel."""

_ABOVE = 4
"""Number of rows, above the first fully green pixel of a column, that contain the edge."""

_INSIDE = np.arange(3, 8)
"""Rows in which a column is fully green, counted downwards from its first green pixel."""

_DENT = 0.02
"""Maximum fraction of the mask's area that may be missing from its convex hull."""


class UnmeasuredError(TwinError):
    """The upper side of the rectangle cannot be measured in this picture; the message gives the reason."""


def angle(rgb: Array) -> float:
    """Return the angle in rad of the rectangle's upper side from the picture's horizontal, counter-clockwise positive.

    Args:
        rgb: (height, width, 3) linear colours of the picture.

    Raises:
        UnmeasuredError: there is no green rectangle, or it is cut by the border of the picture, too small, partly
            covered, or turned by more than 45 degrees.
    """
    mask = _mask(rgb)
    _require_inside(mask)
    _require_convex(mask)
    x, y = _upper(mask)
    inside, slope = _longest_line(x, y)
    if abs(slope) > 1:
        raise UnmeasuredError("the rectangle is turned by more than 45 degrees, so that its upper side is ambiguous")
    xs = x[inside]
    ys = y[inside]
    columns = np.ptp(xs) + 1
    if columns < _SHORTEST:
        raise UnmeasuredError(
            f"the upper side of the rectangle has {columns:.0f} pixels in the picture (minimum {_SHORTEST}); "
            "move the camera nearer"
        )
    between = (x > xs[0]) & (x < xs[-1])
    off_line = np.count_nonzero(between & ~inside)
    widest_gap = np.diff(xs).max()
    if off_line > 0.02 * np.count_nonzero(between) or widest_gap > 3:
        raise UnmeasuredError("the upper side of the rectangle is not one straight line: something covers part of it")
    cut = 2 + len(xs) // 50  # corners are rounded by the pixels
    slope = float(np.polyfit(xs[cut:-cut], ys[cut:-cut], 1)[0])
    return -float(np.arctan(slope))


def _mask(rgb: Array) -> Array:
    """Return the green fraction (height, width) of every pixel, 0 to 1.

    The value of a fully green pixel is measured in each column, a few rows below its first green pixel, because light
    is not the same everywhere.
    """
    green = rgb[..., 1] - np.maximum(rgb[..., 0], rgb[..., 2])
    if green.max() < _GREEN:
        raise UnmeasuredError("the rectangle is not in the picture")
    half = 0.5 * green.max()
    first = (green > half).argmax(axis=0)
    inside = np.minimum(first + _INSIDE[:, None], len(green) - 1)
    full = np.median(np.take_along_axis(green, inside, axis=0), axis=0)
    full = np.maximum(full, half)  # columns without the rectangle
    return np.clip(green / full, 0.0, 1.0)


def _require_inside(mask: Array) -> None:
    borders = {"upper": mask[0], "lower": mask[-1], "left": mask[:, 0], "right": mask[:, -1]}
    cut = []
    for name, line in borders.items():
        if line.max() > 0.1:
            cut.append(name)
    if cut:
        raise UnmeasuredError(f"the {' and the '.join(cut)} border of the picture cuts the rectangle")


def _require_convex(mask: Array) -> None:
    rows, columns = np.nonzero(mask > 0.5)
    if len(rows) < _SHORTEST or not np.ptp(rows) or not np.ptp(columns):
        raise UnmeasuredError(
            f"the rectangle has {len(rows)} pixels in the picture (minimum {_SHORTEST}); move the camera nearer"
        )
    try:  # hull of the pixels' middles: half a pixel smaller on every side
        hull = ConvexHull(np.column_stack([columns, rows]))
    except QhullError as error:
        raise UnmeasuredError(
            "the camera sees only an edge of the rectangle, as a line; move the camera in front of the rectangle"
        ) from error
    # in two dimensions, `volume` is the area and `area` the perimeter; both are of the pixels' middles
    missing = float(hull.volume + hull.area / 2 + 1) - len(rows)
    if missing > _DENT * len(rows) + 0.25 * hull.area:
        raise UnmeasuredError(
            f"something covers part of the rectangle: {missing / len(rows):.0%} of its area is missing"
        )


def _upper(mask: Array) -> tuple[Array, Array]:
    """Return columns (k,), and for each column the height (k,) of the upper edge in pixels from the top."""
    full = mask >= _FULL
    columns = np.flatnonzero(full.any(axis=0))
    first = full.argmax(axis=0)[columns]
    padded = np.pad(mask, ((_ABOVE, 0), (0, 0)))
    above = np.zeros(len(columns))
    for k in range(1, _ABOVE + 1):
        above += padded[first + _ABOVE - k, columns]
    return columns.astype(float), first - above


def _longest_line(x: Array, y: Array) -> tuple[np.ndarray, float]:
    """Find the line that contains most columns; return ((k,) bool: whether each column is on the line, slope)."""
    best = np.zeros(len(x), bool)
    slope = 0.0
    picks = spread(len(x), 24)
    for i, a in enumerate(picks):
        for b in picks[i + 1 :]:
            rise = (y[b] - y[a]) / (x[b] - x[a])
            on_line = np.abs(y - y[a] - rise * (x - x[a])) < _OFF
            if on_line.sum() > best.sum():
                best = on_line
                slope = float(rise)
    return best, slope
