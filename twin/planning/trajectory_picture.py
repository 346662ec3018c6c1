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


def html_of(title: str, facts: str, names: Sequence[str], qs: Array, qds: Array, angles: Sequence[bool]) -> str:
    """Return a table of joints in mm and degrees, below a title and facts.

    qs and qds (k, n) are joint values and speeds in SI units; `angles` (n,) are whether each joint is in rad.
    """
    rows = []
    for i, name in enumerate(names):
        unit = "°" if angles[i] else "mm"
        size = DEG if angles[i] else MM
        q = qs[:, i] / size
        speed = np.abs(qds[:, i]).max(initial=0.0) / size
        cells = [escape(name), f"{q.min():.1f}", f"{q.max():.1f}", unit, f"{speed:.1f} {unit}/s", _curve(q)]
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    heads = ("joint", "from", "to", "", "largest speed", "motion")
    header = "".join(f"<th>{head}</th>" for head in heads)
    table = f"<table><tr>{header}</tr>{''.join(rows)}</table>"
    return f"<div><b>{escape(title)}</b> {escape(facts)}{table}</div>"


def _curve(values: Array) -> str:
    """Return a curve as SVG that fills its picture; a constant value is a line in the middle."""
    chosen = values[spread(len(values), _POINTS)]
    low = chosen.min()
    span = np.ptp(chosen)
    heights = np.full(len(chosen), 0.5)
    if span > 0:
        heights = (chosen - low) / span
    x = np.linspace(0, _WIDTH, len(chosen))
    y = (1 - heights) * (_HEIGHT - 2) + 1
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    line = f'<polyline points="{points}" fill="none" stroke="#1f77b4" stroke-width="1.5"/>'
    return f'<svg width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}">{line}</svg>'
