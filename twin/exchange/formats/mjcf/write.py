"""Write the MJCF files of an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.write.mjcf import mjcf_findings, write_mjcf
from twin.exchange.write.order import Order


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a robot, and a file for each motion with other trocars, into `folder`; return what is left out."""
    write_mjcf(order.mechanism, folder)
    for scene in order.elsewhere:
        write_mjcf(scene.mechanism, folder, f"{order.mechanism.name}_{scene.clip.name}")
    return mjcf_findings(order.mechanism)


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    return [(f"{order.mechanism.name}.xml", "MJCF, loops closed by constraints; shapes in meshes/ (mm)")]
