# 6: inverse(): ValueError: matmul
import numpy as np


def turned(R, p):
    return R @ p


def inverse(pose):
    p = turned(pose[:3, :3], np.array([1.0, 2.0]))
    return p[0], p[1]
