# 2: inverse() takes its arguments by name: replace '*args' by names
def inverse(*args):
    return args[0][0, 3], 0.0
