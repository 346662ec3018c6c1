# 8: inverse(): 'q2' is nan at every pose
import numpy as np

OFFSET = np.nan


def inverse(pose):
    return pose[0, 3], pose[1, 3] + OFFSET
