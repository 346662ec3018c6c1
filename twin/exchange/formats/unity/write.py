"""Write the Unity package of an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.write.order import Order
from twin.exchange.write.unity import write_unity


def write(order: Order, folder: Path) -> list[Finding]:
    """Write the package, which is the same for every robot, into `folder`/unity."""
    write_unity(folder / "unity")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    return [("unity/", "Unity package: player, stream client, interaction, tests")]
