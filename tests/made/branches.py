"""Inverse equations of planar arms of two and three links, right ones and some with a wrong branch."""

from __future__ import annotations

from made.arm import LINK

TWO = """
from casadi import acos, asin, atan, atan2, cos, fabs, if_else, pi, sin, sqrt

def inverse(pose):
    c = atan2(pose[1, 0], pose[0, 0])
    x = pose[0, 3] - {link} * cos(c)
    y = pose[1, 3] - {link} * sin(c)
    q = [{first}, None]
    q[1] = {second}
    {error}
    return q[0], q[1]
"""

THREE = """
from casadi import acos, asin, atan, atan2, cos, fabs, if_else, pi, sin, sqrt

def inverse(pose):
    c = atan2(pose[1, 0], pose[0, 0])
    x = pose[0, 3] - {link} * cos(c)
    y = pose[1, 3] - {link} * sin(c)
    elbow = (x**2 + y**2) / (2 * {link}**2) - 1
    q2 = {elbow}
    q1 = atan2(y, x) - atan2(sin(q2), 1 + cos(q2))
    q = [q1, q2, c - q1 - q2]
    {error}
    return q[0], q[1], q[2]
"""

RIGHT = [
    (TWO, {"first": "atan2(y, x)", "second": "c - q[0]"}),
    (TWO, {"first": "2 * atan(y / (sqrt(x**2 + y**2) + x))", "second": "c - q[0]"}),
    (TWO, {"first": "if_else(x > 0, atan(y / x), atan2(y, x))", "second": "atan2(sin(c - q[0]), cos(c - q[0]))"}),
    (TWO, {"first": "atan2(y, x)", "second": "c - q[0] + 2 * pi"}),
    (THREE, {"elbow": "acos(elbow)"}),
    (THREE, {"elbow": "-acos(elbow)"}),
    (THREE, {"elbow": "atan2(sqrt(1 - elbow**2), elbow)"}),
]

WRONG = {  # what is wrong, and the fraction of the range in which it is
    "atan for atan2": (TWO, {"first": "atan(y / x)", "second": "c - q[0]"}, 0.40),
    "asin for atan2": (TWO, {"first": f"asin(y / {LINK})", "second": "c - q[0]"}, 0.40),
    "no sign": (TWO, {"first": "fabs(atan2(y, x))", "second": "c - q[0]"}, 0.50),
    "acos for atan2": (TWO, {"first": f"acos(x / {LINK})", "second": "c - q[0]"}, 0.50),
    "one elbow": (TWO, {"first": "atan2(y, x)", "second": "fabs(c - q[0])"}, 0.50),
    "asin of the elbow": (THREE, {"elbow": "asin(sqrt(1 - elbow**2))"}, 0.40),
    "no sign of the elbow": (THREE, {"elbow": "acos(fabs(elbow))"}, 0.40),
}
