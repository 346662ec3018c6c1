# 3: inverse(): a plain number is needed here, but this depends on the pose or the joints: leave float()
def inverse(pose):
    x = float(pose[0, 3])
    return x, pose[1, 3]
