"""Check bounds along a protocol, as `twin prove --protocol` writes them, without twin: Python's standard library alone.

    python docs/check_motion.py motion-PROTOCOL.json [PIECES]

On each piece of the path, or on PIECES drawn by chance and those after them, path and mechanism are enclosed, as
polynomials with a bound of what they leave out. Krawczyk's operator shows that the loops close in one way near the
predictions, from piece to piece; each bound must hold. Exit code: 0 if all hold, 1 if not, 2 if it is unreadable.
"""

import hashlib
import itertools
import json
import math
import random
import sys
from fractions import Fraction
from pathlib import Path

N, U, UP, TINY = 5, 2.0**-53, 1.0 + 2.0**-40, 1e-290  # degree; rounding of an operation, of a bound, underflow
ARM = 0.1  # m: gaps of directions, in rad, are multiplied by it
PARTS = {"revolute": "t", "prismatic": "s", "cylindrical": "st", "spherical": "zyx", "fixed": ""}


def main(arguments):
    """Check the certificate and print what was found; return the exit code."""
    try:
        content = Path(arguments[0]).read_text(encoding="utf-8")
        data = json.loads(content, parse_float=lambda x: float(x) if math.isfinite(float(x)) else x, parse_constant=str)
        text = json.dumps({k: v for k, v in data.items() if k != "sha256"}, sort_keys=True, separators=(",", ":"))
        stated = ("twin/motion-certificate/1", hashlib.sha256(text.encode()).hexdigest())
        if (data["schema"], data["sha256"]) != stated:
            raise ValueError("its schema is another, or its content does not have the SHA-256 that it states")
        wrong, count = check(data, *map(int, arguments[1:]))
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        print(f"the certificate cannot be checked: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    lines = [*sorted(wrong, reverse=True), (min(wrong)[0] if wrong else "holds", f"{len(data['bounds'])} bounds")]
    print("\n".join(map(": ".join, lines)), f"on {count} of {len(data['pieces'])} pieces")
    return int(bool(wrong))


def check(data, count=0):
    """Return (what does not hold, number of pieces that were checked)."""
    pieces, wrong, known = data["pieces"], set(), {}
    for (k, a, b, *_), (n, start, *_) in itertools.pairwise([[-1, 0, 1], *pieces, [len(data["path"]["phases"]), 0, 1]]):
        if not (a < b and data["bounds"] and (start == b if n == k else (n, b, start) == (k + 1, 1, 0))):
            raise ValueError("there is no bound, or the pieces leave out a part of the path")
    drawn = random.SystemRandom().sample(range(len(pieces)), count) if count else range(len(pieces))
    chosen = sorted({*drawn, *(k + 1 for k in drawn)} & {*range(len(pieces))})
    for k in chosen:
        piece = known[k] = Piece(data, *pieces[k])
        if k - 1 in known and not known.pop(k - 1).goes_on(piece):
            wrong.add(("UNDECIDED", f"the motion on piece {k} is not shown to be that of the piece before"))
        for bound in data["bounds"]:
            verdicts = [f.verdict(a, b) for f, a, b in piece.functions(bound)]
            wrong |= {(verdict, f"{bound['kind']} {bound['value']}") for verdict in verdicts if verdict}
    return wrong, len(chosen)


class Model:
    """A function of x in [-1, 1]: the sum of c[k] x^k, but for at most r; d are derivatives {coordinate: function}."""

    def __init__(self, c, r=0.0, d=()):
        self.c = c if isinstance(c, list) else [1.0 * c, *[0.0] * N]  # a number is a constant
        self.r, self.s, self.d = (r + TINY) * UP, sum(map(abs, self.c)) * UP, dict(d)
        self.size = (self.s + self.r) * UP  # nowhere exceeded

    def __add__(self, other):
        return linear([1, 1], [self, other])

    def __sub__(self, other):
        return linear([1, -1], [self, other])

    def __mul__(self, other):
        if self is ZERO or other is ZERO:
            return ZERO
        a, b, rest, tail = self.c, other.c, 0.0, 0.0
        for k in range(N, 0, -1):
            rest += abs(b[k])
            tail += abs(a[N + 1 - k]) * rest
        r = self.s * (16 * U * other.s + other.r) + self.r * other.size + tail
        one, two = Model(a, self.r), Model(b, other.r)
        d = {i: self.d.get(i, ZERO) * two + one * other.d.get(i, ZERO) for i in {**self.d, **other.d}}
        return Model([sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(N + 1)], r, d)

    def ends(self, a=-1.0, b=1.0):
        """Return (lower, upper bound) on the part from a to b."""
        m, w = 0.5 * (a + b), 0.5 * (b - a) + 1e-15
        c = [sum(self.c[k] * math.comb(k, j) * m ** (k - j) * w**j for k in range(j, N + 1)) for j in range(N + 1)]
        around = (sum(map(abs, c[1:])) + self.r + 1000 * U * self.s) * UP
        return c[0] - around, c[0] + around

    def verdict(self, a, b, depth=26):
        """Return "" if the function is not negative from a to b, "FAILS" if it is somewhere, or "UNDECIDED"."""
        low, high = self.ends(a, b)
        if low >= 0 or high < 0 or not depth:
            return "" if low >= 0 else "FAILS" if high < 0 else "UNDECIDED"
        return self.verdict(a, 0.5 * (a + b), depth - 1) or self.verdict(0.5 * (a + b), b, depth - 1)

    def sine_cosine(self):
        """Return sine and cosine: those of c[0] by Python, to 2^-50, and those of the rest by their series."""
        rest = Model([0.0, *self.c[1:]], self.r)
        square, size = rest * rest, rest.size
        s = rest * (ONE - square * Model(1 / 6) * (ONE - square * Model(0.05))) + Model(0.0, size**7 / 5000 + 2.0**-50)
        c = ONE - square * Model(0.5) * (ONE - square * Model(1 / 12)) + Model(0.0, size**6 / 719 + 2.0**-50)
        sine, cosine = Model(math.sin(self.c[0]), 2.0**-50), Model(math.cos(self.c[0]), 2.0**-50)
        s, c = sine * c + cosine * s, cosine * c - sine * s
        return Model(s.c, s.r, dict.fromkeys(self.d, c)), Model(c.c, c.r, dict.fromkeys(self.d, ZERO - s))


ZERO, ONE = Model(0.0), Model(1.0)


def linear(numbers, models, radius=0.0):
    """Return the sum of numbers, each known within a radius, times functions."""
    pairs = [(x, f) for x, f in zip(numbers, models, strict=True) if (x or radius) and f is not ZERO]
    if not pairs or (len(pairs) == 1 and pairs[0][0] == 1 and not radius):
        return pairs[0][1] if pairs else ZERO
    r = sum(abs(x) * f.r + (len(pairs) + 2) * U * abs(x) * f.s + radius * f.size for x, f in pairs)
    d = {i: linear(numbers, [f.d.get(i, ZERO) for f in models], radius) for i in {i for _, f in pairs for i in f.d}}
    return Model([sum(x * f.c[k] for x, f in pairs) for k in range(N + 1)], r, d)


def dot(a, b):
    """Return the sum of the products of two vectors."""
    return sum((x * y for x, y in zip(a, b, strict=True)), ZERO)


def then(pose, numbers):
    """Return the frame (axes, origin) at a pose in a frame: 3 rows of 4 numbers, with the nearest rotation."""
    columns, rows = list(zip(*numbers, strict=True)), list(zip(*pose[0], strict=True))
    off = max(abs(math.fsum(map(float.__mul__, a, b)) - (a is b)) for a in columns[:3] for b in columns[:3])
    radius = 0.0 if {abs(x) for a in columns[:3] for x in a} <= {0, 1} else 3 * (off + 1e-14)
    turned = [[linear(a, row, radius) for row in rows] for a in columns[:3]]
    return turned, [x + linear(columns[3], row) for x, row in zip(pose[1], rows, strict=True)]


class Piece:
    """Everything on one piece of the path, from s = a to b, and a little beyond."""

    def __init__(self, data, phase, a, b, series, inverse):
        self.mechanism, self.path, self.phase = data["mechanism"], data["path"], data["path"]["phases"][phase]
        self.a, self.b, self.middle, self.half = a, b, 0.5 * (a + b), 0.5 * (b - a) * (1 + 1e-9)
        driven, motion = self.mechanism["driven"], self.driven(self.phase["series"], self.middle, self.half)
        self.x, self.slopes = (dict(zip(driven, functions, strict=True)) for functions in motion)
        count = sum(len(PARTS[joint["type"]]) for joint in self.mechanism["tree"])
        self.passive = [i for i in range(count) if i not in driven]
        self.inverse = inverse
        if series is not None:
            for i, c in zip(self.passive, series, strict=True):
                rates = [k * x / self.half for k, x in enumerate(c[: N + 1])]
                self.x[i], self.slopes[i] = Model(c[: N + 1]), Model([*rates[1:], 0.0], 4 * U * sum(map(abs, rates)))
            self.enclose(inverse)

    def driven(self, series, middle, half):
        """Return Chebyshev series in 2 s - 1, and their derivatives by s, on the piece; integers err by 2^-100."""
        count, bits, out = len(series[0]), 4 * len(series[0]) + 200, []
        at, width = (int(x * 2**bits) for x in (2 * Fraction(middle) - 1, 2 * Fraction(half)))
        before, now, totals = [0] * count, [1 << bits, *[0] * (count - 1)], [[0] * count for _ in series]
        for j, numbers in enumerate(zip(*series, strict=True)):
            for i, a in enumerate(int(Fraction(x) * 2**bits) for x in numbers):
                totals[i] = [t + (a * x >> bits) for t, x in zip(totals[i], now, strict=True)]
            after = [at * x + width * y >> bits for x, y in zip(now, [0, *now[:-1]], strict=True)]
            before, now = now, [(2 if j else 1) * x - y for x, y in zip(after, before, strict=True)]
        for total in totals:
            c = [x / 2**bits for x in total]
            for values in (c, [k * x / half for k, x in enumerate(c)][1:]):
                rest = sum(map(abs, values[N + 1 :])) + 8 * U * sum(map(abs, values)) + 2.0**-100
                out.append(Model([*values, *[0.0] * (N + 1)][: N + 1], rest))
        return out[::2], out[1::2]

    def place(self, x):
        """Return the frame of the tip, the gaps of loops and couplings, and what must be above 0, at coordinates."""
        unit = [[ONE, ZERO, ZERO], [ZERO, ONE, ZERO], [ZERO, ZERO, ONE]]
        self.poses, i, gaps, signs = {self.mechanism["base"]: (unit, [ZERO] * 3)}, 0, [], []
        for joint in self.mechanism["tree"]:
            R, p = then(self.poses[joint["parent"]], joint["on_parent"])
            for part in PARTS[joint["type"]]:
                k = "xyz".find(part) % 3  # slides and turns of other joints are along and about z
                if part == "s":
                    p = [a + b * x[i] for a, b in zip(p, R[k], strict=True)]
                else:
                    (s, c), one, two = x[i].sine_cosine(), R[k - 2], R[k - 1]
                    R[k - 2] = [a * c + b * s for a, b in zip(one, two, strict=True)]
                    R[k - 1] = [b * c - a * s for a, b in zip(one, two, strict=True)]
                i += 1
            self.poses[joint["child"]] = then((R, p), joint["child_in_joint"])
        for joint in self.mechanism["loops"]:
            kind, (R, d) = joint["type"], self.relative(joint)
            gaps += d[:2] if kind in ("prismatic", "cylindrical") else d
            if kind in ("fixed", "prismatic"):
                gaps += [(R[i][j] - R[j][i]) * Model(ARM / 2) for i, j in ((2, 1), (0, 2), (1, 0))]
            if kind in ("revolute", "cylindrical"):
                gaps += [R[1][2] * Model(-ARM), R[0][2] * Model(ARM)]
            signs += [R[2][2]] * (kind != "spherical") + [R[1][1]] * (kind in ("fixed", "prismatic"))
        for coupling in self.mechanism["couplings"]:
            parts = [x[i] for i in coupling["coordinates"]]
            gaps.append(linear(coupling["ratios"], parts) - Model(coupling["total"]))
        tool = then(self.poses[self.mechanism["tool"]["body"]], self.mechanism["tool"]["frame"])
        return then(tool, self.path["frame_in_tool"]), gaps, signs

    def relative(self, joint):
        """Return the rotation and the gap of the two frames of a joint, in the first of them."""
        (R, p), (S, q) = (then(self.poses[joint[end]], joint[f"on_{end}"]) for end in ("parent", "child"))
        return [[dot(a, b) for b in S] for a in R], [dot(a, [y - x for x, y in zip(p, q, strict=True)]) for a in R]

    def enclose(self, A):
        """Show that the loops close in one way near the predictions, by Krawczyk's operator, and find the rates."""
        _, gaps, _ = self.place(self.x)
        move = [linear(row, gaps).size for row in A]
        self.radius = 4 * max(move, default=0.0) + 1e-9
        x = {i: Model(f.c, f.r + self.radius * (i in self.passive), {i: ONE}) for i, f in self.x.items()}
        (R, p), moving, _ = self.place(x)
        columns = [[gap.d.get(i, ZERO) for gap in moving] for i in self.passive]  # of the derivatives of the gaps
        rest = [[linear(row, column) for column in columns] for row in A]
        rest = [[(f - ONE if i == j else f).size for j, f in enumerate(row)] for i, row in enumerate(rest)]
        errors = [linear(row, [self.rate(gap) for gap in moving]).size for row in A]
        sizes = self.radius, 2 * max(errors, default=0.0) + 1e-12
        # coordinates, and rates as well, are in the image of their box, which must be inside of the first one
        for functions, moved, size in zip((self.x, self.slopes), (move, errors), sizes, strict=True):
            boxes = [[size] * len(A)]
            for _ in range(9):
                image = [sum(a * b for a, b in zip(row, boxes[-1], strict=True)) for row in rest]
                boxes.append([(m + a) * UP for m, a in zip(moved, image, strict=True)])
            if not max(boxes[1], default=0.0) < size:
                raise ArithmeticError(f"the loops are not proved to close near s = {self.a}")
            for i, radius in zip(self.passive, boxes[-1], strict=True):
                functions[i] = Model(functions[i].c, functions[i].r + radius)
        self.tip, self.gaps, signs = self.place(self.x)
        if any(sign.ends()[0] <= 0 for sign in signs) or any(gap.size > 1e-6 for gap in self.gaps):
            raise ArithmeticError(f"a loop is open, or the joint that closes it turned over, near s = {self.a}")
        self.squares = {}
        for name, parts, factor in (("tip", p, 1.0), ("rotation", [*R[0], *R[1], *R[2]], 0.5)):
            rates = [self.rate(f) for f in parts]
            self.squares[name] = dot(rates, rates) * Model(factor)

    def rate(self, f):
        """Return the derivative of a function by s."""
        return sum((slope * self.slopes[i] for i, slope in f.d.items()), ZERO)

    def goes_on(self, after):
        """Return whether the motion that ends here is that of the next piece: the only one within a radius."""
        for i in self.x if after.phase is not self.phase else set(self.passive) & set(self.x):
            (a, b), (c, d) = self.x[i].ends(*self.at(self.b, self.b)), after.x[i].ends(*after.at(after.a, after.a))
            if not max(d - a, b - c) <= (max(self.radius, after.radius) if i in self.passive else 1e-7):
                return False
        return True

    def at(self, a, b):
        """Return the part of the piece from s = a to b, and a little beyond."""
        return max(-1.0, (a - self.middle) / self.half - 1e-12), min(1.0, (b - self.middle) / self.half + 1e-12)

    def functions(self, bound):
        """Return (function, part of the piece) for all that is nowhere negative if a bound holds."""
        kind, least, most, rcm = bound["kind"], bound.get("at least"), bound.get("at most"), self.phase["rcm"]
        speed, limit, found = kind.endswith("speed"), bound.get("limit"), []
        if limit is not None and not (least >= limit - 1e-12 if most is None else most <= limit * (1 + 1e-3 * speed)):
            return [(Model(-1.0), -1.0, 1.0)]  # a bound beyond its limit
        functions = self.slopes if speed else self.x
        value = linear(bound.get("weights", ()), [functions[i] for i in bound.get("coordinates", ())])
        if speed:
            square, factor = (value * value, 1.0) if "weights" in bound else (self.squares[bound["value"]], None)
            return self.timed(square, most * (factor or self.phase[f"{bound['value']}_speed"]))
        if kind == "RCM" and rcm and self.phase["enforced"] == (bound["value"] == "enforced"):
            d = [x - Model(y) for x, y in zip(self.tip[1], rcm, strict=True)]
            shaft = [linear(self.path["shaft"], row) for row in zip(*self.tip[0], strict=True)]
            across = [d[i - 2] * shaft[i - 1] - d[i - 1] * shaft[i - 2] for i in range(3)]
            found = [Model(most * abs(most) * (1 - 1e-11)) - dot(across, across)]
        elif kind == "loop gap":
            found = [Model(most) - f for gap in self.gaps for f in (gap, ZERO - gap)]
        elif "cosine" in bound:  # of an angle between two directions, or of that from the middle of its limits
            R, _ = self.relative(bound["joint"])
            value = linear(bound["cosine"], [R[0][0], R[1][1], R[1][0], R[0][1], R[2][2]])
            found = [value - Model(math.cos(bound["angle"] - least) + 1e-15)]
        elif "limits" in bound:
            value = self.relative(bound["joint"])[1][2] if "joint" in bound else value
            low, high = bound["limits"]
            found = [] if low is None else [value - Model(low + least)]
            found += [] if high is None else [Model(high - least) - value]
        elif kind not in ("determinant", "RCM") or self.inverse is None:
            raise ValueError(f"there is no bound {kind}")
        return [(f, *self.at(self.a, self.b)) for f in found]

    def timed(self, square, most):
        """Return what is nowhere negative if a speed is at most a number; given is the square of the rate by s."""
        grid, squares, out = self.phase["grid"], [rate * rate for rate in self.phase["rates"]], []
        cells = list(zip(grid, grid[1:], squares, squares[1:], strict=False))
        if self.phase["averaged_s"] or grid[0] > 0 or grid[-1] < 1 or len(grid) != len(squares):
            raise ValueError("the timing is averaged, or leaves out a part of the path")
        steepest = max(abs(y - x) / (b - a) for a, b, x, y in cells)
        for a, b, x, y in (cell for cell in cells if cell[0] < self.b and cell[1] > self.a):
            slope = (y - x) / (b - a)
            line = [x + slope * (self.middle - a), slope * self.half, *[0.0] * (N - 1)]
            slower = Model(most * abs(most)) - square * Model(line, 1e-11 * (x + y + steepest))
            out.append((slower, *self.at(max(a, self.a), min(b, self.b))))
        return out


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]) if len(sys.argv) in (2, 3) else __doc__)
