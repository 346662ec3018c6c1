"""A published table of first and second moments of mass, compared with physical limits.

With tensor J and first moment h about one origin, Sigma = tr(J)/2 I - J is the second moment of the mass itself. A body
is physically possible only if J and Sigma are positive definite (the latter is the triangle inequality) and its mass m
makes [[Sigma, h], [h', m]] positive semidefinite, that is m >= h' Sigma^-1 h. This is the only check of masses that
were never published. It also determines the sign of the products of inertia: if they are printed as +integral(x y dm),
as CAD programs do, they must be negated in the tensor, and only the correct sign gives plausible masses.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core.findings import Finding, disagreement, warning
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.schema import Table, at, load_toml
from twin.validation.masses.possible import least_mass

Cell = Literal["mx", "my", "mz", "xx", "yy", "zz", "xy", "xz", "yz"]
Products = Literal["as printed", "negated"]

_LOST = re.compile(r"(-?)(\d)(\d+)([eE][-+]\d+)")
"""A number in scientific notation without its decimal mark."""


class First(Table):
    """First moments in kg m."""

    mx: float
    my: float
    mz: float


class Second(Table):
    """Second moments in kg m2, products with the printed sign."""

    xx: float
    yy: float
    zz: float
    xy: float
    xz: float
    yz: float


class Repair(Table):
    """A misprinted cell."""

    cell: Cell
    printed: str
    label: str = ""


class Body(Table):
    """One row of the tables."""

    name: str
    first: First
    second: Second
    repaired: list[Repair] = Field(default_factory=list)

    @model_validator(mode="after")
    def _repaired_by_rule(self) -> Body:
        for r in self.repaired:
            value = getattr(self.first if r.cell.startswith("m") else self.second, r.cell)
            if reread(r.printed) != value:
                raise at("repaired", f"{r.cell}: '{r.printed}' reads {reread(r.printed):g} by the rule, not {value:g}")
        return self


class Exhibit(Table):
    """The file of an exhibit (published tables); rows are ordered from the base outwards."""

    title: str
    source: str
    body: list[Body] = Field(min_length=1)


@dataclass(frozen=True)
class Row:
    """Physical limits that follow from one row of the tables.

    Attributes:
        name: name of the row.
        definite: J is positive definite for both signs of the products.
        slack: kg m2, sum of the two smaller principal moments minus the largest; negative breaks the triangle
            inequality.
        mass_printed: kg, smallest mass with the products as printed; infinite if no mass is possible.
        mass_negated: kg, with the products negated.
        repaired: cells that had to be repaired.
    """

    name: str
    definite: bool
    slack: float
    mass_printed: float
    mass_negated: float
    repaired: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def load(path: Path) -> Exhibit:
    """Read an exhibit.

    Raises:
        DescriptionError: file, line, key, value and the allowed values; also a repair that contradicts the rule of
            `reread`.
    """
    return load_toml(path, Exhibit)


def reread(printed: str) -> float:
    """Return a printed number: digits before an exponent have lost the decimal mark after the first one.

    Other words are removed. "Type 896572e-06" is 8.96572e-06. A number with its mark, a point or a comma, is read
    unchanged.
    """
    text = printed.split()[-1].replace(",", ".")
    found = _LOST.fullmatch(text)
    return float("{}{}.{}{}".format(*found.groups()) if found else text)


def tensor(body: Body, products: Products) -> Array:
    """Return J (3, 3) in kg m2 with the printed products unchanged, or negated."""
    s = body.second
    sign = -1.0 if products == "negated" else 1.0
    xy, xz, yz = sign * s.xy, sign * s.xz, sign * s.yz
    return np.array([[s.xx, xy, xz], [xy, s.yy, yz], [xz, yz, s.zz]])


def recompute(exhibit: Exhibit) -> tuple[list[Row], list[Finding]]:
    """Return (rows with their physical limits, findings on the tables)."""
    rows = []
    for body in exhibit.body:
        h = np.array([body.first.mx, body.first.my, body.first.mz])
        plain, negated = tensor(body, "as printed"), tensor(body, "negated")
        moments = [np.linalg.eigvalsh(J) for J in (plain, negated)]
        rows.append(
            Row(
                body.name,
                all(m[0] > 0 for m in moments),
                min(float(m[0] + m[1] - m[2]) for m in moments),
                least_mass(plain, h),
                least_mass(negated, h),
                tuple(r.cell for r in body.repaired),
            )
        )
    found = [*_repairs(exhibit), *_impossible(rows), *_products(rows)]
    if falling(rows, convention(rows)):
        found.append(
            warning(
                "inertia.composites",
                exhibit.title,
                "minimum masses decrease from row to row: the rows read as composites (each link with all that it "
                "carries) and must not be used as inertias of single links",
                suggestion="this is inferred: masses are not published, and other decompositions are possible",
            )
        )
    return rows, found


def convention(rows: list[Row]) -> Products:
    """Return the sign of the products ("printed" or "negated") that requires less total mass."""
    plain, negated = (sum(getattr(r, m) for r in rows) for m in ("mass_printed", "mass_negated"))
    return "negated" if negated < plain else "as printed"


def falling(rows: list[Row], products: Products) -> bool:
    """Return whether the minimum masses decrease from row to row, as they do for composites of links."""
    masses = [r.mass_negated if products == "negated" else r.mass_printed for r in rows]
    return len(masses) > 1 and all(a > b for a, b in pairwise(masses))


def _repairs(exhibit: Exhibit) -> list[Finding]:
    out = []
    for body in exhibit.body:
        for r in body.repaired:
            label = f" under the label '{r.label}'" if r.label else ""
            out.append(
                warning(
                    "inertia.repaired",
                    f"{body.name}.{r.cell}",
                    f"row {body.name}, {r.cell}: '{r.printed}' is printed{label}; read as {reread(r.printed):g}",
                )
            )
    return out


def _impossible(rows: list[Row]) -> list[Finding]:
    out = []
    for r in rows:
        why = [] if r.definite else ["is not positive definite"]
        why += [] if r.slack > 0 else [f"breaks the triangle inequality by {-r.slack:.3g} kg m2"]
        if why:
            out.append(
                disagreement(
                    "inertia.impossible", r.name, f"row {r.name}: no body has this tensor: it {' and '.join(why)}"
                )
            )
    return out


def _products(rows: list[Row]) -> list[Finding]:
    if convention(rows) == "as printed":
        return []
    plain, negated = sum(r.mass_printed for r in rows), sum(r.mass_negated for r in rows)
    worst = max(rows, key=lambda r: r.mass_printed / r.mass_negated if r.mass_negated else 0.0)
    return [
        disagreement(
            "inertia.products",
            worst.name,
            "products of inertia are printed as +integral(x y dm): taken as entries of the tensor, the rows "
            f"require at least {plain:.2f} kg in total, row {worst.name} alone {worst.mass_printed:.3f} kg; "
            f"negated, {negated:.2f} kg and {worst.mass_negated:.3f} kg",
            Quantity(plain, "kg"),
            negated,
            "negate the products to build the tensor",
            word="",
        )
    ]
