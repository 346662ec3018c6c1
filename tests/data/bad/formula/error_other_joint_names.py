# 3: inverse() returns names that differ from the active joints q1, q2: 'q2' is missing, 'q3' is unknown
def inverse(pose):
    return {"q1": pose[0, 3], "q3": pose[1, 3]}
