# 4: inverse(): 'q1' has shape (3,); it must be a number
def inverse(pose):
    p = pose[:3, 3]
    return p, p[1]
