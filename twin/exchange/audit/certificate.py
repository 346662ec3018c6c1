"""Check a certificate of `twin prove`: of equations, or of a bound, a workspace or a motion, in files of their own.

A certificate of equations claims that numbers are zero at all states. Its operations are repeated with decimals of 60
digits at random states. No code of the prover is used: it calculates modulo primes, where a root has no sign; here
each number has 60 digits, a bound of its rounding error, and each root its sign. What is farther from zero than its own
error is no identity. The entries:

    files    {file of equations or mechanism: its SHA-256}; sha256: that of the certificate without this entry
    ranges   {variable: [whether it is an angle, low, high]} in m and rad
    rows     operations, each [operation, number of a row before it, ...], or ["number" or "real", value],
             ["input", variable], ["cosine", variable], ["sine", variable]
    claims   {name, claim: as text, zero: numbers of rows that are zero, reach: rows that are not negative within reach}
    motions  bounds along protocols, which a sampler compares with samples of the mechanism
"""

from __future__ import annotations

import hashlib
import json
import math
import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from pathlib import Path
from typing import Protocol

from twin.core.errors import TwinError
from twin.core.json_types import JsonMapping, JsonObject
from twin.exchange.audit.bounds_certificate import SCHEMA as BOUNDS
from twin.exchange.audit.bounds_certificate import audit_bounds
from twin.exchange.audit.decimal_rows import (
    DIGITS,
    Bounded,
    Number,
    constant,
    depends_on_state,
    random_state,
    row_numbers,
    row_values,
)
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.motion_certificate import SCHEMA as MOTION
from twin.exchange.audit.motion_certificate import audit_motion_bounds
from twin.exchange.audit.report import AuditReport, finished
from twin.exchange.audit.workspace_certificate import SCHEMA as WORKSPACE
from twin.exchange.audit.workspace_certificate import audit_workspace

SCHEMA = "twin/certificate/1"

MAX_ROUNDING_ERROR = 1e-25
"""Largest rounding error at a state that counts: near a singularity, an error of 1e-60 becomes its root."""

STATES = 24
"""Number of states within reach at which each claim is judged."""

_MAX_STATES = 2000
"""Maximum number of random states, within reach and beyond."""

SAMPLE_TOLERANCE = 1e-8
"""Part by which a sample may be beyond a bound: errors of solvers, and of the series of a plan."""

LIMIT_TOLERANCE = 1e-12
"""Distance in m or rad by which a joint may be beyond its limit."""

SPEED_EXCESS = 1e-3
"""Part by which a speed may exceed its limit, as the samples of a plan."""

_HEAD_BYTES = 200
"""Number of bytes in which a certificate says what it is."""

_SCHEMA_START = re.compile(rb'"twin/(?:[a-z]+-)?certificate/')
"""Beginning of the schema of a certificate, of identities or of bounds."""


def is_certificate(path: Path) -> bool:
    """Return whether a file begins as a certificate of a proof does, of any version."""
    if path.suffix != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        return _SCHEMA_START.search(file.read(_HEAD_BYTES)) is not None


class MotionSampler(Protocol):
    """Samples what a mechanism does along a protocol, without the prover."""

    def extremes(self, entry: JsonMapping) -> Mapping[tuple[str, str], tuple[float, float, int]]:
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
            _judge_claims(data, ledger)
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


def _read(path: Path) -> JsonObject:
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


@dataclass
class _ClaimRecord:
    """What the states within reach have shown of a claim.

    Attributes:
        states: number of these states.
        largest: largest size of a number that must be zero.
        wrong: the largest such number that is farther from zero than its rounding error; None without one.
    """

    states: int = 0
    largest: float = 0.0
    wrong: Decimal | None = None

    def add(self, zeros: Sequence[Bounded]) -> None:
        """Add the numbers of a state that must be zero."""
        self.states += 1
        for zero, error in zeros:
            self.largest = max(self.largest, abs(float(zero)))
            # Farther from zero than its rounding error can put it: no more digits would make it zero.
            if abs(zero) > Decimal(error) and (self.wrong is None or abs(zero) > abs(self.wrong)):
                self.wrong = zero


def _judge_claims(data: JsonMapping, ledger: Ledger) -> None:
    """Add a row for each claim, and a finding for each that does not hold."""
    rows = data["rows"]
    claims = data["claims"]
    records = [_ClaimRecord() for _ in claims]
    generator = random.SystemRandom()  # no state that the author of a certificate could foresee
    with localcontext(Context(prec=DIGITS)):
        constants: dict[int, Bounded | None] = {}
        for row_number, row in enumerate(rows):
            if row[0] in ("number", "real"):
                constants[row_number] = constant(row)
        for _ in range(_MAX_STATES):
            if min(record.states for record in records) >= STATES:
                break
            values = row_values(rows, constants, random_state(data["ranges"], generator))
            for claim, record in zip(claims, records, strict=True):
                zeros = _zeros_within_reach(claim, values)
                if zeros is not None:
                    record.add(zeros)
    for claim, record in zip(claims, records, strict=True):
        # A constant that is zero would hold at every state, whatever the equations are.
        if not any(depends_on_state(rows, row_number) for row_number in claim["zero"]):
            raise ValueError(f"the claim {claim['name']} does not depend on the state")
        where = claim["name"]
        if record.states < STATES:
            text = f"only {record.states} of {_MAX_STATES} drawn states are within reach, {STATES} are needed"
            ledger.add("certificate.out_of_reach", "error", text, where)
        ledger.row("claim", record.largest, "", MAX_ROUNDING_ERROR, where=where)
        if record.wrong is not None:
            text = f"it does not hold that {claim['claim']}: a number that must be zero is {record.wrong:.3g}"
            ledger.wrong("certificate.wrong", text, where)


def _zeros_within_reach(claim: JsonMapping, values: Sequence[Number]) -> list[Bounded] | None:
    """Return the numbers that a claim says are zero; None where the state is out of reach, or they are too inexact."""
    margins = row_numbers(claim["reach"], values)
    zeros: list[Bounded] = []
    for zero in row_numbers(claim["zero"], values):
        if zero is None:
            return None
        zeros.append(zero)
    for margin in margins:
        if margin is None or margin[0] < 0:
            return None
    for _, error in zeros:
        if not error <= MAX_ROUNDING_ERROR:  # also if the error is not a number
            return None
    return zeros


def _judge_motion(motion: JsonMapping, samples: MotionSampler, ledger: Ledger) -> None:
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
        if not relative <= SAMPLE_TOLERANCE:
            text = f"{name}: {row['kind']} {row['value']}: a sample is {sample:.6g}, beyond its bound by {beyond:.3g}"
            ledger.wrong("certificate.wrong", text, name)
    ledger.row("protocol", worst, "", SAMPLE_TOLERANCE, where=name)
    if not_sampled:
        ledger.add("certificate.motion", "info", f"{name}: not sampled: {', '.join(not_sampled)}", name)


def _judge_limits(name: str, rows: Sequence[JsonMapping], ledger: Ledger) -> None:
    """Add a finding for each bound that is beyond its limit."""
    for row in rows:
        if "limit" in row and not _within_limit(row):
            text = f"{name}: {row['kind']} {row['value']}: its bound is beyond its limit {row['limit']}"
            ledger.wrong("certificate.wrong", text, name)


def _within_limit(row: JsonMapping) -> bool:
    """Return whether the bound of a row is within its limit: a speed may exceed it by 1/1000, a joint by rounding."""
    limit = float(row["limit"])
    if "at least" in row:
        return float(row["at least"]) >= limit - LIMIT_TOLERANCE
    if str(row["kind"]).endswith("speed"):
        limit *= 1.0 + SPEED_EXCESS
    return float(row["at most"]) <= limit
