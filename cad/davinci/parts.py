"""A board with pegs inside the patient, in the world frame: what the two instruments are moved over. And the cart."""

import surgeons_cart
from build123d import Axis, Plane, Solid
from surgeons_cart import cart

__all__ = ["MATERIALS", "board", "cart"]
MATERIALS = surgeons_cart.MATERIALS | {  # sRGB, density in kg/m3
    "board": ((0.80, 0.36, 0.30), 1100),
    "peg": ((0.95, 0.80, 0.35), 1100),
}


def board(d):
    """Plate with rounded edges, and pegs in rows; those of a row are `peg_pitch` apart."""
    x, y, top = d.board_at
    w, h = d.board_half_x, d.board_half_y
    plate = Solid.make_box(2 * w, 2 * h, d.board_high, Plane(origin=(x - w, y - h, top - d.board_high)))
    plate = plate.fillet(8, plate.edges().filter_by(Axis.Z))
    pegs = []
    for j in (-1, 0, 1):
        for i in (-1.5, -0.5, 0.5, 1.5):
            at = (x + i * d.peg_pitch, y + j * d.peg_pitch, top)
            peg = Solid.make_cylinder(d.peg_radius, d.peg_high, Plane(origin=at))
            pegs.append(peg.fillet(0.8 * d.peg_radius, peg.edges().group_by(Axis.Z)[-1]))
    return [("plate", plate, "board"), *((f"peg{k}", p, "peg") for k, p in enumerate(pegs, 1))]
