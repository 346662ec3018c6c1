# 7: forward(): 'T_base_tool' has shape (3, 3); it must be a pose (4, 4)
import numpy as np


def forward(q):
    R = np.eye(3)
    return R * q[0]
