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

_LEAST_GREEN = 0.02
"""Minimum difference between green and the larger of red and blue (all linear) at the greenest pixel."""

_LEAST_COLUMNS = 60
"""Minimum number of columns of an upper side; with fewer columns, the angle error may exceed 0.05 degrees."""

_LINE_TOLERANCE = 0.75
"""Maximum distance in pixels of a point of the upper side from its line; without smoothing, up to 0.5 is normal."""

_LARGEST_OFF_SHARE = 0.02
"""Maximum fraction of the columns of the upper side that are not on its line."""

_WIDEST_GAP = 3
"""Maximum number of columns from one column on the line to the next."""

_FULL_FRACTION = 0.97
"""Minimum green fraction of a fully green pixel."""

_EDGE_ROWS = 4
"""Number of rows, above the first fully green pixel of a column, that contain the edge."""

_FULL_ROWS = np.arange(3, 8)
"""Rows in which a column is fully green, counted downwards from its first green pixel."""

_BORDER_GREEN = 0.1
"""Green fraction of a pixel on the border of the picture above which the border cuts the rectangle."""

_LARGEST_DENT = 0.02
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
    if columns < _LEAST_COLUMNS:
        raise UnmeasuredError(
            f"the upper side of the rectangle has {columns:.0f} pixels in the picture (minimum {_LEAST_COLUMNS}); "
            "move the camera nearer"
        )
    between = (x > xs[0]) & (x < xs[-1])
    off_line = np.count_nonzero(between & ~inside)
    widest_gap = np.diff(xs).max()
    if off_line > _LARGEST_OFF_SHARE * np.count_nonzero(between) or widest_gap > _WIDEST_GAP:
        raise UnmeasuredError("the upper side of the rectangle is not one straight line: something covers part of it")
    corner_columns = 2 + len(xs) // 50  # left out at both ends: corners are rounded by the pixels
    slope = float(np.polyfit(xs[corner_columns:-corner_columns], ys[corner_columns:-corner_columns], 1)[0])
    return -float(np.arctan(slope))


def _mask(rgb: Array) -> Array:
    """Return the green fraction (height, width) of every pixel, 0 to 1.

    The value of a fully green pixel is measured in each column, a few rows below its first green pixel, because light
    is not the same everywhere.
    """
    green = rgb[..., 1] - np.maximum(rgb[..., 0], rgb[..., 2])
    if green.max() < _LEAST_GREEN:
        raise UnmeasuredError("the rectangle is not in the picture")
    half_green = 0.5 * green.max()
    first_row = (green > half_green).argmax(axis=0)
    inside = np.minimum(first_row + _FULL_ROWS[:, None], len(green) - 1)
    full_green = np.median(np.take_along_axis(green, inside, axis=0), axis=0)
    full_green = np.maximum(full_green, half_green)  # columns without the rectangle
    return np.clip(green / full_green, 0.0, 1.0)


def _require_inside(mask: Array) -> None:
    """Raise `UnmeasuredError` if a border of the picture cuts the rectangle."""
    borders = {"upper": mask[0], "lower": mask[-1], "left": mask[:, 0], "right": mask[:, -1]}
    cutting = []
    for name, line in borders.items():
        if line.max() > _BORDER_GREEN:
            cutting.append(name)
    if cutting:
        raise UnmeasuredError(f"the {' and the '.join(cutting)} border of the picture cuts the rectangle")


def _require_convex(mask: Array) -> None:
    """Raise `UnmeasuredError` if the rectangle is too small, or if something covers a part of it."""
    rows, columns = np.nonzero(mask > 0.5)
    if len(rows) < _LEAST_COLUMNS or not np.ptp(rows) or not np.ptp(columns):
        raise UnmeasuredError(
            f"the rectangle has {len(rows)} pixels in the picture (minimum {_LEAST_COLUMNS}); move the camera nearer"
        )
    try:  # hull of the pixels' middles: half a pixel smaller on every side
        hull = ConvexHull(np.column_stack([columns, rows]))
    except QhullError as error:
        raise UnmeasuredError(
            "the camera sees only an edge of the rectangle, as a line; move the camera in front of the rectangle"
        ) from error
    # in two dimensions, `volume` is the area and `area` the perimeter; both are of the pixels' middles
    missing = float(hull.volume + hull.area / 2 + 1) - len(rows)
    if missing > _LARGEST_DENT * len(rows) + 0.25 * hull.area:
        raise UnmeasuredError(
            f"something covers part of the rectangle: {missing / len(rows):.0%} of its area is missing"
        )


def _upper(mask: Array) -> tuple[Array, Array]:
    """Return columns (k,), and for each column the height (k,) of the upper edge in pixels from the top."""
    is_full = mask >= _FULL_FRACTION
    columns = np.flatnonzero(is_full.any(axis=0))
    first_row = is_full.argmax(axis=0)[columns]
    padded = np.pad(mask, ((_EDGE_ROWS, 0), (0, 0)))
    above = np.zeros(len(columns))
    for k in range(1, _EDGE_ROWS + 1):
        above += padded[first_row + _EDGE_ROWS - k, columns]
    return columns.astype(float), first_row - above


def _longest_line(x: Array, y: Array) -> tuple[np.ndarray, float]:
    """Find the line that contains most columns; return ((k,) bool: whether each column is on the line, slope)."""
    is_on_best = np.zeros(len(x), bool)
    slope = 0.0
    sample_columns = spread(len(x), 24)
    for i, a in enumerate(sample_columns):
        for b in sample_columns[i + 1 :]:
            rise = (y[b] - y[a]) / (x[b] - x[a])
            is_on_line = np.abs(y - y[a] - rise * (x - x[a])) < _LINE_TOLERANCE
            if is_on_line.sum() > is_on_best.sum():
                is_on_best = is_on_line
                slope = float(rise)
    return is_on_best, slope
