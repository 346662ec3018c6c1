"""HTML of a robot for notebooks: its joints with limits, and the names by which it is asked."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

from twin.core.units import DEG, MM

if TYPE_CHECKING:
    from twin.model.joint import Joint
    from twin.model.mechanism import Mechanism


def html_of(name: str, mechanism: Mechanism, variants: Iterable[str], protocols: Iterable[str]) -> str:
    """Return a table of the driven joints of a robot, and its frames, postures, variants and protocols."""
    rows = []
    for joint in mechanism.active:
        name_of_joint = escape(joint.name)  # names of a foreign file may contain markup
        rows.append(f"<tr><td>{name_of_joint}</td><td>{joint.type}</td><td>{_limits(joint)}</td></tr>")
    header = "<tr><th>joint</th><th>type</th><th>limits</th></tr>"
    facts = [
        ("frames", [frame.name for frame in mechanism.frames]),
        ("postures", mechanism.postures),
        ("variants", variants),
        ("protocols", protocols),
    ]
    lines = []
    for title, names in facts:
        lines.append(f"<div>{title}: {escape(', '.join(names)) or 'none'}</div>")
    size = f"{len(mechanism.bodies)} bodies, {len(mechanism.joints)} joints, {len(mechanism.loops)} loops"
    table = f"<table>{header}{''.join(rows)}</table>"
    return f"<div><b>{escape(name)}</b> {size}{table}{''.join(lines)}</div>"


def _limits(joint: Joint) -> str:
    if joint.limits is None:
        return "none"
    low, high = joint.limits
    if joint.is_angle:
        return f"{low / DEG:.1f}° to {high / DEG:.1f}°"
    return f"{low / MM:.1f} to {high / MM:.1f} mm"
