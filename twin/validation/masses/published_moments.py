"""Check published tables of first and second moments of mass against physical limits.

With the inertia tensor J and the first moment h about one origin, Sigma = tr(J)/2 I - J is the matrix of second
moments. A body is physically possible only if J and Sigma are positive definite; for Sigma this is the triangle
inequality. In addition, [[Sigma, h], [h^T, m]] must be positive semidefinite for the mass m of the body, that is, m >=
h^T Sigma^-1 h. If no masses were published, only these checks of the moments are possible. The minimum mass also shows
the sign of the products of inertia. CAD programs print products as +integral(x y dm); these must be negated in the
tensor, and only the correct sign gives plausible masses.
"""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core.findings import Finding, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.schema import Table, at, load_toml
from twin.validation.masses.physical_limits import least_mass

Cell = Literal["mx", "my", "mz", "xx", "yy", "zz", "xy", "xz", "yz"]
Products = Literal["as printed", "negated"]

_WITHOUT_DECIMAL_MARK = re.compile(r"(-?)(\d)(\d+)([eE][-+]\d+)")
"""Number in scientific notation without a decimal mark."""


class FirstMoments(Table):
    """First moments in kg m."""

    mx: float
    my: float
    mz: float


class SecondMoments(Table):
    """Second moments in kg m2, with the printed sign of the products."""

    xx: float
    yy: float
    zz: float
    xy: float
    xz: float
    yz: float


class RepairedCell(Table):
    """A repaired table cell: name of the cell, printed number (without decimal mark), and printed label."""

    cell: Cell
    printed: str
    label: str = ""


class BodyMoments(Table):
    """One table row: a body's first and second moments, and its misprinted cells."""

    name: str
    first: FirstMoments
    second: SecondMoments
    repaired: list[RepairedCell] = Field(default_factory=list)

    @model_validator(mode="after")
    def _repaired_by_rule(self) -> BodyMoments:
        for repair in self.repaired:
            moments_of = self.first if repair.cell.startswith("m") else self.second
            value = getattr(moments_of, repair.cell)
            reading = reread(repair.printed)
            if reading != value:
                raise at("repaired", f"{repair.cell}: '{repair.printed}' is read as {reading:g}, not {value:g}")
        return self


class Exhibit(Table):
    """File with published tables (an exhibit); its rows are ordered from the base outwards."""

    title: str
    source: str
    body: list[BodyMoments] = Field(min_length=1)


@dataclass(frozen=True)
class MassRow:
    """Physical limits that follow from one row of the tables.

    Attributes:
        definite: whether J is positive definite both with the products as printed and with the products negated.
        slack: sum of the two smaller principal moments minus the largest, in kg m2: the smaller of the values for both
            signs of the products. It is negative if the triangle inequality is violated.
        mass_printed: minimum mass in kg with the products as printed; infinite if no mass is possible.
        mass_negated: minimum mass in kg with the products negated; infinite if no mass is possible.
        repaired: names of the misprinted cells that were repaired.
    """

    name: str
    definite: bool
    slack: float
    mass_printed: float
    mass_negated: float
    repaired: tuple[str, ...]

    def as_dict(self) -> JsonObject:
        """Return the row as plain data."""
        return asdict(self)


def load(path: Path) -> Exhibit:
    """Read a file with published tables.

    Raises:
        DescriptionError: the file is invalid, or a repair contradicts `reread`; the message has file, line, key, value
            and the allowed values.
    """
    return load_toml(path, Exhibit)


def reread(printed: str) -> float:
    """Return a printed number, with its decimal mark restored if it is missing.

    In a number in scientific notation without decimal mark, the mark is inserted after the first digit. Words before
    the number are dropped: "Type 896572e-06" is 8.96572e-06. Other numbers, with point or comma, are read as printed.
    """
    text = printed.split()[-1].replace(",", ".")
    without_mark = _WITHOUT_DECIMAL_MARK.fullmatch(text)
    if without_mark:
        sign, first_digit, digits, exponent = without_mark.groups()
        text = f"{sign}{first_digit}.{digits}{exponent}"
    return float(text)


def moments(body: BodyMoments) -> tuple[Array, Array]:
    """Return (first moments (3,) in kg m, inertia tensor J (3, 3) in kg m2 with the products as printed)."""
    first = body.first
    second = body.second
    J = np.array(
        [
            [second.xx, second.xy, second.xz],
            [second.xy, second.yy, second.yz],
            [second.xz, second.yz, second.zz],
        ]
    )
    return np.array([first.mx, first.my, first.mz]), J


def negated(tensor: Array) -> Array:
    """Return a tensor (3, 3) with negated products of inertia."""
    return 2 * np.diag(np.diag(tensor)) - tensor


def recompute(exhibit: Exhibit) -> tuple[list[MassRow], list[Finding]]:
    """Return (rows with their physical limits, findings)."""
    rows = []
    for body in exhibit.body:
        first_moment, J = moments(body)
        J_negated = negated(J)
        definite = True
        slack = np.inf
        for tensor in (J, J_negated):
            small, middle, large = np.linalg.eigvalsh(tensor).tolist()  # in increasing order
            definite = definite and small > 0
            slack = min(slack, small + middle - large)
        repaired = tuple(repair.cell for repair in body.repaired)
        mass_printed = least_mass(J, first_moment)
        mass_negated = least_mass(J_negated, first_moment)
        rows.append(
            MassRow(
                body.name,
                definite=definite,
                slack=slack,
                mass_printed=mass_printed,
                mass_negated=mass_negated,
                repaired=repaired,
            )
        )
    findings = [*_findings_on_repairs(exhibit), *_findings_on_tensors(rows), *_findings_on_products(rows)]
    if masses_fall(rows, convention(rows)):
        findings.append(
            warning(
                "inertia.composites",
                exhibit.title,
                "minimum masses decrease from row to row: each row seems to combine a link with all links that "
                "it carries, so the rows must not be used as inertias of single links",
                suggestion="no masses are published, so the conclusion is not certain: other explanations are possible",
            )
        )
    return rows, findings


def convention(rows: list[MassRow]) -> Products:
    """Return the sign of the products, "as printed" or "negated", for which the sum of minimum masses is smaller."""
    mass_printed, mass_negated = _total_masses(rows)
    if mass_negated < mass_printed:
        return "negated"
    return "as printed"


def _total_masses(rows: list[MassRow]) -> tuple[float, float]:
    """Return the sums of the minimum masses in kg with the products as printed, and negated."""
    # exactly rounded, so that equal masses in another order have equal sums
    mass_printed = math.fsum(row.mass_printed for row in rows)
    mass_negated = math.fsum(row.mass_negated for row in rows)
    return mass_printed, mass_negated


def masses_fall(rows: list[MassRow], products: Products) -> bool:
    """Return whether the minimum masses decrease from row to row, as they do if each link includes all later links."""
    if len(rows) < 2:
        return False
    for row, following in pairwise(rows):  # from the base outwards
        if products == "negated":
            falls = row.mass_negated > following.mass_negated
        else:
            falls = row.mass_printed > following.mass_printed
        if not falls:
            return False
    return True


def _findings_on_repairs(exhibit: Exhibit) -> list[Finding]:
    """Return a warning for each misprinted cell, with the number as which it is read."""
    findings: list[Finding] = []
    for body in exhibit.body:
        for repair in body.repaired:
            label = ""
            if repair.label:
                label = f" under the label '{repair.label}'"
            reading = reread(repair.printed)
            text = f"row {body.name}, {repair.cell}: '{repair.printed}' is printed{label}; read as {reading:g}"
            findings.append(warning("inertia.repaired", f"{body.name}.{repair.cell}", text))
    return findings


def _findings_on_tensors(rows: list[MassRow]) -> list[Finding]:
    """Return a finding for each row whose tensor no body can have."""
    findings: list[Finding] = []
    for row in rows:
        violations: list[str] = []
        if not row.definite:
            violations.append("is not positive definite")
        if not row.slack > 0:
            violations.append(f"violates the triangle inequality by {-row.slack:.3g} kg m2")
        if violations:
            text = f"row {row.name}: the tensor is impossible: it {' and '.join(violations)}"
            findings.append(disagreement("inertia.impossible", row.name, text))
    return findings


def _findings_on_products(rows: list[MassRow]) -> list[Finding]:
    """Return a finding if the products of inertia are printed with the wrong sign; see `convention`."""
    if convention(rows) == "as printed":
        return []
    mass_printed, mass_negated = _total_masses(rows)
    worst = max(rows, key=_ratio_of_masses)
    return [
        disagreement(
            "inertia.products",
            worst.name,
            "the products of inertia are printed as +integral(x y dm): as printed, the rows require a mass of at "
            f"least {mass_printed:.2f} kg in total, and row {worst.name} alone {worst.mass_printed:.3f} kg; with "
            f"negated products, {mass_negated:.2f} kg and {worst.mass_negated:.3f} kg",
            size=Quantity(mass_printed, "kg"),
            limit=mass_negated,
            suggestion="negate the products to build the tensor",
            word="",
        )
    ]


def _ratio_of_masses(row: MassRow) -> float:
    if not row.mass_negated:
        return 0.0
    return row.mass_printed / row.mass_negated
