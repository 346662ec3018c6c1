"""HTML of a trajectory for notebooks: a row for each joint, with its range, largest speed and curve."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_WIDTH = 240
_HEIGHT = 28
"""Size of the picture of a curve in pixels."""

_POINTS = 240
"""Largest number of points of a curve."""

_ROUNDING = 1e-6
"""Range in mm or degrees that can be a rounding error of a joint that does not move."""


def html_of(title: str, facts: str, names: Sequence[str], qs: Array, qds: Array, revolute: Sequence[bool]) -> str:
    """Return a table of joints in mm and degrees, below a title and facts.

    qs and qds (k, n) are joint values and speeds in SI units; `revolute` (n,) is whether each joint is in rad.
    """
    rows = [_row("th", ("joint", "from", "to", "", "largest speed", "motion"))]
    for joint, name in enumerate(names):
        unit = "mm"
        size = MM
        if revolute[joint]:
            unit = "°"
            size = DEG
        q = qs[:, joint] / size
        speed = np.abs(qds[:, joint]).max(initial=0.0) / size
        cells = (escape(name), f"{q.min():.1f}", f"{q.max():.1f}", unit, f"{speed:.1f} {unit}/s", _curve(q))
        rows.append(_row("td", cells))
    table = f"<table>{''.join(rows)}</table>"
    return f"<div><b>{escape(title)}</b> {escape(facts)}{table}</div>"


def _row(tag: str, cells: Sequence[str]) -> str:
    """Return a row of a table, with each cell in an element `tag`."""
    content = "".join(f"<{tag}>{cell}</{tag}>" for cell in cells)
    return f"<tr>{content}</tr>"


def _curve(values: Array) -> str:
    """Return values (k,) in mm or degrees as an SVG picture; without a range, the line is in the middle."""
    chosen = values[spread(len(values), _POINTS)]
    low = chosen.min()
    span = np.ptp(chosen)
    heights = np.full(len(chosen), 0.5)
    if span > _ROUNDING:
        heights = (chosen - low) / span
    columns = np.linspace(0, _WIDTH, len(chosen))
    rows = (1 - heights) * (_HEIGHT - 2) + 1  # a margin of 1 pixel: half of the line is beside the curve
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(columns, rows, strict=True))
    line = f'<polyline points="{points}" fill="none" stroke="#1f77b4" stroke-width="1.5"/>'
    return f'<svg width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}">{line}</svg>'
