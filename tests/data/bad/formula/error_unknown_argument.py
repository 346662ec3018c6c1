# 5: inverse() uses 'poes'; there is no symbol 'poes'. Did you mean 'pose'?
import numpy as np


def inverse(poes):
    return poes[0, 3], poes[1, 3]
