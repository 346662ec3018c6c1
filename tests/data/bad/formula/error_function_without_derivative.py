# 6: inverse(): loop of ufunc does not support argument 0 of type symbol which has no callable log10 method: twin cannot differentiate this
import numpy as np


def inverse(pose):
    x = np.log10(pose[0, 3])
    return x, pose[1, 3]
