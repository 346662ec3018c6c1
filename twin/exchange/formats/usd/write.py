"""Write the stages of an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.write.order import Order
from twin.exchange.write.usd import write_usd


def write(order: Order, folder: Path) -> list[Finding]:
    """Write the stages of a robot and of its motions into `folder`/usd."""
    write_usd(order.mechanism, order.clips, folder / "usd")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    name = order.mechanism.name
    rows = [
        (f"usd/{name}.usda", "the robot for simulators and editors: physics.usda over geometry.usdc"),
        (f"usd/{name}_sim.usda", "the same robot in a physics scene: open this file to simulate"),
    ]
    for clip in order.clips:
        rows.append((f"usd/{name}_{clip.name}.usda", f"the same robot, playing {clip.name}"))
    return rows
