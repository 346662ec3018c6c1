"""Draw the props of the scene davinci: table, patient with a peg board inside, and the surgeon's cart.

Table and patient are drawn as in the scene vsrs, with other ports. The cart is drawn in its own frame and then placed.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad

BODIES = ["table", "patient", "board", "cart"]


def assembly(path):
    """Draw the theatre with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d = cad.Dimensions(path, {})
    theatre, own = cad.parts(HERE.parent / "vsrs"), cad.parts(HERE)
    solids = {
        "table": theatre.table(d),
        "patient": theatre.patient(d),
        "board": own.board(d),
        "cart": own.cart(d),
    }
    c, s = np.cos(np.radians(d.cart_turn)), np.sin(np.radians(d.cart_turn))
    where = dict.fromkeys(BODIES, np.eye(4))
    where["cart"] = cad.pose4(d.cart_at, (c, s, 0), (-s, c, 0), (0, 0, 1))
    return cad.build(BODIES, solids, where, theatre.MATERIALS | own.MATERIALS)


if __name__ == "__main__":
    cad.command("davinci", HERE, assembly)
