"""A published table of first and second moments of mass, held against what bodies can have.

With tensor J and first moment h about one origin, Sigma = tr(J)/2 I - J is the second moment of the mass itself. A
body exists only if J and Sigma are positive definite (the latter is the triangle inequality) and its mass m makes
[[Sigma, h], [h', m]] positive semidefinite, that is m >= h' Sigma^-1 h: the only check of masses that were never
published. It also tells the sign of the products: printed as +integral(x y dm), as CAD does, they must be negated
to stand in the tensor, and only the right reading asks for masses that a chain of links can have.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core.findings import Finding
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
    """A cell that is not printed as it must be read."""

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
    """The whole file; rows from the base outwards."""

    title: str
    source: str
    body: list[Body] = Field(min_length=1)


@dataclass(frozen=True)
class Row:
    """What one row of the tables implies.

    Attributes:
        name: of the row.
        definite: J is positive definite for both signs of the products.
        slack: kg m2, smaller two principal moments less the largest; negative breaks the triangle inequality.
        mass_printed: kg, smallest mass with the products as printed; infinite if no mass would do.
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
        DescriptionError: file, line, key, value and what would be right; also a repair that the rule does not make.
    """
    return load_toml(path, Exhibit)


def reread(printed: str) -> float:
    """Return a printed number: digits before an exponent have lost the mark after the first; stray words go.

    "Type 896572e-06" is 8.96572e-06. What has its mark, a point or a comma, is taken as it stands.
    """
    text = printed.split()[-1].replace(",", ".")
    found = _LOST.fullmatch(text)
    return float("{}{}.{}{}".format(*found.groups()) if found else text)


def tensor(body: Body, products: Products) -> Array:
    """Return J (3, 3) in kg m2 with the printed products as they are, or negated."""
    s = body.second
    sign = -1.0 if products == "negated" else 1.0
    xy, xz, yz = sign * s.xy, sign * s.xz, sign * s.yz
    return np.array([[s.xx, xy, xz], [xy, s.yy, yz], [xz, yz, s.zz]])


def recompute(exhibit: Exhibit) -> tuple[list[Row], list[Finding]]:
    """Return every row with what it implies, and what the tables do not say or say wrongly."""
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
            Finding(
                "inertia.composites",
                "warning",
                "smallest masses fall from row to row: the rows read as composites, each link with all that it "
                "carries; as dynamics of single links they would count masses several times",
                where=exhibit.title,
                suggestion="an inference: masses are not published, and no decomposition is the only one",
            )
        )
    return rows, found


def convention(rows: list[Row]) -> Products:
    """Return how the products must be taken: the reading that asks for less mass in all."""
    plain, negated = (sum(getattr(r, m) for r in rows) for m in ("mass_printed", "mass_negated"))
    return "negated" if negated < plain else "as printed"


def falling(rows: list[Row], products: Products) -> bool:
    """Return whether the smallest masses fall from row to row, as those of composites of links do."""
    masses = [r.mass_negated if products == "negated" else r.mass_printed for r in rows]
    return len(masses) > 1 and all(a > b for a, b in pairwise(masses))


def audit_report(robot: Any) -> tuple[Exhibit | None, list[Row], list[Finding]]:
    """Return the audit of a robot's `exhibit.toml`, beside its description; nothing if it has none.

    Args:
        robot: as `twin.load` returns it: `files` is None or has the folder `cad`.
    """
    path = None if robot.files is None else Path(robot.files.cad) / "exhibit.toml"
    if path is None or not path.is_file():
        return None, [], []
    exhibit = load(path)
    return exhibit, *recompute(exhibit)


def _repairs(exhibit: Exhibit) -> list[Finding]:
    out = []
    for body in exhibit.body:
        for r in body.repaired:
            label = f" under the label '{r.label}'" if r.label else ""
            out.append(
                Finding(
                    "inertia.repaired",
                    "warning",
                    f"row {body.name}, {r.cell}: '{r.printed}' is printed{label}; read as {reread(r.printed):g}",
                    where=f"{body.name}.{r.cell}",
                )
            )
    return out


def _impossible(rows: list[Row]) -> list[Finding]:
    out = []
    for r in rows:
        why = [] if r.definite else ["is not positive definite"]
        why += [] if r.slack > 0 else [f"breaks the triangle inequality by {-r.slack:.3g} kg m2"]
        if why:
            text = f"row {r.name}: the tensor {' and '.join(why)}: no body has it"
            out.append(Finding("inertia.impossible", "disagreement", text, where=r.name))
    return out


def _products(rows: list[Row]) -> list[Finding]:
    if convention(rows) == "as printed":
        return []
    plain, negated = sum(r.mass_printed for r in rows), sum(r.mass_negated for r in rows)
    worst = max(rows, key=lambda r: r.mass_printed / r.mass_negated if r.mass_negated else 0.0)
    return [
        Finding(
            "inertia.products",
            "disagreement",
            f"products of inertia are printed as +integral(x y dm): taken as entries of the tensor, the rows need at "
            f"least {plain:.2f} kg in all, row {worst.name} alone {worst.mass_printed:.3f} kg; negated, "
            f"{negated:.2f} kg and {worst.mass_negated:.3f} kg",
            where=worst.name,
            size=plain,
            unit="kg",
            limit=negated,
            suggestion="negate the products to build the tensor",
        )
    ]
