"""Write the tracks of an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.write.order import Order
from twin.exchange.write.tracks import write_schema, write_tracks


def write(order: Order, folder: Path) -> list[Finding]:
    """Write a JSON and a CSV file for each motion of a robot, and their schema, into `folder`/tracks."""
    for scene in order.scenes:
        write_tracks(scene.mechanism, scene.clip, folder / "tracks", order.mechanism, order.assumed)
    write_schema(folder / "tracks")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    rows = [(f"tracks/{clip.name}.json, .csv", "joint values and link poses at keys") for clip in order.clips]
    rows.append(("tracks/track.schema.json", "description of the entries of a track"))
    return rows
