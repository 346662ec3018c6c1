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

_CLOSURE_TYPE = {"spherical": "3d"}
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
    link_pairs = []
    closure_types = []
    for joint in cut:
        link_pairs.append(list(ends(joint)))
        closure_types.append(_CLOSURE_TYPE.get(joint.type, "6d"))
    lines = [
        "# The loops of the URDF of the same name, for `twin new` and readers of Gepetto's example-parallel-robots.",
        f"closed_loop: {json.dumps(link_pairs)}",
        f"type: {json.dumps(closure_types)}",
        f"name_mot: {json.dumps(list(driven))}",
        f"home: {json.dumps(dict(home))}",
    ]
    entries = {}
    for coupling in couplings:
        ratios = list(map(float, coupling.ratios))  # json knows no numbers of NumPy
        entries[coupling.name] = {"joints": list(coupling.joints), "ratios": ratios, "sum": float(coupling.total)}
    if entries:  # readers of Gepetto's files do not know the key
        lines.append(f"coupling: {json.dumps(entries)}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
