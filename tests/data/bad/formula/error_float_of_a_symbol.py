# 3: inverse(): a plain number is needed, but this value depends on the pose or the joints: remove float()
def inverse(pose):
    x = float(pose[0, 3])
    return x, pose[1, 3]
