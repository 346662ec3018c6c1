"""Measure the colours of links: the fraction of a link's surface area for each linear colour."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.exchange.audit.poses import Array

Rgba = tuple[float, float, float, float]

COMPONENT_TOL = 0.0051
"""Maximum difference between components of equal colours, linear or as display values: rounding to eight bits twice."""


class Palette:
    """Accumulator of the surface area in m2 of each colour of each link."""

    def __init__(self) -> None:
        self._areas: dict[str, dict[Rgba, float]] = {}

    def add(self, link: str, rgba: Array | Rgba, area: float) -> None:
        """Add a surface with the linear colour `rgba` (4,) and the area `area` in m2 to a link."""
        r, g, b, a = np.asarray(rgba, float).tolist()
        color = (round(r, 4), round(g, 4), round(b, 4), round(a, 4))
        areas = self._areas.setdefault(link, {})
        areas[color] = areas.get(color, 0.0) + area

    def add_finish(self, link: str, metallic: float, roughness: float, area: float) -> None:
        """Add a surface with a finish from 0 to 1, as if it were a colour: both are compared in the same way."""
        self.add(link, (metallic, roughness, 0.0, 1.0), area)

    def shares(self) -> dict[str, dict[Rgba, float]]:
        """Return {link: {colour: fraction (0..1) of the link's area}}; links without area are omitted."""
        shares = {}
        for link, areas in self._areas.items():
            total = sum(areas.values())
            if total > 0:
                shares[link] = {}
                for color, area in areas.items():
                    shares[link][color] = area / total
        return shares


def linear(display_values: Array) -> Array:
    """Return linear components (..., 3) of display values (sRGB), by IEC 61966-2-1."""
    components = np.asarray(display_values, float)
    dark = components / 12.92
    # Where the components are dark, the power is computed too, and must be of no negative number.
    bright = ((np.maximum(components, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(components <= 0.04045, dark, bright)


def display(linear: Array) -> Array:
    """Return display values (sRGB) (..., 3) of linear components, by IEC 61966-2-1."""
    components = np.maximum(np.asarray(linear, float), 0.0)
    return np.where(components <= 0.0031308, 12.92 * components, 1.055 * components ** (1 / 2.4) - 0.055)


def surface_area(vertices: Array, triangles: Array) -> float:
    """Return the area in m2 of triangles (m, 3) over points (n, 3) in m."""
    a = vertices[triangles[:, 0]]
    b = vertices[triangles[:, 1]]
    c = vertices[triangles[:, 2]]
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(doubled.sum() / 2)


def color_difference(first_shares: Mapping[Rgba, float], second_shares: Mapping[Rgba, float]) -> float:
    """Return the fraction (0..1) of a link's surface area that has different colours in two files.

    `first_shares` and `second_shares` are {linear colour: fraction of the link's area} in the first and in the second
    file.
    """
    unmatched = dict(second_shares)
    matched = 0.0
    for color, share in first_shares.items():
        # The nearest colours first: a colour that is farther off may be the counterpart of another one.
        for candidate in sorted(unmatched, key=lambda c: _largest_component_difference(c, color)):
            if not _is_same_color(candidate, color) or share <= 0:
                break
            common = min(share, unmatched[candidate])
            unmatched[candidate] -= common
            share -= common
            matched += common
    return 1.0 - matched


def _is_same_color(first: Rgba, second: Rgba) -> bool:
    """Return whether two linear colours are equal, if one of them is rounded to eight bits, in either form."""
    if _largest_component_difference(first, second) <= COMPONENT_TOL:
        return True
    displayed = (*display(np.array(first[:3])).tolist(), first[3])
    other_displayed = (*display(np.array(second[:3])).tolist(), second[3])
    return _largest_component_difference(displayed, other_displayed) <= COMPONENT_TOL


def _largest_component_difference(first: Rgba, second: Rgba) -> float:
    """Return the largest difference between two components."""
    return float(np.abs(np.subtract(first, second)).max())
