"""Check a certificate of `twin prove`: its operations are repeated with decimals of 60 digits at random states.

No code of the prover is used. It calculates modulo primes, where a root has no sign; here each number has 60 digits and
each root its sign, so that what is not zero by 1e-25 is no identity.
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
from typing import Any

from twin.core.errors import TwinError
from twin.exchange.audit.report import AuditReport, Ledger, finished

SCHEMA = "twin/certificate/1"

DIGITS = 60
"""Number of digits of all calculations."""

LIMIT = Decimal("1e-25")
"""Largest size of a zero: near a singularity, an error of 1e-60 becomes its root, and is multiplied."""

STATES = 24
"""Number of states within reach at which each claim is judged."""

_MOST_STATES = 2000
"""Number of states that are drawn at most."""

_WIDEST = 3.1
"""Largest angle in rad to each side: the tangent of half of it must be a moderate number."""

_BEGINNING = 200
"""Number of bytes in which a certificate says what it is."""

Number = Decimal | bool | None
"""A value, a condition, or None where a value is not defined."""


def is_certificate(path: Path) -> bool:
    """Return whether a file begins as a certificate of a proof does, of any version."""
    if path.suffix != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        return b'"twin/certificate/' in file.read(_BEGINNING)


def audit_certificate(path: Path, files: Mapping[str, str] | None = None) -> AuditReport:
    """Return the report on a certificate.

    Args:
        path: the certificate.
        files: {file of equations or mechanism: its SHA-256}; they must be those that were proved. None: not compared.
    """
    ledger = Ledger(path.name, "decimals of 60 digits", "1")
    try:
        data = _read(path)
        if files is not None:
            _compare_files(data["files"], files, ledger)
        _judge(data, ledger)
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, ArithmeticError) as error:
        text = f"it cannot be checked, because it was changed or cut: {type(error).__name__}: {error}"
        ledger.add("certificate.unreadable", "error", text, suggestion="Let `twin prove` write it again.")
    return finished(str(path), [], [ledger])


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a certificate whose hash is that of its content."""
    data = json.loads(path.read_text(encoding="utf-8"))
    if data["schema"] != SCHEMA:
        raise TwinError(f"{path}: schema {data['schema']!r} is not {SCHEMA!r}: use the version of twin that wrote it")
    content = {key: value for key, value in data.items() if key != "sha256"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    if hashlib.sha256(text.encode("ascii")).hexdigest() != data["sha256"]:
        raise ValueError("its content does not have the SHA-256 that it states")
    if not data["claims"]:
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
    seen = [0] * len(claims)
    largest = [Decimal(0)] * len(claims)
    generator = random.SystemRandom()  # no state that the author of a certificate could foresee
    with localcontext(Context(prec=DIGITS)):
        constants = {i: _constant(row) for i, row in enumerate(data["rows"]) if row[0] in ("number", "real")}
        for _ in range(_MOST_STATES):
            if min(seen) >= STATES:
                break
            values = _values(data["rows"], constants, _drawn(data["ranges"], generator))
            for k, claim in enumerate(claims):
                reach = [values[_place(i, values)] for i in claim["reach"]]
                zeros = [values[_place(i, values)] for i in claim["zero"]]
                if None in zeros or any(margin is None or margin < 0 for margin in reach):
                    continue
                seen[k] += 1
                largest[k] = max([largest[k], *(abs(Decimal(zero)) for zero in zeros if zero is not None)])
    for k, claim in enumerate(claims):
        if not any(_depends(data["rows"], i) for i in claim["zero"]):
            raise ValueError(f"the claim {claim['name']} does not depend on the state")
        where = claim["name"]
        if seen[k] < STATES:
            text = f"only {seen[k]} of {_MOST_STATES} drawn states are within reach, {STATES} are needed"
            ledger.add("certificate.out_of_reach", "error", text, where)
        ledger.row("claim", float(largest[k]), "", float(LIMIT), where=where)
        if largest[k] > LIMIT:
            text = f"it does not hold that {claim['claim']}: a number that must be zero is {float(largest[k]):.3g}"
            ledger.wrong("certificate.wrong", text, where)


def _place(i: int, values: Sequence[Number]) -> int:
    """Return the number of a row; raise an error if there is none."""
    if not 0 <= i < len(values):
        raise ValueError(f"there is no row {i}")
    return i


def _depends(rows: Sequence[Sequence[Any]], result: int) -> bool:
    """Return whether a row depends on the state."""
    waiting = [result]
    seen: set[int] = set()
    while waiting:
        i = waiting.pop()
        if i in seen:
            continue
        seen.add(i)
        if rows[i][0] in ("input", "cosine", "sine"):
            return True
        waiting += [operand for operand in rows[i][1:] if isinstance(operand, int)]
    return False


def _drawn(ranges: Mapping[str, Any], generator: random.Random) -> dict[str, tuple[Decimal, Decimal]]:
    """Return a random state: {name: (number, number), or cosine and sine of an angle}."""
    state = {}
    for name, (is_angle, low, high) in ranges.items():
        if not low < high:
            raise ValueError(f"the range of {name} is empty")
        if not is_angle:
            x = Decimal(generator.uniform(low, high))
            state[name] = (x, x)
            continue
        half = generator.uniform(max(low, -_WIDEST), min(high, _WIDEST)) / 2
        t = Decimal(math.tan(half))
        state[name] = ((1 - t * t) / (1 + t * t), 2 * t / (1 + t * t))
    return state


def _constant(row: Sequence[Any]) -> Decimal | None:
    """Return a constant, as "1/2*sqrt(3) + 5*sqrt(1)", or a real number without an exact form."""
    if row[0] == "real":
        number = Decimal(row[1])
        return number if number.is_finite() else None
    total = Decimal(0)
    for word in row[1].split(" + "):
        found = re.fullmatch(r"(-?\d+)(?:/(\d+))?\*sqrt\(([1236])\)", word)
        if found is None:
            raise ValueError(f"{word!r} is not a number")
        numerator, denominator, radicand = found.groups()
        total += Decimal(numerator) / Decimal(denominator or 1) * Decimal(radicand).sqrt()
    return total


def _values(
    rows: Sequence[Sequence[Any]],
    constants: Mapping[int, Decimal | None],
    state: Mapping[str, tuple[Decimal, Decimal]],
) -> list[Number]:
    """Return the values of all rows at a state."""
    values: list[Number] = []
    for i, row in enumerate(rows):
        name = row[0]
        if i in constants:
            values.append(constants[i])
        elif name in ("input", "cosine"):
            values.append(state[row[1]][0])
        elif name == "sine":
            values.append(state[row[1]][1])
        else:
            if any(not 0 <= operand < i for operand in row[1:]):
                raise ValueError(f"row {i} needs a row that is not before it")
            values.append(_result(name, [values[operand] for operand in row[1:]]))
    return values


def _result(name: str, operands: Sequence[Any]) -> Number:
    """Return the result of an operation; None if it is not defined."""
    if name == "choose":
        condition, first, second = operands
        if condition is None:
            return None
        return first if condition else second
    if None in operands:
        return None
    return _OPERATIONS[name](*operands)


def _root(x: Decimal) -> Decimal | None:
    if x < -LIMIT:
        return None
    return max(x, Decimal(0)).sqrt()


def _angle(cosine: Decimal, sine: Decimal) -> Decimal:
    return Decimal(math.atan2(sine, cosine))


_OPERATIONS: dict[str, Callable[..., Number]] = {
    "add": lambda a, b: a + b,
    "multiply": lambda a, b: a * b,
    "negative": lambda a: -a,
    "inverse": lambda a: 1 / a if a else None,
    "root": _root,
    "angle": _angle,
    "less": lambda a, b: a < b,
    "at most": lambda a, b: a <= b,
    "equal": lambda a, b: a == b,
    "both": lambda a, b: a and b,
    "one of": lambda a, b: a or b,
    "not": lambda a: not a,
}
