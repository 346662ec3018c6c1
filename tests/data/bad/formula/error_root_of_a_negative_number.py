# 10: inverse(): invalid value encountered in sqrt: a root or arc function is out of range
import numpy as np

from twin.formula import mm

PARAMETERS = {"a": mm(20), "b": mm(50)}


def inverse(pose, a, b):
    c = np.sqrt(a**2 - b**2)
    return pose[0, 3] - c, pose[1, 3]
