"""Check a certificate of `twin prove` without twin: only Python's standard library is used.

    python docs/check_certificate.py sils.certificate.json [FOLDER]

FOLDER contains the files of equations and mechanism; if it is given, their hashes are compared. The operations of each
claim are repeated at random states, with numbers modulo another prime than that of the prover. The exit code is 0 if
all claims hold, 1 if one does not, 2 if the certificate cannot be read or was changed. Bounds along protocols are not
checked: their number is printed.
"""

from __future__ import annotations

import hashlib
import json
import math
import random
import re
import sys
from fractions import Fraction
from pathlib import Path

# 2^61 less these are primes of the form 24 k + 23: 2 and 3 have roots, and the root of a square is a power. They are
# used in turn, because a constant that is no square in one of them may be one in the next.
PRIMES = [2**61 - k for k in (465, 1281, 1425, 2385, 3081, 3105)]
ENOUGH = 8
SEEN = 200  # states within reach at which every claim is looked at
STATES = 4000
LUCKY_STATES = 400_000  # states at which claims with many roots are looked at
ROUNDING = 1e-6
CHANCE = 1e-6  # odds that roots with other signs hide all zeros where a condition has one of its answers
UNDEFINED = (None, math.nan)  # the value where an expression has none


def main(arguments):
    """Check the certificate and print a line for each claim; return the exit code."""
    try:
        data = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
        check_content(data)
        if len(arguments) > 1:
            check_files(data, Path(arguments[1]))
        verdicts = check(data)
        motions = sum(len(motion["proved"]) for motion in data.get("motions", ()))
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        print(f"the certificate cannot be checked: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    if not verdicts:
        print("the certificate has no claim", file=sys.stderr)
        return 2
    for sentence, fault in verdicts:
        print(f"{'holds' if not fault else 'FAILS'}: {sentence}{'; ' + fault if fault else ''}")
    if motions:
        print(f"not checked: {motions} bounds along protocols")
    return int(any(fault for _, fault in verdicts))


def check_content(data):
    """Raise an error if the certificate is not as it was written."""
    if data["schema"] != "twin/certificate/1":
        raise ValueError(f"schema {data['schema']!r} is not twin/certificate/1")
    content = {key: value for key, value in data.items() if key != "sha256"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    if hashlib.sha256(text.encode("ascii")).hexdigest() != data["sha256"]:
        raise ValueError("its content does not have the SHA-256 that it states")
    for name, (_, low, high) in data["ranges"].items():
        if not low < high:
            raise ValueError(f"the range of {name} is empty")


def check_files(data, folder):
    """Raise an error if a file of equations or mechanism is not the one that was proved."""
    for name, expected in data["files"].items():
        if hashlib.sha256((folder / name).read_bytes()).hexdigest() != expected:
            raise ValueError(f"{name} is not the file that was proved")


def check(data):
    """Return [(claim, why it does not hold, or "")]."""
    rows = data["rows"]
    claims = [Claim(claim, rows) for claim in data["claims"]]
    numbers = {i: row[1] for i, row in enumerate(rows) if row[0] == "number"}
    fields = [Field(prime) for prime in PRIMES]
    constants = [{i: field.number(text) for i, text in numbers.items()} for field in fields]
    generator = random.SystemRandom()  # no state that the author of a certificate could foresee
    for turn in range(LUCKY_STATES):
        # a claim with many roots has few states with all of them: then the others are given up at the first lost root
        waiting = [claim for claim in claims if claim.open and (turn < STATES or claim.only_zeros)]
        if not waiting:
            break
        field = fields[turn % len(fields)]
        state = field.draw(data["ranges"], generator)
        values = dict(constants[turn % len(fields)])  # {row: its value at the state}
        for claim in waiting:
            if complete(rows, claim.needed, values, state, field, claim.only_zeros):
                complete(rows, claim.margins, values, state, field, False)
                claim.judge(values, state)
    return [(claim.text, claim.verdict()) for claim in claims]


def complete(rows, needed, values, state, field, needs_roots):
    """Evaluate rows; return False as soon as a root is missing, if all are needed."""
    for i in needed:
        if i not in values:
            values[i] = field.evaluate(rows[i], values, state)
        if needs_roots and rows[i][0] == "root" and values[i][0] is None:
            return False
    return True


class Claim:
    """A claim: numbers that must be zero wherever some margins are not negative; and what was found."""

    def __init__(self, claim, rows):
        """Find the rows that it needs."""
        self.text, self.zero, self.reach = claim["claim"], claim["zero"], claim["reach"]
        self.needed = operations(rows, self.zero)
        self.margins = operations(rows, self.reach)
        if not any(rows[i][0] in ("input", "cosine", "sine") for i in self.needed):
            raise ValueError(f"the claim {claim['name']} has no row that depends on the state")
        self.rooted = any(rows[i][0] == "root" for i in self.needed)
        self.conditions = {rows[i][1] for i in self.needed if rows[i][0] == "choose"}
        self.zeros = self.seen = 0
        self.counts = {}  # {(condition or None, answer): (number of exact results, number of zeros)}
        self.fault = ""

    @property
    def open(self):
        """Whether more states are needed."""
        return not self.fault and (self.zeros < ENOUGH or self.seen < SEEN)

    @property
    def only_zeros(self):
        """Whether only exact zeros are still needed, which exist where all roots do."""
        return self.rooted and self.seen >= SEEN

    def judge(self, values, state):
        """Count the zeros at a state, or keep what is wrong there."""
        results = [values[i] for i in self.zero]
        reach = [values[i][1] for i in self.reach]
        if any(not margin >= 0 for margin in reach) or any(math.isnan(result[1]) for result in results):
            return
        self.seen += 1
        wrong = [result[1] for result in results if not abs(result[1]) <= ROUNDING]
        if wrong:
            self.fault = f"a number is {wrong[0]:.3g} at {shown(state)}"
        exact = [result[0] for result in results]
        if None in exact:
            return
        self.zeros += not any(exact)
        if any(exact) and not self.rooted:
            self.fault = self.fault or f"an exact number is not zero at {shown(state)}"
        for side in [(None, True), *((i, bool(values[i][1])) for i in self.conditions)]:
            known, zero = self.counts.get(side, (0, 0))
            self.counts[side] = known + 1, zero + (not any(exact))

    def verdict(self):
        """Return why the claim does not hold, or ""."""
        if self.open:
            return f"only {self.zeros} exact zeros, at {self.seen} states within reach"
        known, zero = self.counts.get((None, True), (0, 0))
        for there, zeros in self.counts.values():  # chance would have put a zero on each side of a condition
            if not self.fault and not zeros and (1 - zero / known) ** there < CHANCE:
                return "no exact number is zero where a condition has one of its answers"
        return self.fault


def operations(rows, results):
    """Return the rows that results need, in order."""
    needed, waiting = set(), list(results)
    while waiting:
        i = waiting.pop()
        if not 0 <= i < len(rows):
            raise ValueError(f"there is no row {i}")
        if i not in needed:
            needed.add(i)
            waiting += [operand for operand in rows[i][1:] if isinstance(operand, int)]
            if any(isinstance(operand, int) and operand >= i for operand in rows[i][1:]):
                raise ValueError(f"row {i} needs a later row")
    return sorted(needed)


class Field:
    """Exact numbers modulo a prime, each beside its real value."""

    def __init__(self, prime):
        """Keep the prime and its roots."""
        self.prime = prime
        self.roots = {1: 1, 2: self.root(2), 3: self.root(3), 6: self.root(2) * self.root(3) % prime}
        self.tenths = self.residue(Fraction(1, 10**7))  # of micrometres: decimals of drawings

    def draw(self, ranges, generator):
        """Return a random state: {name: (exact value, real value)}, for an angle those of its cosine and sine."""
        state = {}
        for name, (is_angle, low, high) in ranges.items():
            if is_angle:
                middle = round((low + high) / 2 / (math.pi / 6)) * 30
                start = math.radians(middle)
                first = Fraction(math.tan(max(low - start, -0.999 * math.pi) / 2))
                last = Fraction(math.tan(min(high - start, 0.999 * math.pi) / 2))
                t = first + Fraction(generator.randint(0, 10**9), 10**9) * (last - first)
                c, s = self.near(middle)
                x, y = self.residue((1 - t * t) / (1 + t * t)), self.residue(2 * t / (1 + t * t))
                turn = start + 2 * math.atan(t)
                first = (c * x - s * y) % self.prime
                second = (s * x + c * y) % self.prime
                state[name] = (first, math.cos(turn)), (second, math.sin(turn))
            else:
                x = Fraction(low) + Fraction(generator.randint(0, 10**9), 10**9) * (Fraction(high) - Fraction(low))
                state[name] = self.residue(x), float(x)
        return state

    def near(self, degrees):
        """Return exact cosine and sine of a multiple of 30 degrees."""
        half = self.residue(Fraction(1, 2))
        tall = half * self.roots[3]
        cosines = [1, tall, half, 0, -half, -tall, -1, -tall, -half, 0, half, tall]
        k = degrees // 30
        return cosines[k % 12], cosines[(k - 3) % 12]

    def residue(self, x):
        """Return a fraction in the field."""
        return x.numerator * pow(x.denominator, -1, self.prime) % self.prime

    def root(self, x):
        """Return the root of a square in the field that is itself a square; None for other numbers."""
        found = pow(x, (self.prime + 1) // 4, self.prime)
        return found if found * found % self.prime == x % self.prime else None

    def number(self, text):
        """Return a constant such as "1/2*sqrt(3) + 5*sqrt(1)"."""
        exact, real = 0, 0.0
        for word in text.split(" + "):
            fraction, radicand = re.fullmatch(r"(-?\d+(?:/\d+)?)\*sqrt\(([1236])\)", word).groups()
            exact += self.residue(Fraction(fraction)) * self.roots[int(radicand)]
            real += float(Fraction(fraction)) * math.sqrt(int(radicand))
        return exact % self.prime, real

    def evaluate(self, row, values, state):
        """Return (exact value or None, real value) of a row; conditions have the real value alone, as True or False."""
        name = row[0]
        if name == "real":
            return None, float(row[1])
        if name == "input":
            return state[row[1]]
        if name in ("cosine", "sine"):
            return state[row[1]][name == "sine"]
        operands = [values[i] for i in row[1:]]
        exact = [operand[0] for operand in operands]
        real = [operand[1] for operand in operands]
        if name == "choose":
            return operands[1] if real[0] else operands[2]
        if name in CONDITIONS:
            return None, CONDITIONS[name](*real)
        if name == "angle":
            return None, math.atan2(real[1], real[0])
        if name == "root":
            return self.rooted(exact[0], real[0])
        if name == "inverse" and not real[0]:
            return UNDEFINED
        result = REAL[name](*real)
        if None in exact or (name == "inverse" and not exact[0]):
            return None, result
        found = pow(exact[0], -1, self.prime) if name == "inverse" else REAL[name](*exact)
        return found % self.prime, result

    def rooted(self, exact, real):
        """Return the root of a number; its sign is that of the real root if the root is a decimal."""
        if not real >= -1e-9:
            return UNDEFINED
        length = math.sqrt(max(real, 0.0))
        if exact is None:
            return None, length
        for radicand, multiple in self.roots.items():
            steps = round(length / math.sqrt(radicand) * 10**7)
            found = steps * self.tenths * multiple % self.prime
            if found * found % self.prime == exact:
                return found, length
        return self.root(exact), length


CONDITIONS = {
    "less": lambda a, b: a < b,
    "at most": lambda a, b: a <= b,
    "equal": lambda a, b: a == b,
    "both": lambda a, b: a and b,
    "one of": lambda a, b: a or b,
    "not": lambda a: not a,
}
REAL = {"add": lambda a, b: a + b, "multiply": lambda a, b: a * b, "negative": lambda a: -a, "inverse": lambda a: 1 / a}


def shown(state):
    """Return a state as text."""
    real = {name: math.atan2(x[1][1], x[0][1]) if isinstance(x[0], tuple) else x[1] for name, x in state.items()}
    return ", ".join(f"{name} = {value:.6g}" for name, value in real.items())


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1:]))
