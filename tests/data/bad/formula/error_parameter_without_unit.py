# 5: PARAMETERS['b'] = 50.0 has no unit: write mm(50.0), m(50.0), deg(50.0), rad(50.0) or number(50.0)
from twin.formula import mm
PARAMETERS = {
    "a": mm(20),
    "b": 50.0,
}


def inverse(pose, a, b):
    return pose[0, 3] / a * b, pose[1, 3]
