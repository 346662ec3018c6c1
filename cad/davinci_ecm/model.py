"""Draw the endoscope arm of the da Vinci Classic.

Yaw, pitch and roll are drawn at zero, the endoscope inserted by `insertion`. The origin of the world is the RCM.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    # imported here, because build123d takes seconds
    import davinci_classic as classic
    from davinci import assembly as arm

    sliding = cad.parts(HERE)

    return arm(path, (classic, sliding), lambda d: classic.places(d) | sliding.places(d), classic.ERRORS)


if __name__ == "__main__":
    cad.command("davinci_ecm", HERE, assembly)
