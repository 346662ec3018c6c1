"""Write the loops of a URDF as a closure YAML: pairs of links, driven joints, and the joint values at home.

Each line is `key: value` with the value in JSON, which is also YAML. The keys are those of Gepetto's
example-parallel-robots, with `home` and `coupling` added. A loop is closed by two links, <joint>_a and <joint>_b, that
coincide: in all directions (6d), or only in their origins (3d). For a loop that is closed by a hinge or a slide,
<joint>_a is the child of this joint in the URDF; it has no shape.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.model.joint import Joint
from twin.model.mechanism import Coupling

_TYPE = {"spherical": "3d"}
"""Closure type of a joint that closes a loop; all types but a ball: 6d."""


def ends(joint: Joint) -> tuple[str, str]:
    """Return the names of the two links that coincide if the loop at a joint is closed."""
    return f"{joint.name}_a", f"{joint.name}_b"


def write_closures(
    cut: Sequence[Joint], couplings: Sequence[Coupling], driven: Sequence[str], home: Mapping[str, float], path: Path
) -> Path:
    """Write the closure YAML of the URDF of the same name; return its path.

    `cut` contains the joints that close loops, `couplings` those that the URDF cannot hold, `driven` the names of the
    driven joints, `home` the values in m and rad of the joints of the URDF in the posture with all loops closed.
    """
    held = {}
    for c in couplings:
        held[c.name] = {"joints": list(c.joints), "ratios": [float(r) for r in c.ratios], "sum": float(c.total)}
    lines = [
        "# The loops of the URDF of the same name, for `twin new` and readers of Gepetto's example-parallel-robots.",
        f"closed_loop: {json.dumps([list(ends(j)) for j in cut])}",
        f"type: {json.dumps([_TYPE.get(j.type, '6d') for j in cut])}",
        f"name_mot: {json.dumps(list(driven))}",
        f"home: {json.dumps(dict(home))}",
    ]
    if held:
        lines.append(f"coupling: {json.dumps(held)}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
