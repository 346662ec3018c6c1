"""Draw the left arm of the Raven-II at home, with roll, wrist and jaws at zero; the origin of the world is the RCM."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    import raven  # imported here, because build123d takes seconds

    return raven.assembly(path, "left")


if __name__ == "__main__":
    cad.command("raven_left", HERE, assembly)
