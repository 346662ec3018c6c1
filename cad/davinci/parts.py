"""The board with pegs inside the patient, in the world frame, for the ring transfer task; and the surgeon's cart."""

from math import cos, radians, sin

import surgeons_cart
from build123d import Plane, Solid
from shapes import pin
from surgeons_cart import cart

__all__ = ["MATERIALS", "board", "cart"]
MATERIALS = surgeons_cart.MATERIALS | {  # sRGB, density in kg/m3
    "board": ((0.42, 0.45, 0.50), 1100),
    "peg": ((0.93, 0.90, 0.84), 1100),
    "peg_left": ((0.16, 0.42, 0.78), 1100),
    "peg_right": ((0.86, 0.62, 0.10), 1100),
}


def board(d):
    """Draw the floor and the wall of the board; rings are moved from the wall's pegs to the floor's two pegs."""
    x, y, top = d.board_at
    w, h, thick = d.board_half_x, d.board_half_y, d.board_high
    face = y + h - thick  # of the wall
    floor = Solid.make_box(2 * w, 2 * h, thick, Plane(origin=(x - w, y - h, top - thick)))
    wall = Solid.make_box(2 * w, thick, d.wall_high, Plane(origin=(x - w, face, top)))
    pins = []
    rise, out = sin(radians(d.wall_peg_tilt)), cos(radians(d.wall_peg_tilt))
    for j, row in enumerate(("low", "high")):
        for i in range(6):
            foot = (x + (i - 2.5) * d.wall_peg_pitch, face + d.peg_inside, top + d.wall_row + j * d.wall_row_pitch)
            long = d.wall_peg_long + d.peg_inside
            end = (foot[0], foot[1] - long * out, foot[2] + long * rise)
            pins.append((f"peg_{row}{i + 1}", pin(foot, end, d.peg_radius), "peg"))
    for side, s in (("left", -1), ("right", 1)):
        at = (x + s * d.floor_peg_apart / 2, y + d.floor_peg_y)
        ends = (*at, top - d.peg_inside), (*at, top + d.floor_peg_high)
        pins.append((f"peg_{side}", pin(*ends, d.peg_radius), f"peg_{side}"))
    return [("floor", floor, "board"), ("wall", wall, "board"), *pins]
