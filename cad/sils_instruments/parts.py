"""Parts of the SILS platform with two instruments; the other bodies are those of `cad/sils`.

The bodies of an instrument are drawn in its frame (mm), with lean and swing at zero and the shaft at the drawn depth:
    cradleN      shoe on the arc of the platform, turns about y; carries the second arc
    guideN       shoe on the second arc, turns about x; carries the rod
    instrumentN  slide on the rod with module, motors, shaft and jaws, moves along -z
"""

from math import radians, sin
from pathlib import Path

import drawing as cad
import numpy as np
from build123d import Location, Plane
from shapes import METAL_AND_PLASTIC, X, Y, Z, box, cyl, hull, pipe, prism

MATERIALS = METAL_AND_PLASTIC


def _sils():
    """Return the parts of the robot without instruments."""
    return cad.parts(Path(__file__).resolve().parents[1] / "sils")


def arc(axis, start, width, inner, outer, first, last):
    """Return a segment of a ring about the RCM, from `start` along `axis` (X or Y) for `width`.

    The angles `first` and `last` in degrees are from z: about y, positive towards x; about x, positive towards -y.
    """
    far = 2 * outer
    corners = [(0.0, 0.0)]
    for angle in np.radians(np.linspace(first, last, 5)):
        corners.append((far * np.sin(angle), far * np.cos(angle)))
    if axis == Y:
        begin = (0, start, 0)
        plane = Plane(origin=(0, start - 1, 0), x_dir=X, z_dir=(0, -1, 0))
    else:
        begin = (start, 0, 0)
        plane = Plane(origin=(start - 1, 0, 0), x_dir=(0, -1, 0), z_dir=(-1, 0, 0))
    wedge = prism(corners[::-1], -(width + 2), plane)
    return pipe(begin, axis, inner, outer, width) & wedge


def platform(d, frames):
    """Draw the platform with a slot and an arc for each instrument; `frames` are their poses (4, 4), by number."""
    plate, out = _sils().bare_platform(d, d.error("platform"))
    for n, T in frames.items():
        where = Location(Plane(origin=tuple(T[:3, 3]), x_dir=tuple(T[:3, 0]), z_dir=tuple(T[:3, 2])))
        plate -= _slot(d).moved(where)
        far = -d.lean_near - d.arc_width
        rail = arc(Y, far, d.arc_width, d.lean_radius - d.arc_height, d.lean_radius, d.lean_from, d.lean_to)
        low = d.instrument_rcm - 14.0
        foot = box(-12, 12, far, -d.lean_near, low, d.lean_radius - d.arc_height / 2)
        # the flat that is the zero of the lean: on the foot, beside the arc
        index = box(-6, 6, far - 6, far + 1, low + 4, low + 12)
        out.append((f"arc{n}_rail", (rail + foot).moved(where), "steel"))
        out.append((f"arc{n}_index", index.moved(where), "orange_plastic"))
    return [("plate", plate, "blue_aluminium"), *out]


def _slot(d):
    """Return the room of a shaft in the plate, at all angles of lean and swing."""
    height = d.instrument_rcm - 20.0
    inner, outer, side = (height * sin(radians(a)) for a in (-3.0, 10.0, 8.0))
    r = d.tool_radius + d.shaft_slot
    corners = [(inner, -side, r), (outer, -side, r), (outer, side, r), (inner, side, r)]
    return hull(corners, Plane(origin=(0, 0, height - 25)), 50)


def cradle(d):
    """Draw the shoe on the arc of the platform, with the second arc."""
    far = -d.lean_near - d.arc_width
    low, high = d.lean_radius + d.shoe_gap, d.lean_radius + d.shoe_height
    half = d.shoe_half
    shoe = arc(Y, far, d.arc_width, low, high, -half, half)
    cheek = arc(Y, far - d.cheek, d.cheek, d.lean_radius - d.arc_height, high, -half, half)
    inner = d.swing_radius - d.arc_height
    back = -d.swing_near - d.arc_width
    rail = arc(X, back, d.arc_width, inner, d.swing_radius, -d.swing_reach, d.swing_reach)
    riser = box(back, 4 - d.swing_near, far, -d.lean_near, high - 3, inner)
    index = box(back - 6, back + 1, -6, 6, inner - 2, inner + 6)
    return [
        ("shoe", shoe + cheek, "grey_aluminium"),
        ("arc", rail + riser, "steel"),
        ("index", index, "orange_plastic"),
        ("motor", cyl((4, far + d.arc_width / 2, high - 1), Z, 3.5, 12), "dark_steel"),
    ]


def guide(d):
    """Draw the shoe on the second arc, with the guide rod of the slide."""
    low, high = d.swing_radius + d.shoe_gap, d.swing_radius + d.shoe_height
    half = d.shoe_half
    back = -d.swing_near - d.arc_width
    shoe = arc(X, back, d.arc_width, low, high, -half, half)
    cheek = arc(X, back - d.cheek, d.cheek, d.swing_radius - 3.0, high, -half, half)
    rod = cyl((-d.rod_at, 0, high - 4), Z, d.rod_radius, d.rod_end - high + 4)
    top = d.rod_radius + 2
    rod -= box(-d.rod_at - top, -d.rod_at - d.rod_flat, -top, top, high + 1, d.rod_end + 1)
    return [
        ("shoe", shoe + cheek, "grey_aluminium"),
        ("rod", rod, "steel"),
        ("motor", cyl((back + d.arc_width / 2, 10, high - 8), Z, 3.5, 14), "dark_steel"),
    ]


def instrument(d):
    """Draw slide, module, motors, shaft and jaws at the drawn depth."""
    end = -d.instrument_depth  # of the shaft
    base = end + d.shaft_length
    r, length = d.module_radius, d.module_length
    g = d.module_groove
    body = cyl((0, 0, base), Z, r, length)
    for z in (d.module_groove_low, d.module_groove_high):
        body -= pipe((0, 0, base + z), Z, r - g / 2, r + 1, g)
    motors = cyl((0, 0, base + length), Z, r, d.motor_plate)
    for k in range(3):
        b = radians(90 + 120 * k)
        at = (d.motor_circle * np.cos(b), d.motor_circle * np.sin(b), base + length)
        motors += cyl(at, Z, d.motor_radius, d.motor_plate + d.motor_length)
    low = base + d.slide_foot
    high = low + d.slide_height
    block = box(-d.rod_at - d.slide_half, 0, -d.slide_half, d.slide_half, low, high)
    block -= cyl((0, 0, low - 1), Z, r, d.slide_height + 2)
    block -= cyl((-d.rod_at, 0, low - 1), Z, d.slide_liner, d.slide_height + 2)
    edge = d.rod_flat + d.flat_gap
    hole = cyl((-d.rod_at, 0, low - 1), Z, d.rod_radius + d.bore_gap, d.slide_height + 2)
    hole -= box(-d.rod_at - 10, -d.rod_at - edge, -10, 10, low - 2, high + 2)
    liner = cyl((-d.rod_at, 0, low), Z, d.slide_liner, d.slide_height) - cyl((0, 0, low - 1), Z, r, d.slide_height + 2)
    shaft = cyl((0, 0, end), Z, d.tool_radius, d.shaft_length)
    return [
        ("module", body, "white_plastic"),
        ("motors", motors, "dark_steel"),
        ("slide", block, "grey_aluminium"),
        ("liner", liner - hole, "bronze"),
        ("shaft", shaft, "steel"),
        *_jaws(d, end),
    ]


def _jaws(d, end):
    """Return both jaws below the end of the shaft, half open."""
    jaws = []
    w = d.jaw_width / 2
    for k, way in enumerate((1, -1), 1):
        plane = Plane(origin=(0, -w, end), x_dir=(0, 0, -1), z_dir=Y)
        corners = [(d.jaw_gap, w), (d.jaw_gap, 0), (d.jaw_length, 0), (d.jaw_length, w / 2)]
        jaw = prism(corners, d.jaw_width, plane).moved(Location((0, 0, 0), (0, 0, 0 if way > 0 else 180)))
        hinge = Location((0, 0, end)) * Location((0, 0, 0), (0, way * d.jaw_open, 0)) * Location((0, 0, -end))
        jaws.append((f"jaw{k}", jaw.moved(hinge), "steel"))
    return jaws
