"""Check a certificate of `twin prove --bounds` without twin: only Python's standard library is used.

    python docs/check_bounds.py certificate.json [FOLDER]

FOLDER contains the files of equations and mechanism; if it is given, their hashes are compared. The poses of both sides
are expanded again, as sums of products of e^(i angle) of the joints, and of numbers from -1 to 1 for lengths. Equal
terms cancel; what remains is at most the sum of its magnitudes. Every coefficient has a bound of its error. The exit
code is 0 if the bounds hold, 1 if not, 2 if the certificate cannot be read or was changed. Bounds are those within the
ranges of lengths in "variables"; the tolerance that the certificate names is not compared with them.
"""

from __future__ import annotations

import cmath
import hashlib
import json
import math
import sys
from pathlib import Path
from typing import NamedTuple

SCHEMA = "twin/bounds-certificate/1"
UNIT = 2.0**-49  # relative rounding error of an operation on complex numbers, with a margin
MANY = 1500  # terms of the coordinates of a vector that are squared one by one; the others are small
SLACK = 1.01  # for that, and because errors are bounded in another order
ROUNDING = 1e-10  # m or rad: bounds of what is zero but for rounding
BASE = 2**20  # the exponent of each variable is a digit of a key
IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]


def main(arguments):
    """Check the certificate and print a line for each bound; return the exit code."""
    try:
        data = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
        check_content(data)
        for name, expected in data["files"].items() if len(arguments) > 1 else ():
            if hashlib.sha256((Path(arguments[1]) / name).read_bytes()).hexdigest() != expected:
                raise ValueError(f"{name} is not the file that was bounded")
        found = check(data)
        claimed = [float(data["position_m"]), float(data["rotation_rad"])]
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        print(f"the certificate cannot be checked: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    fails = False
    for what, limit, own in zip(("origins, in m,", "orientations, in rad,"), claimed, found, strict=True):
        holds = own <= limit * SLACK + ROUNDING
        fails |= not holds
        print(f"{'holds' if holds else 'FAILS'}: {what} of the tool differ by at most {limit:.6g}; found {own:.6g}")
    return int(fails)


def check_content(data):
    """Raise an error if the certificate is not as it was written."""
    if data["schema"] != SCHEMA:
        raise ValueError(f"schema {data['schema']!r} is not {SCHEMA}")
    text = json.dumps({k: v for k, v in data.items() if k != "sha256"}, sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode("ascii")).hexdigest() != data["sha256"]:
        raise ValueError("its content does not have the SHA-256 that it states")


def check(data):
    """Return upper bounds of the distance of the tool's origins in m, and of the angle of its orientations in rad."""
    variables, sides, poses = data["variables"], data["sides"], []
    known = {variable["name"]: symbol(variable, place) for place, variable in enumerate(variables)}
    if len(known) != len(variables) or len(sides) != 2:
        raise ValueError("two variables have one name, or there are not two sides")
    for side in sides:
        if "rows" in side:
            values = evaluated(side["rows"], known)
            if known.keys() & side["joints"].keys():
                raise ValueError("a side gives a value to a joint that is a variable")
            known = {**known, **{name: values[i] for name, i in side["joints"].items()}}
            poses.append([[as_sum(values[i]) for i in row] for row in side["pose"]])
        else:
            poses.append(chain(side["chain"], known))
    difference = [[poses[0][i][j] + -poses[1][i][j] for j in range(4)] for i in range(3)]
    lengths = [place for place, variable in enumerate(variables) if not variable["angle"]]
    position = length_bound([row[3] for row in difference], lengths)
    # the root of the sum of squares of the entries is 2 sqrt(2) sin(angle / 2)
    sine = root_of_squares([entry for row in difference for entry in row[:3]]) / (2 * math.sqrt(2))
    return position, 2 * math.asin(min(sine, 1.0)) * (1 + UNIT)


def symbol(variable, place):
    """Return a variable: an angle, or a number from low to high."""
    if variable["angle"]:
        return Angle({place: 1}, 0.0, 0.0)
    low, high = variable["low"], variable["high"]
    if not -math.inf < low <= high < math.inf:
        raise ValueError(f"the range of {variable['name']} is {low} to {high}")
    middle, spread = 0.5 * (low + high), 0.5 * (high - low)
    radius = (abs(middle) + abs(spread)) * UNIT
    return Sum({0: (complex(middle), radius), BASE**place: (complex(spread), radius)}, 1)


class Angle(NamedTuple):
    """A whole multiple of each of some joint angles, plus a phase that is known within a radius."""

    multiples: dict
    phase: float
    radius: float

    def plus(self, other):
        """Return the sum."""
        places = {*self.multiples, *other.multiples}
        multiples = {place: self.multiples.get(place, 0) + other.multiples.get(place, 0) for place in places}
        phase = self.phase + other.phase
        return Angle(multiples, phase, self.radius + other.radius + abs(phase) * UNIT)

    def times(self, factor):
        """Return a whole multiple."""
        multiples = {place: factor * multiple for place, multiple in self.multiples.items()}
        return Angle(multiples, factor * self.phase, abs(factor) * (self.radius + abs(self.phase) * UNIT))

    def wave(self, sine):
        """Return its cosine or its sine: (e^(ix) + e^(-ix)) / 2, or the same at x less a quarter of a turn."""
        degree = max(map(abs, self.multiples.values()), default=0)
        if degree > 15:
            raise ValueError(f"{degree} times a joint angle")
        half = 0.5 * cmath.exp(1j * self.phase) * (-1j if sine else 1)
        radius = 0.5 * self.radius + 4 * UNIT
        key = sum(BASE**place * multiple for place, multiple in self.multiples.items())
        return Sum({key: (half, radius)}, degree) + Sum({-key: (half.conjugate(), radius)}, degree)


class Sum(dict):
    """Terms {exponents of all variables, as digits: (coefficient, a bound of its error)}, up to a degree."""

    def __init__(self, terms=(), degree=0):
        super().__init__(terms)
        self.degree = degree
        if degree > 1000:  # at BASE / 2, it would be taken for the exponent of the next variable
            raise ValueError(f"a variable to the power of {degree}")

    def __neg__(self):
        return Sum({key: (-centre, radius) for key, (centre, radius) in self.items()}, self.degree)

    def __add__(self, other):
        terms = Sum(self, max(self.degree, other.degree))
        for key, (centre, radius) in other.items():
            terms.put(key, centre, radius)
        return terms

    def __mul__(self, other):
        terms = Sum(degree=self.degree + other.degree)
        for key, (a, ra) in self.items():
            for other_key, (b, rb) in other.items():
                radius = (abs(a) * rb + ra * (abs(b) + rb)) * (1 + UNIT) + UNIT * abs(a) * abs(b)
                terms.put(key + other_key, a * b, radius)
        return terms

    def put(self, key, centre, radius):
        """Add a term."""
        before, spread = self.get(key, (0j, 0.0))
        self[key] = before + centre, (spread + radius) * (1 + UNIT) + UNIT * (abs(before) + abs(centre))


def number(value, radius=0.0):
    """Return a constant."""
    return Sum({0: (complex(value), radius)})


def as_sum(value):
    """Return a constant angle as a number; a sum as it is."""
    return number(*constant(value, "an angle is used as a number")) if isinstance(value, Angle) else value


def as_angle(value):
    """Return a constant as an angle; an angle as it is."""
    return value if isinstance(value, Angle) else Angle({}, *constant(value, "a sine of a length or of a sine"))


def constant(value, otherwise):
    """Return (number, bound of its error); raise an error for what depends on a variable."""
    if depends(value):
        raise ValueError(otherwise)
    return (value.phase, value.radius) if isinstance(value, Angle) else (value[0][0].real, value[0][1])


def depends(value):
    """Return whether a value depends on a variable."""
    return any(value.multiples.values()) if isinstance(value, Angle) else set(value) != {0}


def evaluated(rows, known):
    """Return the values of the operations of the equations."""
    values = []
    for name, *operands in rows:
        if name == "number":
            values.append(number(float(operands[0]), abs(float(operands[0])) * UNIT))
        elif name == "variable":
            values.append(known[operands[0]])
        elif all(0 <= i < len(values) for i in operands):
            values.append(applied(name, *(values[i] for i in operands)))
        else:
            raise ValueError(f"row {len(values)} needs a row that is not there yet")
    return values


def applied(name, a, b=None):
    """Return the result of an operation."""
    if name in ("cosine", "sine"):
        return as_angle(a).wave(name == "sine")
    if name == "negative":
        return a.times(-1) if isinstance(a, Angle) else -a
    if name == "add":
        return as_angle(a).plus(as_angle(b)) if Angle in (type(a), type(b)) else a + b
    if name == "inverse":
        value, radius = constant(a, "a division by what depends on a variable")
        if abs(value) <= radius:
            raise ValueError("a division by a number that may be 0")
        spread = radius / (abs(value) * (abs(value) - radius))
        return number(1 / value, (spread + abs(1 / value) * UNIT) * (1 + UNIT))
    if name != "multiply":
        raise ValueError(f"operation {name!r} is unknown")
    for factor, other in ((a, b), (b, a)):
        if isinstance(other, Angle) and depends(other):
            value, radius = constant(factor, "an angle times what depends on a variable")
            if value != round(value) or radius > abs(value) * UNIT:
                raise ValueError("a multiple of an angle that is no whole number")
            return other.times(round(value))
    return as_sum(a) * as_sum(b)


def chain(steps, joints):
    """Return the pose of the tool: the product of the frames and of the motions of joints along a chain."""
    pose = frame(IDENTITY, False)
    for kind, value in steps:
        B = motion(joints[value], kind) if kind in ("turn", "slide") else frame(value, {"frame": 0, "inverse": 1}[kind])
        A = pose
        pose = [[A[i][0] * B[0][j] + A[i][1] * B[1][j] + A[i][2] * B[2][j] for j in range(4)] for i in range(3)]
        for i in range(3):
            pose[i][3] = pose[i][3] + A[i][3]
    return pose


def motion(value, kind):
    """Return the motion of a joint about z ("turn"), or along z ("slide")."""
    pose = frame(IDENTITY, False)
    if kind == "slide":
        pose[2][3] = as_sum(value)
        return pose
    pose[0][0] = pose[1][1] = as_angle(value).wave(False)
    pose[1][0] = as_angle(value).wave(True)
    pose[0][1] = -pose[1][0]
    return pose


def frame(numbers, inverse):
    """Return a frame (3 rows of 4 numbers) or its inverse, with the rotation nearest to its numbers."""
    R = [row[:3] for row in numbers]
    defect = max(abs(math.fsum(R[k][i] * R[k][j] for k in range(3)) - (i == j)) for i in range(3) for j in range(3))
    if not defect <= 1e-12:
        raise ValueError(f"a frame is no rotation: {defect:.1e}")
    radius = 0.0 if all(entry in (-1, 0, 1) for row in R for entry in row) else 3 * (defect + 8 * UNIT)
    turn = [[number(entry, radius) for entry in row] for row in R]
    p = [number(row[3]) for row in numbers]
    if not inverse:
        return [[*turn[i], p[i]] for i in range(3)]
    back = [-(turn[0][i] * p[0] + turn[1][i] * p[1] + turn[2][i] * p[2]) for i in range(3)]
    return [[turn[0][i], turn[1][i], turn[2][i], back[i]] for i in range(3)]


def root_of_squares(entries):
    """Return an upper bound of the root of the sum of squares of sums: the sum of those of all terms."""
    squares = {}
    for entry in entries:
        for key, (centre, radius) in entry.items():
            squares[key] = squares.get(key, 0.0) + (abs(centre) + radius) ** 2
    return math.fsum(map(math.sqrt, squares.values())) * (1 + 16 * UNIT)


def exponents(key, places):
    """Return the exponents of some variables; with half of the base more, no digit is negative."""
    more = sum(BASE // 2 * BASE**place for place in range(max(places, default=-1) + 1))
    return tuple((key + more) // BASE**place % BASE - BASE // 2 for place in places)


def length_bound(vector, lengths):
    """Return an upper bound of the length of a vector; terms with equal powers of lengths are bounded together."""
    total = 0.0
    for powers in {exponents(key, lengths) for entry in vector for key in entry}:
        parts = [Sum({k: term for k, term in e.items() if exponents(k, lengths) == powers}) for e in vector]
        simple = root_of_squares(parts)
        sizes = sorted((abs(centre) + radius for part in parts for centre, radius in part.values()), reverse=True)
        least = max(1e-5 * simple, sizes[min(MANY, len(sizes)) - 1])
        square = Sum()
        for part in parts:
            entry = Sum({key: (c, r) for key, (c, r) in part.items() if abs(c) + r >= least})
            entry.put(0, 0j, math.fsum(abs(c) + r for c, r in part.values() if abs(c) + r < least) * (1 + UNIT))
            # the square of the magnitude is the product with the conjugate
            square = square + entry * Sum({-key: (c.conjugate(), r) for key, (c, r) in entry.items()})
        total += min(simple, math.sqrt(root_of_squares([square])) * (1 + UNIT))
    return total * (1 + 100 * UNIT)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1:]))
