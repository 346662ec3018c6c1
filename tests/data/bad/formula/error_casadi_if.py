# 6: inverse(): `if`, `and`, `not` need to know now whether this is true, but it depends on the pose or the joints. Write casadi.if_else(condition, yes, no)
import casadi as ca


def inverse(pose):
    x = pose[0, 3] if pose[0, 3] > 0 else 0
    return ca.fabs(x), pose[1, 3]
