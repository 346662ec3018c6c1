# 3: SyntaxError: invalid syntax
def inverse(pose):
    return pose[0, 3],, pose[1, 3]
