# 6: inverse(): `if`, `and` and `not` do not work on values that depend on the pose or the joints. Write casadi.if_else(condition, yes, no)
import casadi as ca


def inverse(pose):
    x = pose[0, 3] if pose[0, 3] > 0 else 0
    return ca.fabs(x), pose[1, 3]
