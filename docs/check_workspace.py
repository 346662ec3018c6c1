"""Check a certificate of `twin prove --workspace` without twin: only Python's standard library is used.

    python docs/check_workspace.py certificate.json [FOLDER] [POINTS]

FOLDER contains the files of equations and mechanism; if it is given, their hashes are compared. At random points of the
proved volume (POINTS, or 400), joint values are enclosed again: Krawczyk's operator on the closing conditions of the
mechanism, in interval arithmetic. There the loops must close, limits be kept, and the derivatives be regular: of the
CAD and, if there is a tolerance, of all lengths within it, but for gaps of loops that follow from others. The exit code
is 0 if all points hold, 1 if one does not or is undecided, 2 if the certificate cannot be read or was changed.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import random
import sys
from pathlib import Path

WIDTH = 1e-11  # m, around a point
ZERO = (0.0, 0.0)
UNIT = [[(1.0, 1.0), ZERO, ZERO], [ZERO, (1.0, 1.0), ZERO], [ZERO, ZERO, (1.0, 1.0)]]


def main(arguments):
    """Check the certificate and print what was found; return the exit code."""
    numbers = [int(word) for word in arguments[1:] if word.lstrip("-").isdecimal()]
    try:
        data = json.loads(Path(arguments[0]).read_text(encoding="utf-8"), parse_float=finite, parse_constant=finite)
        text = json.dumps({k: v for k, v in data.items() if k != "sha256"}, sort_keys=True, separators=(",", ":"))
        stated = ("twin/workspace-certificate/1", hashlib.sha256(text.encode()).hexdigest())
        if (data["schema"], data["sha256"]) != stated:
            raise ValueError("its schema is another, or its content does not have the SHA-256 that it states")
        for name, expected in data["files"].items() if len(arguments) - len(numbers) > 1 else ():
            if hashlib.sha256((Path(arguments[1]) / name).read_bytes()).hexdigest() != expected:
                raise ValueError(f"{name} is not the file that was proved")
        counts, first = check(data, *numbers)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        print(f"the certificate cannot be checked: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    verdict = "FAILS" if counts["fails"] else "UNDECIDED" if counts["undecided"] else "holds"
    print(f"{verdict}: {', '.join(f'{n} points {what}' for what, n in counts.items())}{first}")
    print(f"checked: {len(data['closures'])} closing joints, {len(data['limits'])} limits of joints")
    return int(verdict != "holds")


def finite(text):
    """Return a number of the file."""
    if math.isfinite(float(text)):
        return float(text)
    raise ValueError(f"{text} is not a finite number")


def check(data, points=400):
    """Return {verdict: number of points}, and a text with the first point that does not hold."""
    boxes, counts, first = data["boxes"], {"hold": 0, "undecided": 0, "fails": 0}, ""
    sizes = [[b - a for a, b in zip(low, high, strict=True)] for low, high, _ in boxes]
    if points < 1 or not data["tolerance_m"] >= 0 or not all(edge > 0 for edges in sizes for edge in edges):
        raise ValueError("a box is empty, the tolerance negative, or the number of points not above 0")
    robots = [Mechanism(data, tolerance) for tolerance in sorted({0.0, data["tolerance_m"]})]
    generator = random.SystemRandom()  # no point that the author of a certificate could foresee
    for low, high, joints in generator.choices(boxes, [math.prod(edges) for edges in sizes], k=points):
        p = x, y, z = [generator.uniform(a, b) for a, b in zip(low, high, strict=True)]
        if sum(1 for a, b, _ in boxes if a[0] <= x < b[0] and a[1] <= y < b[1] and a[2] <= z < b[2]) > 1:
            raise ValueError("boxes overlap: their volumes count twice")
        verdicts = [robot.judged(p, joints) for robot in robots]
        verdict, why = max(verdicts, key=lambda found: list(counts).index(found[0]))
        counts[verdict] += 1
        if verdict != "hold" and (not first or verdict == "fails"):
            first = f"; {verdict} at {', '.join(f'{1e3 * x:.6g}' for x in p)} mm: {why}"
    return counts, first


def add(a, b):
    """Return a + b of two intervals (low, high); each end is rounded outward."""
    return math.nextafter(a[0] + b[0], -math.inf), math.nextafter(a[1] + b[1], math.inf)


def minus(a):
    """Return -a."""
    return -a[1], -a[0]


def times(a, b):
    """Return a b."""
    products = (a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])
    return math.nextafter(min(products), -math.inf), math.nextafter(max(products), math.inf)


def dot(a, b):
    """Return the sum of the products of two vectors; exact zeros are left out."""
    return functools.reduce(add, (times(x, y) for x, y in zip(a, b, strict=True) if ZERO not in (x, y)), ZERO)


def cross(a, b):
    """Return the cross product."""
    return [add(times(a[i], b[j]), minus(times(a[j], b[i]))) for i, j in ((1, 2), (2, 0), (0, 1))]


def wave(function, angle):
    """Return the cosine or the sine of an angle: at its middle, and as far as it can change within the interval."""
    middle = 0.5 * (angle[0] + angle[1])
    radius = (angle[1] - angle[0]) + 1e-15 * (1 + abs(middle))
    return max(function(middle) - radius, -1.0), min(function(middle) + radius, 1.0)


def exactly(x):
    """Return a number as an interval."""
    return 1.0 * x, 1.0 * x


def then(pose, frame):
    """Return the product of two poses (rotation, position)."""
    turned = [[dot(row, column) for column in zip(*frame[0], strict=True)] for row in pose[0]]
    return turned, [add(dot(row, frame[1]), x) for row, x in zip(*pose, strict=True)]


def frame(numbers, tolerance, inverse=False):
    """Return a pose from 3 rows of 4 numbers, its position within a tolerance, with the nearest rotation."""
    R = [row[:3] for row in numbers]
    defect = max(abs(math.fsum(R[k][i] * R[k][j] for k in range(3)) - (i == j)) for i in range(3) for j in range(3))
    if not defect <= 1e-12:
        raise ValueError(f"a frame is no rotation: {defect:.1e}")
    radius = 0.0 if all(entry in (-1, 0, 1) for row in R for entry in row) else 3 * (defect + 1e-14)
    p = [add(exactly(row[3]), (-tolerance, tolerance)) for row in numbers]
    turn = [[(x - radius, x + radius) for x in row] for row in R]
    back = list(zip(*turn, strict=True))
    return (back, [minus(dot(row, p)) for row in back]) if inverse else (turn, p)


class Mechanism:
    """The loops of a mechanism, whose tool pose is given."""

    def __init__(self, data, off):
        """Read loops, within a tolerance, and limits; choose conditions that determine the joints in the first box."""
        self.R = frame([[*row, 0.0] for row in data["orientation"]], 0.0)[0]
        self.count = count = len(data["joints"])
        places = {name: i for i, name in enumerate(data["joints"])}
        self.limits = [(x["name"], {places[n]: w for n, w in x["weights"].items()}, x["least"]) for x in data["limits"]]
        self.passive = [i for i, active in enumerate(data["active"]) if not active]
        self.closures, self.off = [], off
        for closure in data["closures"]:
            paths = [(p["from_tool"], [prepared(step, count, off) for step in p["steps"]]) for p in closure["paths"]]
            self.closures.append((closure["type"], closure["cone"], *paths))
        low, high, joints = data["boxes"][0]
        p = [exactly(0.5 * (a + b)) for a, b in zip(low, high, strict=True)]
        _, J, _ = self.conditions([exactly(x) for x in joints], p)
        self.rows = independent([[sum(x) / 2 for x in row[:count]] for row in J])

    def conditions(self, x, p):
        """Return the closing conditions, their derivatives by joints and tool motion, and (what, cosine, least one)."""
        values, derivatives, cosines = [], [], []
        for kind, cone, one, other in self.closures:
            (R1, p1), axes1 = self.moved(one, x, p)
            (R2, p2), axes2 = self.moved(other, x, p)
            (x1, y1, z1), (_, y2, z2) = zip(*R1, strict=True), zip(*R2, strict=True)
            d = [add(a, minus(b)) for a, b in zip(p2, p1, strict=True)]
            along = [x1, y1] if kind in ("cylindrical", "prismatic") else UNIT
            pairs = [(a, d, along is not UNIT) for a in along]  # (vector of the first frame, of the second, it turns)
            if kind != "spherical":
                pairs += [(x1, z2, True), (y1, z2, True)]
                cosines.append(("a joint that is turned over", dot(z1, z2), 0.0))
            if kind in ("prismatic", "fixed"):
                pairs.append((x1, y2, True))
                cosines.append(("a joint that is turned over", dot(y1, y2), 0.0))
            if cone is not None:
                cosines.append(("the cone of a ball joint", dot(z1, z2), wave(math.cos, exactly(cone))[1]))
            for a, b, turns in pairs:
                values.append(dot(a, b))
                derivatives.append(self.derivative(a, b, turns, b is d, axes1, axes2, (p1, p2)))
        return values, derivatives, cosines

    def derivative(self, a, b, turns, shifts, axes1, axes2, ends):
        """Return the derivatives of a product a b by all coordinates: of d = p2 - p1 by shifts, of axes by turns."""
        out = []
        for i in range(self.count + 6):
            total = ZERO
            for axes, sign, end in ((axes1, -1, ends[0]), (axes2, 1, ends[1])):
                axis, origin = axes.get(i, (None, None))
                if shifts and axis is not None:
                    lever = None if origin is None else [add(u, minus(v)) for u, v in zip(end, origin, strict=True)]
                    total = add(total, times(exactly(sign), dot(a, axis if lever is None else cross(axis, lever))))
                if sign < 0 and turns and origin is not None:
                    total = add(total, dot(cross(axis, a), b))
                if sign > 0 and not shifts and origin is not None:
                    total = add(total, dot(a, cross(axis, b)))
            out.append(total)
        return out

    def moved(self, path, x, p):
        """Return a frame at the end of a path, and {coordinate: (axis, point of the axis, None for a shift)}."""
        pose, axes = (UNIT, [ZERO] * 3), {}
        if path[0]:  # from the tool
            pose = (self.R, p)
            for i in range(3):
                axes[self.count + i] = UNIT[i], None
                axes[self.count + 3 + i] = UNIT[i], p
        for kind, value, sign in path[1]:
            if kind == "frame":
                pose = then(pose, value)
                continue
            axis = [times(exactly(sign), row[2]) for row in pose[0]]
            coordinate = times(exactly(sign), x[value])
            axes[value] = axis, pose[1] if kind == "turn" else None
            c, s = wave(math.cos, coordinate), wave(math.sin, coordinate)
            turned = [[c, minus(s), ZERO], [s, c, ZERO], UNIT[2]], [ZERO] * 3
            pose = then(pose, turned if kind == "turn" else (UNIT, [ZERO, ZERO, coordinate]))
        return pose, axes

    def judged(self, p, joints):
        """Return ("hold", "undecided" or "fails", why) of a point."""
        count, point, m = self.count, [exactly(x) for x in p], list(joints)
        for _ in range(8):
            F, J, _ = self.conditions([exactly(x) for x in m], point)
            C = inverted([[sum(J[r][i]) / 2 for i in range(count)] for r in self.rows])
            m = [x - sum(C[i][k] * sum(F[r]) / 2 for k, r in enumerate(self.rows)) for i, x in enumerate(m)]
        box = [(x - WIDTH, x + WIDTH) for x in p]
        F, _, _ = self.conditions([exactly(x) for x in m], box)
        shift = [dot([exactly(c) for c in C[i]], [F[r] for r in self.rows]) for i in range(count)]
        for wider in (1.2, 1.6, 2.4, 4.0):
            radius = [wider * max(map(abs, x)) + 1e-12 for x in shift]
            _, J, _ = self.conditions([(x - r, x + r) for x, r in zip(m, radius, strict=True)], box)
            E = error_of(C, [[J[r][i] for i in range(count)] for r in self.rows])
            K = [add(minus(x), dot(row, [(-r, r) for r in radius])) for x, row in zip(shift, E, strict=True)]
            if all(-r < low <= high < r for (low, high), r in zip(K, radius, strict=True)):
                break
        else:
            return "undecided", "the enclosure does not contract"
        X = [add(exactly(x), part) for x, part in zip(m, K, strict=True)]
        values, J, cosines = self.conditions(X, box)
        for a, b in (value for r, value in enumerate(values) if r not in self.rows):
            if a > 1e-9 or b < -1e-9:
                return "fails", "a loop does not close"
            if not (self.off or -1e-9 <= a <= b <= 1e-9):  # of all lengths, loops that follow from others have a gap
                return "undecided", "a loop may not close"
        cosines += [(n, dot([*map(exactly, w.values())], [X[i] for i in w]), least) for n, w, least in self.limits]
        for what, value, least in cosines:
            if not value[0] >= least:
                return "fails" if value[1] < least else "undecided", f"the limit is exceeded: {what}"
        moving = [*self.passive, *range(count, count + 6)]
        A = [[J[r][i] for i in moving] for r in self.rows]
        E = error_of(inverted([[sum(a) / 2 for a in row] for row in A]), A)
        v = [sum(max(map(abs, x)) for x in row) + 1e-3 for row in E]  # nearly the vector of the largest eigenvalue
        if any(sum(max(map(abs, x)) * v[j] for j, x in enumerate(row)) >= v[i] for i, row in enumerate(E)):
            return "undecided", "the derivatives may be singular"
        return "hold", ""


def prepared(step, count, tolerance):
    """Return (kind, pose or number of the coordinate, sign) of a step."""
    kind, value, *sign = step
    if kind in ("frame", "inverse"):
        return "frame", frame(value, tolerance, kind == "inverse"), 1
    if kind not in ("turn", "slide") or not 0 <= value < count or sign not in ([1], [-1]):
        raise ValueError(f"there is no step {step}")
    return kind, value, sign[0]


def error_of(C, A):
    """Return 1 - C A."""
    product = [[dot([exactly(c) for c in row], column) for column in zip(*A, strict=True)] for row in C]
    return [[add(exactly(i == j), minus(x)) for j, x in enumerate(row)] for i, row in enumerate(product)]


def inverted(A):
    """Return the inverse of a matrix of numbers, by Gauss and Jordan."""
    rows, n = [[*row, *(float(i == k) for k in range(len(A)))] for i, row in enumerate(A)], len(A)
    if any(len(row) != 2 * n for row in rows):
        raise ValueError("there are not as many independent conditions as unknowns")
    for i in range(n):
        best = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[best] = rows[best], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(n):
            if k != i and rows[k][i]:
                rows[k] = [x - rows[k][i] * y for x, y in zip(rows[k], rows[i], strict=True)]
    return [row[n:] for row in rows]


def independent(J):
    """Return as many rows of a matrix as it has columns, each with the largest part that the others do not explain."""
    rest, found = [list(row) for row in J], []
    for _ in J[0]:
        row = max(range(len(rest)), key=lambda k: sum(x * x for x in rest[k]))
        size = math.sqrt(sum(x * x for x in rest[row]))
        if size < 1e-6:
            raise ValueError("the conditions do not determine the joints")
        unit = [x / size for x in rest[row]]
        parts = [sum(a * b for a, b in zip(other, unit, strict=True)) for other in rest]
        rest = [[x - part * u for x, u in zip(r, unit, strict=True)] for r, part in zip(rest, parts, strict=True)]
        found.append(row)
    return sorted(found)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3, 4):
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1:]))
