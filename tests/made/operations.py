"""One expression of each operation that kernels compute, and numbers at which operations are special."""

from __future__ import annotations

import casadi as ca
import numpy as np

a, b = ca.SX.sym("a"), ca.SX.sym("b")

OPERATIONS = {
    "add": a + b,
    "sub": a - b,
    "mul": a * b,
    "div": a / b,
    "neg": -a,
    "sq": a * a,
    "twice": 2 * a,
    "inv": 1 / a,
    "sqrt": ca.sqrt(a),
    "fabs": ca.fabs(a),
    "floor": ca.floor(a),
    "ceil": ca.ceil(a),
    "sign": ca.sign(a),
    "copysign": ca.copysign(a, b),
    "fmin": ca.fmin(a, b),
    "fmax": ca.fmax(a, b),
    "sin": ca.sin(a),
    "cos": ca.cos(a),
    "tan": ca.tan(a),
    "asin": ca.asin(a),
    "acos": ca.acos(a),
    "atan": ca.atan(a),
    "atan2": ca.atan2(a, b),
    "sin of atan2": ca.sin(ca.atan2(a, b)),
    "cos of atan2": ca.cos(ca.atan2(a, b)),
    "hypot": ca.hypot(a, b),
    "exp": ca.exp(a),
    "log": ca.log(a),
    "pow": a**b,
    "constpow": a**2.5,
    "sinh": ca.sinh(a),
    "cosh": ca.cosh(a),
    "tanh": ca.tanh(a),
    "lt": a < b,
    "le": a <= b,
    "eq": a == b,
    "ne": a != b,
    "not": ca.logic_not(a > 0),
    "and": ca.logic_and(a > 0, b > 0),
    "or": ca.logic_or(a > 0, b > 0),
    "if_else": ca.if_else(a > b, a, 3.0),
}

BY_SQUARES = ("hypot", "sin of atan2", "cos of atan2")
ODD = [0.0, -0.0, 1.0, -1.0, np.nan, np.pi, -np.pi / 2, 1e-300, 1e6, -1e6, 0.5, 2.0]
