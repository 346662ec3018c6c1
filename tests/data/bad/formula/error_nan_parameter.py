# 4: ValueError: nan is not a finite number
from twin.formula import mm

PARAMETERS = {"a": mm(float("nan"))}


def inverse(pose, a):
    return pose[0, 3] - a, pose[1, 3]
