"""A planar five-bar with two motors on the base and unequal links; the hand is the pin where the forearms meet."""

import numpy as np

from twin.formula import mm

PARAMETERS = {
    "d": mm(80.0, "ASSUMED", "half distance of the motors"),
    "l_1": mm(150.0, "ASSUMED", "left upper arm"),
    "l_2": mm(205.0, "ASSUMED", "left forearm"),
    "m_1": mm(160.0, "ASSUMED", "right upper arm"),
    "m_2": mm(190.0, "ASSUMED", "right forearm"),
}


def elbow(u, v, upper, fore):
    rho = np.sqrt(u**2 + v**2)
    return np.arccos((upper**2 + rho**2 - fore**2) / (2 * upper * rho))


def inverse(pose, d, l_1, l_2, m_1, m_2):
    x, y = pose[0, 3], pose[1, 3]
    q1 = np.arctan2(y, x + d) + elbow(x + d, y, l_1, l_2)
    q2 = np.arctan2(y, x - d) - elbow(x - d, y, m_1, m_2)
    return q1, q2
