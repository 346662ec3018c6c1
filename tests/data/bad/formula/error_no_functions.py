# it defines no FORMULA and no plain functions: write inverse(pose), forward(q) or both
def ik(pose):
    return pose[0, 3], pose[1, 3]
