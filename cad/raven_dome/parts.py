"""The dome with half of its lid cut away, its floor, the tower and the wire, with the middle of the floor as origin."""

from itertools import pairwise

import numpy as np
from build123d import Face, Plane, Shell, Solid, Wire
from shapes import pin

__all__ = ["MATERIALS", "dome", "floor", "tower", "wire"]
MATERIALS = {  # sRGB, density in kg/m3
    "shell": ((0.78, 0.80, 0.84), 1100),
    "floor": ((0.42, 0.45, 0.50), 1100),
    "tower": ((0.93, 0.90, 0.84), 1100),
    "wire": ((0.16, 0.42, 0.78), 7850),
}
_SECTORS, _LOW, _LID = 16, 2, 3  # panels around the dome, rows of panels below the lid and in it
_PIECES = 20  # straight pieces of the wire


def floor(d):
    """Draw the floor, a disc below the dome."""
    return [("disc", Solid.make_cylinder(d.inner + d.wall, d.wall, Plane(origin=(0, 0, -d.wall))), "floor")]


def dome(d):
    """Draw the hemisphere of flat panels, without the half of the lid at y < 0.

    Flat panels are convex, so that what can be touched is exactly what is drawn.
    """
    count, edge = _SECTORS, 90 - d.lid
    rows = [*np.linspace(0, edge, _LOW + 1), *np.linspace(edge, 90, _LID + 1)[1:]]
    out = []
    for i, (low, high) in enumerate(pairwise(np.radians(rows))):
        for k in range(count if i < _LOW else count // 2):
            a, b = np.radians([k, k + 1]) * 360 / count
            corners = [(low, a), (low, b), (high, b), *([(high, a)] if i < _LOW + _LID - 1 else [])]
            out.append((f"panel{i + 1}_{k + 1}", _panel(corners, d.inner, d.inner + d.wall), "shell"))
    return out


def _panel(corners, inner, outer):
    """Return the plate between two spheres whose corners have the given (latitude, azimuth)."""
    ways = [np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) for e, a in corners]
    low, high = ([tuple(r * w) for w in ways] for r in (inner, outer))
    sides = [(low[i], low[j], high[j], high[i]) for i, j in ((k, (k + 1) % len(ways)) for k in range(len(ways)))]
    faces = [Face(Wire.make_polygon(points)) for points in (low[::-1], high, *sides)]
    return Solid(Shell(faces))


def tower(d):
    """Draw the tower with the pocket in which the ring stands upright, its axis along x."""
    x, y, _ = d.tower_at
    high, wall, deep = d.tower_high, d.pocket_wall, d.pocket_deep
    a, b = d.pocket_wide / 2, d.pocket_long / 2
    post = Solid.make_cylinder(d.tower_radius, high - wall, Plane(origin=(x, y, 0)))
    out = [("post", post, "tower"), ("bottom", _box(x, y, (-a, a), (-b, b), (high - wall, high)), "tower")]
    top = high - wall, high + deep
    for name, s in (("left", -1), ("right", 1)):
        sides = sorted((s * a, s * (a + wall)))
        out.append((name, _box(x, y, sides, (-b - wall, b + wall), top), "tower"))
    for name, s in (("front", -1), ("back", 1)):
        out.append((name, _box(x, y, (-a, a), sorted((s * b, s * (b + wall))), top), "tower"))
    return out


def _box(x, y, along, across, high):
    """Return a box about (x, y) with its ends along x, along y and in height."""
    corner = Plane(origin=(x + along[0], y + across[0], high[0]))
    return Solid.make_box(along[1] - along[0], across[1] - across[0], high[1] - high[0], corner)


def wire(d):
    """Draw the wire from its free end, in straight pieces, and the post at its other end.

    Its direction turns to both sides by a sine of its length: two loops, side by side.
    """
    s = (np.arange(_PIECES) + 0.5) / _PIECES
    turn = np.radians(d.wire_turn) * np.sin(2 * np.pi * s)
    steps = d.wire_long / _PIECES * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    p = np.concatenate([[d.wire_at], d.wire_at + np.cumsum(steps, axis=0)])
    # a pin starts inside of the one before: the ends of both are round about the same point
    r = d.wire_radius
    pieces = []
    for i, (a, b) in enumerate(pairwise(p)):
        way = (b - a) / np.linalg.norm(b - a)
        pieces.append((f"piece{i + 1:02}", pin(tuple(a), tuple(b + r * way), r), "wire"))
    post = Solid.make_cylinder(r, p[-1][2], Plane(origin=(p[-1][0], p[-1][1], 0)))
    return [*pieces, ("post", post, "wire")]
