# 3: points(): 'tip' has shape (2,); it must be three numbers
def points(pose):
    return {"tip": pose[:2, 3]}


def inverse(pose):
    return pose[0, 3], pose[1, 3]
