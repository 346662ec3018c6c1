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
from twin.validation.masses import published_moments
from twin.validation.masses.physical_limits import (
    JudgedInertia,
    StatedInertia,
    judged_inertia,
    least_mass,
    stated_inertia,
)

PLAIN_MASS_RATIO = 1.02
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
        findings: list[Finding] = []
        for body in self.bodies:
            findings += body.findings
        findings += self.findings
        return findings


def of_mechanism(mechanism: Mechanism, title: str) -> MassSource:
    """Judge all bodies with a mass in a mechanism; the masses come from the CAD or from a file."""
    bodies: list[JudgedInertia] = []
    without: list[str] = []
    for body in mechanism.bodies:
        if body.inertia is not None:
            bodies.append(judged_inertia(stated_inertia(body.name, title, body.inertia, body.meshes)))
        elif body.meshes and body.name != mechanism.base:  # the base is at rest: its mass has no effect
            without.append(body.name)
    findings: list[Finding] = []
    if without:
        text = f"these bodies have shapes but no mass: {', '.join(without)}"
        findings.append(warning("inertia.missing", without[0], text, when=title))
    return MassSource(title, tuple(bodies), tuple(findings))


def of_table(folder: Path, mechanism: Mechanism) -> MassSource:
    """Judge the links in `inertia.toml` of a CAD folder, each with the shapes of its body.

    Raises:
        DescriptionError: the file is invalid.
        MechanismError: the file belongs to another mechanism.
    """
    table = inertia.of_robot(folder)
    # without the instrument, which the file states apart from the last link: the link alone is judged
    stating = inertia.weighed(table, mechanism, instrument=False)
    body_of_joint = {joint.name: stating.body(joint.child) for joint in stating.tree}
    bodies: list[JudgedInertia] = []
    for link in table.link:
        body = body_of_joint[link.joint]
        if body.inertia is None:
            continue
        name = f"link of {link.joint}"
        bodies.append(judged_inertia(stated_inertia(name, "inertia.toml", body.inertia, body.meshes, own_shapes=False)))
    return MassSource(f"{table.title} (inertia.toml)", tuple(bodies))


def of_exhibit(path: Path) -> MassSource:
    """Judge the rows of published tables without masses; the sign of the products is chosen as in `of_moments`.

    Raises:
        DescriptionError: the file is invalid.
    """
    exhibit = published_moments.load(path)
    rows: list[tuple[str, Array, Array]] = []
    for body in exhibit.body:
        first, tensor = published_moments.moments(body)
        rows.append((f"row {body.name}", first, tensor))
    return of_moments(exhibit.title, rows)


def of_moments(title: str, rows: list[tuple[str, Array, Array]]) -> MassSource:
    """Judge rows of tables without masses.

    Each row is (name, first moments (3,) in kg m, tensor (3, 3) in kg m2 with the products as printed). The
    products of all rows are negated if this reduces the sum of the minimum masses by more than `PLAIN_MASS_RATIO`.
    """
    rows_negated = []
    masses = []
    masses_negated = []
    ratios = []
    for name, first, tensor in rows:
        # for both signs of the products: the smaller masses show which sign is meant
        tensor_negated = published_moments.negated(tensor)
        mass = least_mass(tensor, first)
        mass_negated = least_mass(tensor_negated, first)
        rows_negated.append((name, first, tensor_negated))
        masses.append(mass)
        masses_negated.append(mass_negated)
        ratios.append(mass / mass_negated if mass_negated else 0.0)
    total = sum(masses)
    total_negated = sum(masses_negated)
    findings: list[Finding] = []
    chosen = rows
    if total_negated * PLAIN_MASS_RATIO < total:
        chosen = rows_negated
        worst = int(np.argmax(ratios))
        name = rows[worst][0]
        findings.append(
            disagreement(
                "inertia.sign",
                name,
                "the products of inertia are printed as +integral(x y dm): as printed, the rows require a mass of "
                f"at least {total:.2f} kg, {name} alone {masses[worst]:.3f} kg; with negated "
                f"products, {total_negated:.2f} kg and {masses_negated[worst]:.3f} kg",
                size=Quantity(total, "kg"),
                limit=total_negated,
                suggestion="negate the products to build the tensor",
                when=title,
                word="",
            )
        )
    elif total * PLAIN_MASS_RATIO >= total_negated:
        findings.append(
            info(
                "inertia.sign_open",
                "",
                "the sign of the products is undetermined: both signs require about the same mass",
                size=Quantity(total, "kg"),
                limit=total_negated,
                when=title,
                word="negated",
            )
        )
    bodies = []
    for name, first, tensor in chosen:
        bodies.append(judged_inertia(StatedInertia(name, title, mass=None, first=first, tensor=tensor)))
    return MassSource(title, tuple(bodies), tuple(findings))
