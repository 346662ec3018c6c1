"""Write the URDF files of an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.write.order import Order
from twin.exchange.write.urdf import has_closures, urdf_findings, write_urdf


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a robot, and a file for each motion with other trocars, into `folder`; return what is left out."""
    write_urdf(order.mechanism, folder)
    for scene in order.elsewhere:
        write_urdf(scene.mechanism, folder, f"{order.mechanism.name}_{scene.clip.name}")
    return urdf_findings(order.mechanism)


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    name = order.mechanism.name
    rows = [(f"{name}.urdf", "URDF, loops cut open; shapes in meshes/ (mm)")]
    if has_closures(order.mechanism):
        rows.append((f"{name}.yaml", "loops and couplings that the URDF cannot hold"))
    return rows
