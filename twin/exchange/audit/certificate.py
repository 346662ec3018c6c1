"""Check a certificate of `twin prove`: its operations are repeated with decimals of 60 digits at random states.

No code of the prover is used. It calculates modulo primes, where a root has no sign; here each number has 60 digits, a
bound of its rounding error, and each root its sign: what is farther from zero than its own error is no identity.
"""

from __future__ import annotations

import hashlib
import json
import math
import random
import re
from collections.abc import Callable, Mapping, Sequence
from decimal import Context, Decimal, localcontext
from pathlib import Path
from typing import Any, Protocol

from twin.core.errors import TwinError
from twin.exchange.audit.bounds_certificate import SCHEMA as BOUNDS
from twin.exchange.audit.bounds_certificate import audit_bounds
from twin.exchange.audit.motion_certificate import SCHEMA as MOTION
from twin.exchange.audit.motion_certificate import audit_motion_bounds
from twin.exchange.audit.report import AuditReport, Ledger, finished
from twin.exchange.audit.workspace_certificate import SCHEMA as WORKSPACE
from twin.exchange.audit.workspace_certificate import audit_workspace

SCHEMA = "twin/certificate/1"

DIGITS = 60
"""Number of digits of all calculations."""

LIMIT = 1e-25
"""Largest rounding error at a state that counts: near a singularity, an error of 1e-60 becomes its root."""

_STEP = 1e-58
"""Bound of the relative rounding error of an operation with 60 digits, and of its bound in double precision."""

_ANGLE = 1e-14
"""Bound of the error in rad of an angle, which has double precision."""

STATES = 24
"""Number of states within reach at which each claim is judged."""

_MOST_STATES = 2000
"""Number of states that are drawn at most."""

SAMPLED = 1e-8
"""Part by which a sample may be beyond a bound: errors of solvers, and of the series of a plan."""

TOUCHING = 1e-12
"""Distance in m or rad by which a joint may be beyond its limit."""

SPEED_EXCESS = 1e-3
"""Part by which a speed may exceed its limit, as the samples of a plan."""

_BEGINNING = 200
"""Number of bytes in which a certificate says what it is."""

_NAME = re.compile(rb'"twin/(?:[a-z]+-)?certificate/')
"""Beginning of the schema of a certificate, of identities or of bounds."""

Bounded = tuple[Decimal, float]
"""A number and a bound of its rounding error."""

Number = Bounded | bool | None
"""A value, a condition, or None where a value is not defined."""


def is_certificate(path: Path) -> bool:
    """Return whether a file begins as a certificate of a proof does, of any version."""
    if path.suffix != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        return _NAME.search(file.read(_BEGINNING)) is not None


class MotionSampler(Protocol):
    """Samples what a mechanism does along a protocol, without the prover."""

    def extremes(self, entry: Mapping[str, Any]) -> Mapping[tuple[str, str], tuple[float, float, int]]:
        """Return {(kind, value): (smallest, largest sample, number of those without a value)} of an entry's protocol.

        Both are NaN if no sample is a number. TwinError if the protocol cannot be sampled.
        """
        ...


def audit_certificate(
    path: Path, files: Mapping[str, str] | None = None, samples: MotionSampler | None = None
) -> AuditReport:
    """Return the report on a certificate.

    Args:
        path: the certificate.
        files: {file of equations or mechanism: its SHA-256}; they must be those that were proved. None: not compared.
        samples: what bounds along protocols are compared with; None: these are named as not checked.
    """
    ledger = Ledger(path.name, "decimals of 60 digits", "1")
    try:
        data = _read(path)
        if files is not None:
            _compare_files(data["files"], files, ledger)
        if data["schema"] == BOUNDS:
            ledger.tool = "random joint values"
            audit_bounds(data, ledger)
        elif data["schema"] == WORKSPACE:
            ledger.tool = "Newton's method at random points"
            audit_workspace(data, ledger)
        elif data["schema"] == MOTION:
            ledger.tool = "Newton's method at random times"
            audit_motion_bounds(data, ledger)
            # A determinant has no value to sample: that it is not 0 shows in the loops, which Newton's method closes.
            bounds = []
            for bound in data["bounds"]:
                if bound["kind"] != "determinant":
                    bounds.append(bound)
            if samples is None:
                _judge_limits(str(data["protocol"]), bounds, ledger)
            else:
                _judge_motion({**data, "proved": bounds}, samples, ledger)
            ledger.add("certificate.motion", "info", f"not in it: {'; '.join(map(str, data['not_in_it']))}")
        else:
            _judge(data, ledger)
        motions = data.get("motions", ())
        if samples is not None:
            for motion in motions:
                _judge_motion(motion, samples, ledger)
        elif motions:
            count = 0
            for motion in motions:
                count += len(motion["proved"])
            ledger.add("certificate.motions", "info", f"{count} bounds along protocols are not checked without --robot")
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, ArithmeticError, RecursionError) as error:
        text = f"it cannot be checked, because it was changed or cut: {type(error).__name__}: {error}"
        ledger.add("certificate.unreadable", "error", text, suggestion="Let `twin prove` write it again.")
    return finished(str(path), [], [ledger])


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a certificate whose hash is that of its content."""
    data = json.loads(path.read_text(encoding="utf-8"))
    known_schemas = (SCHEMA, BOUNDS, WORKSPACE, MOTION)
    if data["schema"] not in known_schemas:
        raise TwinError(
            f"{path}: schema {data['schema']!r} is none of {', '.join(known_schemas)}: use the version of twin that "
            "wrote it"
        )
    content = dict(data)
    del content["sha256"]
    # The form without spaces in which `twin prove` took the hash: layout and order of keys of the file do not count.
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    if hashlib.sha256(text.encode("ascii")).hexdigest() != data["sha256"]:
        raise ValueError("its content does not have the SHA-256 that it states")
    if data["schema"] == SCHEMA and not data["claims"]:
        raise ValueError("it has no claim")
    return data


def _compare_files(proved: Mapping[str, str], files: Mapping[str, str], ledger: Ledger) -> None:
    """Add an error for each file that is not the one that was proved."""
    for name in sorted({*proved, *files}):
        if proved.get(name) != files.get(name):
            text = f"{name} is not the file that was proved: its SHA-256 is another"
            ledger.add(
                "certificate.other_file", "error", text, suggestion="Run `twin prove` for the files as they are."
            )


def _judge(data: Mapping[str, Any], ledger: Ledger) -> None:
    """Add a row for each claim, and a finding for each that does not hold."""
    claims = data["claims"]
    states_within_reach = [0] * len(claims)
    largest = [0.0] * len(claims)
    wrong: dict[int, Decimal] = {}
    generator = random.SystemRandom()  # no state that the author of a certificate could foresee
    with localcontext(Context(prec=DIGITS)):
        constants: dict[int, Bounded | None] = {}
        for row_number, row in enumerate(data["rows"]):
            if row[0] in ("number", "real"):
                constants[row_number] = _constant(row)
        for _ in range(_MOST_STATES):
            if min(states_within_reach) >= STATES:
                break
            state = _random_state(data["ranges"], generator)
            values = _values(data["rows"], constants, state)
            for claim_number, claim in enumerate(claims):
                zeros = _judged_zeros(claim, values)
                if zeros is None:
                    continue
                states_within_reach[claim_number] += 1
                for zero, error in zeros:
                    largest[claim_number] = max(largest[claim_number], abs(float(zero)))
                    # Farther from zero than its rounding error can put it: no more digits would make it zero.
                    if abs(zero) > Decimal(error):
                        wrong[claim_number] = max(wrong.get(claim_number, zero), zero, key=abs)
    for claim_number, claim in enumerate(claims):
        # A constant that is zero would hold at every state, whatever the equations are.
        if not any(_depends(data["rows"], row_number) for row_number in claim["zero"]):
            raise ValueError(f"the claim {claim['name']} does not depend on the state")
        where = claim["name"]
        count = states_within_reach[claim_number]
        if count < STATES:
            text = f"only {count} of {_MOST_STATES} drawn states are within reach, {STATES} are needed"
            ledger.add("certificate.out_of_reach", "error", text, where)
        ledger.row("claim", largest[claim_number], "", LIMIT, where=where)
        if claim_number in wrong:
            text = f"it does not hold that {claim['claim']}: a number that must be zero is {wrong[claim_number]:.3g}"
            ledger.wrong("certificate.wrong", text, where)


def _judged_zeros(claim: Mapping[str, Any], values: Sequence[Number]) -> list[Bounded] | None:
    """Return the numbers that a claim says are zero; None where the state is out of reach, or they are too inexact."""
    margins = _row_numbers(claim["reach"], values)
    zeros: list[Bounded] = []
    for zero in _row_numbers(claim["zero"], values):
        if zero is None:
            return None
        zeros.append(zero)
    for margin in margins:
        if margin is None or margin[0] < 0:
            return None
    for _, error in zeros:
        if not error <= LIMIT:  # also if the error is not a number
            return None
    return zeros


def _judge_motion(motion: Mapping[str, Any], samples: MotionSampler, ledger: Ledger) -> None:
    """Add a row of the bounds along a protocol, and a finding for each that a sample exceeds."""
    name = str(motion["protocol"])
    try:
        extremes = samples.extremes(motion)
    except TwinError as error:
        ledger.add("certificate.motion", "error", f"{name}: its bounds cannot be checked: {error}", name)
        return
    worst = 0.0
    not_sampled = []
    _judge_limits(name, motion["proved"], ledger)
    for row in motion["proved"]:
        description = f"{row['kind']} {row['value']}"
        if ("at least" in row) == ("at most" in row):
            raise ValueError(f"{name}: {description} has not either a lower or an upper bound")
        if (row["kind"], row["value"]) not in extremes:
            # every value that is proved is sampled: a value of another name would hide its bound
            ledger.add("certificate.motion", "error", f"{name}: there is no {description} to sample", name)
            continue
        smallest, largest, unknown_count = extremes[row["kind"], row["value"]]
        if math.isnan(smallest):
            not_sampled.append(description)
            continue
        if unknown_count:
            not_sampled.append(f"{description} at {unknown_count} times")
        if "at least" in row:
            sample = smallest
            beyond = float(row["at least"]) - smallest
        else:
            sample = largest
            beyond = largest - float(row["at most"])
        relative = beyond / max(1.0, abs(smallest), abs(largest))
        worst = max(worst, relative)
        if not relative <= SAMPLED:
            text = f"{name}: {row['kind']} {row['value']}: a sample is {sample:.6g}, beyond its bound by {beyond:.3g}"
            ledger.wrong("certificate.wrong", text, name)
    ledger.row("protocol", worst, "", SAMPLED, where=name)
    if not_sampled:
        ledger.add("certificate.motion", "info", f"{name}: not sampled: {', '.join(not_sampled)}", name)


def _judge_limits(name: str, rows: Sequence[Mapping[str, Any]], ledger: Ledger) -> None:
    """Add a finding for each bound that is beyond its limit."""
    for row in rows:
        if "limit" in row and not _within_limit(row):
            text = f"{name}: {row['kind']} {row['value']}: its bound is beyond its limit {row['limit']}"
            ledger.wrong("certificate.wrong", text, name)


def _within_limit(row: Mapping[str, Any]) -> bool:
    """Return whether the bound of a row is within its limit: a speed may exceed it by 1/1000, a joint by rounding."""
    limit = float(row["limit"])
    if "at least" in row:
        return float(row["at least"]) >= limit - TOUCHING
    if str(row["kind"]).endswith("speed"):
        limit *= 1.0 + SPEED_EXCESS
    return float(row["at most"]) <= limit


def _row_numbers(row_numbers: Sequence[int], values: Sequence[Number]) -> list[Bounded | None]:
    """Return the values of rows as numbers; ValueError if there is no such row.

    Python would count a negative number of a row from the end.
    """
    numbers = []
    for row_number in row_numbers:
        if not 0 <= row_number < len(values):
            raise ValueError(f"there is no row {row_number}")
        numbers.append(_number(values[row_number]))
    return numbers


def _depends(rows: Sequence[Sequence[Any]], result: int) -> bool:
    """Return whether a row depends on the state."""
    waiting = [result]
    visited_rows: set[int] = set()
    while waiting:
        row_number = waiting.pop()
        if row_number in visited_rows:
            continue
        # Rows share operands: without this, the search would take a time exponential in their depth.
        visited_rows.add(row_number)
        if rows[row_number][0] in ("input", "cosine", "sine"):
            return True
        for operand in rows[row_number][1:]:
            if isinstance(operand, int):
                waiting.append(operand)
    return False


def _number(value: Number) -> Bounded | None:
    """Return a value as a number; a condition is 1 or 0."""
    if isinstance(value, bool):
        return Decimal(value), 0.0
    return value


def _random_state(ranges: Mapping[str, Any], generator: random.Random) -> dict[str, tuple[Bounded, Bounded]]:
    """Return a random state: {name: (number, number), or cosine and sine of an angle}."""
    state = {}
    for name, (is_angle, low, high) in ranges.items():
        if not low < high:
            raise ValueError(f"the range of {name} is empty")
        drawn_value = generator.uniform(low, high)
        if is_angle:
            middle = round((low + high) / 2 / (math.pi / 6))
            state[name] = _cosine_and_sine(drawn_value, middle)
        else:
            number = (Decimal(drawn_value), 0.0)
            state[name] = (number, number)
    return state


def _cosine_and_sine(angle: float, middle: int) -> tuple[Bounded, Bounded]:
    """Return cosine and sine of an angle near one in rad, which is drawn around `middle` times 30 degrees."""
    # half the distance has a rational tangent; it is large near half a turn, which does no harm
    half = math.remainder(angle - middle * math.pi / 6, 2 * math.pi) / 2
    tangent = Decimal(math.tan(half))
    # The formulas of the half angle: with a rational tangent, both are exact but for the last digit.
    distance_cosine = (1 - tangent * tangent) / (1 + tangent * tangent)
    distance_sine = 2 * tangent / (1 + tangent * tangent)
    root_3_half = Decimal(3).sqrt() / 2
    first_quarter = [(Decimal(1), Decimal(0)), (root_3_half, Decimal("0.5")), (Decimal("0.5"), root_3_half)]
    cosine, sine = first_quarter[middle % 3]
    for _ in range(middle // 3 % 4):  # a quarter turn each
        cosine, sine = -sine, cosine
    turned_cosine = cosine * distance_cosine - sine * distance_sine
    turned_sine = sine * distance_cosine + cosine * distance_sine
    return (turned_cosine, _STEP), (turned_sine, _STEP)


def _constant(row: Sequence[Any]) -> Bounded | None:
    """Return a constant, as "1/2*sqrt(3) + 5*sqrt(1)", or a real number without an exact form."""
    if row[0] == "real":
        number = Decimal(row[1])
        if not number.is_finite():
            return None
        return number, 0.0
    total = Decimal(0)
    error = 0.0
    for word in row[1].split(" + "):
        term_match = re.fullmatch(r"(-?\d+)(?:/(\d+))?\*sqrt\(([1236])\)", word)
        if term_match is None:
            raise ValueError(f"{word!r} is not a number")
        numerator, denominator, radicand = term_match.groups()
        part = Decimal(numerator) / Decimal(denominator or 1) * Decimal(radicand).sqrt()
        total += part
        error += (abs(float(part)) + abs(float(total))) * _STEP
    return total, error


def _values(
    rows: Sequence[Sequence[Any]],
    constants: Mapping[int, Bounded | None],
    state: Mapping[str, tuple[Bounded, Bounded]],
) -> list[Number]:
    """Return the values of all rows at a state."""
    values: list[Number] = []
    for row_number, row in enumerate(rows):
        name = row[0]
        if row_number in constants:
            values.append(constants[row_number])
        elif name in ("input", "cosine"):
            values.append(state[row[1]][0])
        elif name == "sine":
            values.append(state[row[1]][1])
        else:
            operands = []
            for operand in row[1:]:
                if not 0 <= operand < row_number:
                    raise ValueError(f"row {row_number} needs a row that is not before it")
                operands.append(values[operand])
            values.append(_result(name, operands))
    return values


def _result(name: str, operands: Sequence[Any]) -> Number:
    """Return the result of an operation; None if it is not defined."""
    # Before the test for None: the branch that is not taken may be undefined, as a root of a negative number is.
    if name == "choose":
        condition, first, second = operands
        if condition is None:
            return None
        if condition:
            return first
        return second
    if None in operands:
        return None
    if name in _LOGIC:
        return _LOGIC[name](*operands)
    numbers = map(_number, operands)
    return _OPERATIONS[name](*numbers)


def _add(a: Bounded, b: Bounded) -> Bounded:
    total = a[0] + b[0]
    return total, (a[1] + b[1] + abs(float(total)) * _STEP) * _UP


def _multiply(a: Bounded, b: Bounded) -> Bounded:
    product = a[0] * b[0]
    error = abs(float(a[0])) * b[1] + abs(float(b[0])) * a[1] + a[1] * b[1]
    return product, (error + abs(float(product)) * _STEP) * _UP


def _inverse(a: Bounded) -> Bounded | None:
    """Return 1 / a; it is not defined where a may be zero."""
    size = abs(float(a[0]))
    if size <= a[1]:
        return None
    inverse = 1 / a[0]
    return inverse, (a[1] / size / (size - a[1]) + abs(float(inverse)) * _STEP) * _UP


def _root(x: Bounded) -> Bounded | None:
    """Return the root of a number; below zero by no more than its error, it is zero."""
    number, error = x
    if number < -Decimal(error):
        return None
    root = max(number, Decimal(0)).sqrt()
    # Near zero, an error of the number becomes its root in the root; farther away, the derivative bounds it better.
    spread = math.sqrt(2 * error)
    if error < float(number):
        spread = min(spread, error / float(root))
    return root, (spread + float(root) * _STEP) * _UP


def _angle(cosine: Bounded, sine: Bounded) -> Bounded:
    # Decimals have no arc tangent; that of the processor has a bound of its own.
    return Decimal(math.atan2(sine[0], cosine[0])), _ANGLE


_UP = 1 + 1e-12
"""Factor above the rounding errors of a bound in double precision."""

_OPERATIONS: dict[str, Callable[..., Number]] = {
    "add": _add,
    "multiply": _multiply,
    "negative": lambda a: (-a[0], a[1]),
    "inverse": _inverse,
    "root": _root,
    "angle": _angle,
    "less": lambda a, b: a[0] < b[0],
    "at most": lambda a, b: a[0] <= b[0],
    "equal": lambda a, b: a[0] == b[0],
}

_LOGIC: dict[str, Callable[..., bool]] = {
    "both": lambda a, b: bool(a and b),
    "one of": lambda a, b: bool(a or b),
    "not": lambda a: not a,
}
