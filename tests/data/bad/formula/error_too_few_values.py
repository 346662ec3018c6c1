# 2: inverse() returns 1 value for the 2 active joints q1, q2, in the order of the robot's TOML file
def inverse(pose): return [pose[0, 3]]
