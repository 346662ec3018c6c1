# 5: TypeError: '135' is not a number; write a number such as 135.0
from twin.formula import mm

PARAMETERS = {
    "a": mm("135"),
}


def inverse(pose, a):
    return pose[0, 3] - a, pose[1, 3]
