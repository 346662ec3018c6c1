"""Collect the stated masses of a robot from its CAD, its USD stage, `inertia.toml`, or published tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core.findings import Finding, disagreement, info, warning
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.reference import inertia
from twin.validation.masses import audit
from twin.validation.masses.possible import JudgedInertia, StatedInertia, judged, least_mass, stated

PLAIN = 1.02
"""The sign of the products counts as determined if the minimum masses for both signs differ by at least this factor."""


@dataclass(frozen=True)
class MassSource:
    """One source of masses.

    Attributes:
        title: name of the source.
        bodies: the judged bodies, one per row or link.
        findings: findings that concern all bodies together.
    """

    title: str
    bodies: tuple[JudgedInertia, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def all_findings(self) -> list[Finding]:
        """Findings on single bodies, followed by findings on all bodies together."""
        return [*(f for b in self.bodies for f in b.findings), *self.findings]


def of_mechanism(mechanism: Mechanism, title: str) -> MassSource:
    """Judge all bodies with a mass in a mechanism; the masses come from the CAD or from a file."""
    bodies, without = [], []
    for body in mechanism.bodies:
        if body.inertia is None:
            without += [body.name] if body.meshes and body.name != mechanism.base else []
            continue
        bodies.append(judged(stated(body.name, title, body.inertia, body.meshes)))
    found = []
    if without:
        found.append(
            warning(
                "inertia.missing", without[0], f"these bodies have shapes but no mass: {', '.join(without)}", when=title
            )
        )
    return MassSource(title, tuple(bodies), tuple(found))


def of_table(folder: Path, mechanism: Mechanism) -> MassSource:
    """Judge the links in `inertia.toml` of a CAD folder, each with the shapes of its body.

    Raises:
        DescriptionError: the file is invalid.
        MechanismError: the file belongs to another mechanism.
    """
    table = inertia.of_robot(folder)
    stating = inertia.weighed(table, mechanism, instrument=False)
    moved = {j.name: stating.body(j.child) for j in stating.tree}
    links = ((link.joint, moved[link.joint]) for link in table.link)
    bodies = tuple(
        judged(stated(f"link of {name}", "inertia.toml", body.inertia, body.meshes, own_shapes=False))
        for name, body in links
        if body.inertia is not None
    )
    return MassSource(f"{table.title} (inertia.toml)", bodies)


def of_exhibit(path: Path) -> MassSource:
    """Judge the rows of published tables without masses; the sign of the products is chosen as in `of_moments`.

    Raises:
        DescriptionError: the file is invalid.
    """
    exhibit = audit.load(path)
    return of_moments(exhibit.title, [(f"row {b.name}", *audit.moments(b)) for b in exhibit.body])


def of_moments(title: str, rows: list[tuple[str, Array, Array]]) -> MassSource:
    """Judge rows of tables without masses.

    Each row is (name, first moments (3,) in kg m, tensor (3, 3) in kg m2 with the products as printed). The
    products of all rows are negated if this reduces the sum of the minimum masses by more than the factor `PLAIN`.
    """
    read = {1: rows, -1: [(name, h, audit.negated(J)) for name, h, J in rows]}
    least = {sign: [least_mass(J, h) for _, h, J in some] for sign, some in read.items()}
    total = {sign: sum(values) for sign, values in least.items()}
    sign = -1 if total[-1] * PLAIN < total[1] else 1
    bodies = tuple(judged(StatedInertia(name, title, None, h, J)) for name, h, J in read[sign])
    found = []
    if sign < 0:
        worst = int(np.argmax([a / b if b else 0.0 for a, b in zip(least[1], least[-1], strict=True)]))
        found.append(
            disagreement(
                "inertia.sign",
                rows[worst][0],
                "the products of inertia are printed as +integral(x y dm): as printed, the rows require a mass of "
                f"at least {total[1]:.2f} kg, {rows[worst][0]} alone {least[1][worst]:.3f} kg; with negated "
                f"products, {total[-1]:.2f} kg and {least[-1][worst]:.3f} kg",
                Quantity(total[1], "kg"),
                total[-1],
                "negate the products to build the tensor",
                when=title,
                word="",
            )
        )
    elif total[1] * PLAIN >= total[-1]:
        found.append(
            info(
                "inertia.sign_open",
                "",
                "the sign of the products is undetermined: both signs require about the same mass",
                Quantity(total[1], "kg"),
                total[-1],
                when=title,
                word="negated",
            )
        )
    return MassSource(title, bodies, tuple(found))
