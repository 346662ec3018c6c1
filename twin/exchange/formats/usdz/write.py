"""Write the USDZ files of an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.write.order import Order
from twin.exchange.write.usdz import write_usdz


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a file for each quick look of a robot, or one file at rest, into `folder`."""
    name = order.mechanism.name
    clips = {clip.name: clip for clip in order.clips}
    first = clips[order.quick_looks[0]] if order.quick_looks else None
    write_usdz(order.mechanism, first, folder / f"{name}_ar.usdz")
    for clip in order.quick_looks[1:]:
        write_usdz(order.mechanism, clips[clip], folder / f"{name}_{clip}_ar.usdz")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    name = order.mechanism.name
    first = f"for AR Quick Look, playing {order.quick_looks[0]}" if order.clips else "at rest"
    rows = [(f"{name}_ar.usdz", first)]
    for clip in order.quick_looks[1:]:
        rows.append((f"{name}_{clip}_ar.usdz", f"the same robot, playing {clip}"))
    return rows
