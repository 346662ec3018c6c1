"""Write the GLB of an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.write.glb import write_glb
from twin.exchange.write.order import Order


def write(order: Order, folder: Path) -> list[Finding]:
    """Write one file with the shapes and all motions of a robot into `folder`."""
    write_glb(order.mechanism, order.clips, folder / f"{order.mechanism.name}.glb")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    return [(f"{order.mechanism.name}.glb", "shapes and all motions, y up" if order.clips else "shapes, y up")]
