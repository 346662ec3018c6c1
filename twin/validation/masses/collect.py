"""Where the masses of a robot are stated: weighed on its CAD, on its stage, in `inertia.toml`, in printed tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.simulation.dynamics import inertia
from twin.simulation.dynamics.model import placements
from twin.validation.masses import audit
from twin.validation.masses.possible import Judged, Stated, judged, least_mass, stated

PLAIN = 1.02
"""Factor of mass by which one sign of the products must ask for less, before it is the sign that was meant."""


@dataclass(frozen=True)
class Source:
    """One place where masses are stated.

    Attributes:
        title: what and where. bodies: one for each row or body.
        findings: on all of them together.
    """

    title: str
    bodies: tuple[Judged, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def all_findings(self) -> list[Finding]:
        """On single bodies, then on all together."""
        return [*(f for b in self.bodies for f in b.findings), *self.findings]


def of_mechanism(mechanism: Mechanism, title: str) -> Source:
    """Return the bodies of a weighed mechanism, or of one that was read from a file with masses."""
    bodies, without = [], []
    for body in mechanism.bodies:
        if body.inertia is None:
            without += [body.name] if body.meshes and body.name != mechanism.base else []
            continue
        bodies.append(judged(stated(body.name, title, body.inertia, body.meshes)))
    found = []
    if without:
        text = f"{', '.join(without)}: shapes without a mass"
        found.append(Finding("inertia.missing", "warning", text, where=without[0], when=title))
    return Source(title, tuple(bodies), tuple(found))


def of_table(folder: Path, mechanism: Mechanism) -> Source:
    """Return the links of `inertia.toml` in a CAD folder, each with the shapes of the body that it stands for.

    Raises:
        DescriptionError: the file is wrong. MechanismError: its axes are not those of the mechanism.
    """
    table = inertia.of_robot(folder)
    arm = inertia.arm(table, placements(mechanism), instrument=False)
    bodies = []
    for name, link in zip(arm.joints, arm.links, strict=True):
        joint = mechanism.joint(name)
        T = spatial.inverse(joint.T_child_joint)  # of the body in its joint frame
        meshes = tuple(
            replace(m, vertices=m.vertices @ T[:3, :3].T + T[:3, 3]) for m in mechanism.body(joint.child).meshes
        )
        bodies.append(judged(stated(f"link of {name}", "inertia.toml", link, meshes, own_shapes=False)))
    return Source(f"{table.title} (inertia.toml)", tuple(bodies))


def of_exhibit(path: Path) -> Source:
    """Return the rows of printed tables without masses, with the sign of the products that asks for less mass.

    Raises:
        DescriptionError: the file is wrong.
    """
    exhibit = audit.load(path)
    rows = []
    for body in exhibit.body:
        first = np.array([body.first.mx, body.first.my, body.first.mz])
        s = body.second
        rows.append((f"row {body.name}", first, np.array([s.xx, s.yy, s.zz]), np.array([s.xy, s.xz, s.yz])))
    return of_moments(exhibit.title, rows)


def of_moments(title: str, rows: list[tuple[str, Array, Array, Array]]) -> Source:
    """Return rows of (name, first moments (3,), xx yy zz, xy xz yz) without masses, products as printed or negated."""
    least = {sign: [least_mass(_tensor(m, sign * p), h) for _, h, m, p in rows] for sign in (1, -1)}
    total = {sign: sum(values) for sign, values in least.items()}
    sign = -1 if total[-1] * PLAIN < total[1] else 1
    bodies = tuple(judged(Stated(name, title, None, h, _tensor(m, sign * p))) for name, h, m, p in rows)
    found = []
    if sign < 0:
        worst = int(np.argmax([a / b if b else 0.0 for a, b in zip(least[1], least[-1], strict=True)]))
        found.append(
            Finding(
                "inertia.sign",
                "disagreement",
                f"products of inertia are printed as +integral(x y dm): as entries of the tensor the rows need "
                f"{total[1]:.2f} kg at least, {rows[worst][0]} alone {least[1][worst]:.3f} kg; negated, "
                f"{total[-1]:.2f} kg and {least[-1][worst]:.3f} kg",
                where=rows[worst][0],
                when=title,
                size=total[1],
                unit="kg",
                limit=total[-1],
                suggestion="negate the products to build the tensor",
            )
        )
    elif total[1] * PLAIN >= total[-1]:
        text = "the sign of the products cannot be told: either asks for about the same mass"
        found.append(Finding("inertia.sign_open", "info", text, when=title, size=total[1], unit="kg", limit=total[-1]))
    return Source(title, bodies, tuple(found))


def _tensor(moments: Array, products: Array) -> Array:
    xy, xz, yz = products
    return np.diag(moments) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
