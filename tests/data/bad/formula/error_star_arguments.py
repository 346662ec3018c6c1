# 2: inverse() must have named arguments: replace '*args' by names
def inverse(*args):
    return args[0][0, 3], 0.0
