# 4: ValueError: provenance 'PAPER' is not known; write PUBLISHED (printed in the paper), CITED, DERIVED or ASSUMED
from twin.formula import mm

PARAMETERS = {"a": mm(135, "PAPER", "Table 1")}


def inverse(pose, a):
    return pose[0, 3] - a, pose[1, 3]
