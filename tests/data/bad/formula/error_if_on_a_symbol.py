# 4: inverse(): `if`, `and`, `not`, max() and sorted() do not work on values that depend on the pose or the joints. Write if_else(condition, yes, no) of twin.formula
def inverse(pose):
    x = pose[0, 3]
    if x > 0:
        x = -x
    return x, pose[1, 3]
