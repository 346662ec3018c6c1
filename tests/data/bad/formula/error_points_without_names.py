# 3: points() must return a dictionary of named points, not list
def points(pose):
    return [pose[:3, 3]]


def inverse(pose):
    return pose[0, 3], pose[1, 3]
