# 4: PARAMETERS must be a dictionary by name
from twin.formula import mm

PARAMETERS = [mm(20)]


def inverse(pose):
    return pose[0, 3], pose[1, 3]
