"""Convert a STEP assembly to the skeleton of a robot: bodies (one for each assembly node), features, proposed joints.

A STEP file has shapes, but no joints: every body is fixed to the base until the user defines its joint. Joints are
proposed where faces fit; the proposals are comments in the description.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from twin.cad.build import read_mechanism
from twin.cad.step import Part, read_step
from twin.core.errors import CadError, SourceError
from twin.core.findings import Finding, finding
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.exchange.read.folder import TOLERANCE, write_robot
from twin.exchange.read.pairs import GROSS, Pair, find_pairs
from twin.exchange.read.proposals import Proposal, propose
from twin.exchange.read.source import Findings, Imported, Names, Options, warning
from twin.exchange.read.text import one_line, rows, table, toml
from twin.model.mechanism import Mechanism

DRIVE = (
    "",
    "# Only simulators require drives: one for each driven joint.",
    "# [[drive]]",
    '# joints = ["NAME"]',
    "# stiffness = 1000 # N m/rad; for a slide: N/m",
    "# damping = 20 # N m s/rad; for a slide: N s/m",
    "# max_effort = 50 # N m; for a slide: N",
    '# provenance = "ASSUMED"',
    '# note = "where the gains come from"',
)
"""Comment about drives in the description of a skeleton."""

_GROUND = ("base", "frame", "ground", "world", "housing", "fixed")
"""Words in body names that identify the base, in order of precedence."""


@dataclass
class Skeleton:
    """Content of a STEP assembly.

    `nodes` maps the name of each body to the name of its assembly node. `pairs` are the pairs of fitting faces.
    """

    parts: dict[str, list[Part]]
    nodes: dict[str, str]
    base: str
    pairs: list[Pair]
    proposals: list[Proposal]
    findings: list[Finding] = field(default_factory=list)

    @property
    def tool(self) -> str:
        """Name of the body that gets the tool frame: the child of the last proposed joint, else the last body."""
        return self.proposals[-1].child if self.proposals else list(self.parts)[-1]


def read_skeleton(path: Path) -> Skeleton:
    """Read a STEP assembly.

    Raises:
        SourceError: the file cannot be read, or contains only one body.
    """
    try:
        step = read_step(path)
    except CadError as error:
        raise SourceError(str(error)) from error
    findings = Findings()
    by_node = bodies(step.parts)
    if len(by_node) < 2:
        raise SourceError(
            f"{path}: the file has one body, '{next(iter(by_node))}': a mechanism requires an assembly with a node for "
            "each body"
        )
    names = Names("node", by_node, findings)
    parts = {names[n]: p for n, p in by_node.items()}
    for node, own in by_node.items():
        names_in_file = {(*p.path, p.name)[p.chain.index(node)] for p in own}
        if node not in names_in_file:
            text = f"node '{min(names_in_file)}' occurs several times in the assembly: this one is named '{node}'."
            findings.note("copies", text, node)
    base = next((b for w in _GROUND for b in parts if w in b.split("_")), next(iter(parts)))
    findings.note("base", f"body '{base}' is assumed to be the base; change `base` if another body is fixed.", base)
    findings.warn("mass", "a STEP has no densities: bodies have no mass until [material.*] states the densities.", base)
    pairs = find_pairs(parts)
    proposals, left = propose(parts, pairs, base)
    findings += [_near(p) for p in proposals if p.misses or p.pair.near]
    findings += [_left(p) for p in left]
    findings += [f for node, own in by_node.items() if (f := _inside(node, own))]
    held = sorted(set(parts) - {base} - {b for p in proposals for b in (p.parent, p.child)})
    if held:
        text = (
            f"no joint is proposed for {', '.join(held)}: none of their bores, pins, rails or balls fits a face of "
            "another body."
        )
        findings.warn("held", text, held[0])
    text = (
        f"{len(proposals)} joints are proposed, as comments: all bodies are fixed to '{base}' until you name their "
        "joints. "
        f"Axes count as coincident below a distance of {GROSS[0] / MM:g} mm (or the smaller radius, if less) and "
        f"an angle of {GROSS[1] / DEG:g}°."
    )
    findings.warn("joints", text, base)
    if step.placement_error > 0:
        text = (
            "the file places instances with rounded matrices, so faces are measured with an accuracy of "
            f"{step.placement_error * 1e6:.2g} um."
        )
        findings.note("placement", text, base)
    return Skeleton(parts, {names[n]: n for n in by_node}, base, pairs, proposals, findings)


def _near(p: Proposal) -> Finding:
    text = (
        f"joint {p.name} of '{p.parent}' and '{p.child}' ({p.pair.radii}): the joint's two frames are {p.miss} apart "
        f"in the CAD. The joint is proposed (confidence {p.pair.confidence}), but `info` and `validate` will report "
        "cad.meeting or cad.tilt"
    )
    return finding("warning", "import.near", p.name, text, Quantity(p.offset, "m"), word="")


def _left(p: Pair) -> Finding:
    """Return a finding that a fit is not used for a joint."""
    text = f"'{p.a.part.name}' of '{p.a.body}' also fits '{p.b.part.name}' of '{p.b.body}' "
    off = f"within {p.offset / MM:.4g} mm and {p.tilt / DEG:.4g}° (confidence {p.confidence})" if p.near else "exactly"
    return warning("left", f"{text}{off}: this fit is not used for a joint, and not checked.", p.a.body)


def _inside(node: str, parts: list[Part]) -> Finding | None:
    """Return a finding if pins or balls can move in bores or cups of the same node; else None."""
    pairs = [p for p in find_pairs({str(i): [part] for i, part in enumerate(parts)}) if p.movable()]
    if not pairs:
        return None
    some = ", ".join(f"'{p.a.part.name}' in or on '{p.b.part.name}'" for p in pairs[:3])
    inner = sorted({part.chain[part.chain.index(node) + 1] for part in parts if node in part.chain[:-1]})
    text = (
        f"node '{node}' is read as one body, but some parts of the node can move relative to others: {some}"
        f"{f' and {len(pairs) - 3} more' if len(pairs) > 3 else ''}. If these are joints, write a [body.*] with `node` "
        f"for each moving inner node ({', '.join(inner[:6])}{', ...' if len(inner) > 6 else ''}), or export the "
        "sub-assembly as separate nodes."
    )
    return warning("inside", text, node)


def bodies(parts: Iterable[Part]) -> dict[str, list[Part]]:
    """Return {body name: its parts}.

    The bodies are the assembly nodes at the first level with more than one node. Nodes with one name are numbered, so
    that a part that is used several times is several bodies.
    """
    chains = [(p.chain, p) for p in parts]
    level = 0
    while all(len(c) > level + 1 for c, _ in chains) and len({c[level] for c, _ in chains}) == 1:
        level += 1
    out: dict[str, list[Part]] = {}
    for chain, part in chains:
        out.setdefault(chain[min(level, len(chain) - 1)], []).append(part)
    return out


def write_skeleton(
    skeleton: Skeleton, name: str, target: Path, source: Path, force: bool = False
) -> tuple[list[Path], Mechanism]:
    """Write the robot folder of a STEP assembly; for the arguments see `folder.write_robot`.

    Returns:
        (files, mechanism): the written files, with the description first; the mechanism with all bodies fixed.
    """
    made: list[Mechanism] = []

    def cad(folder: Path) -> Mechanism:
        shutil.copyfile(source, folder / f"{name}.step")
        (folder / f"{name}.toml").write_text(describe(skeleton, name, source.name), "utf-8")
        made.append(read_mechanism(folder / f"{name}.toml", with_mass=False).mechanism)
        return made[0]

    return write_robot(name, target, cad, skeleton.findings, source, force), made[0]


def describe(s: Skeleton, name: str, source: str) -> str:
    """Return the description of a skeleton in TOML."""
    lines = [
        f"# {name}, made by `twin new` from {one_line(source)}. A skeleton: every body is fixed to the base.",
        "# To add joints: uncomment the correct proposals below, name them, mark the driven joints with",
        "# `active = true` (list driven joints first), and delete the temporary fixed joint of each body that now "
        "moves.",
        *rows({"name": name, "title": name, "source": source, "default_protocol": "first", "base": s.base}),
        *rows({"tool": "tool", "step": f"{name}.step"}),
        *TOLERANCE,
        "",
        "# [material.steel]",
        "# density_kg_m3 = 7850",
        '# parts = ["*"] # names of parts, with * and ?',
        '# provenance = "ASSUMED"',
        '# note = "where the density comes from"',
        *DRIVE,
        "",
        "# [[limit]]",
        '# joints = ["NAME"]',
        "# limits_deg = [-90, 90] # of a slide: limits_mm",
        '# provenance = "ASSUMED"',
        '# note = "where the limits come from"',
    ]
    for body in s.parts:
        lines += table(f"[body.{body}]", node=s.nodes[body] if s.nodes[body] != body else None)
    used: dict[str, JsonObject] = {}
    for p in s.proposals:
        for body, side in ((p.parent, p.on_parent), (p.child, p.on_child)):
            used.setdefault(body, {}).update(side.features)
    for body in (b for b in s.parts if b in used):
        lines += table(f"[feature.{body}]", **used[body])
    for p in s.proposals:
        sides = {"on_parent": p.on_parent.frame, "on_child": p.on_child.frame}
        lines += ["", f"# {one_line(p.why)}"]
        if p.misses:
            lines.append(f"# In the CAD, the two frames of this joint are {p.miss} apart.")
            lines.append(f"# Confidence that the faces of the two bodies fit: {p.pair.confidence}.")
        joint = table("[[joint]]", name=p.name, type=p.type, parent=p.parent, child=p.child, **sides)
        lines += [f"# {line}" for line in joint[1:]]
    here = "{ position_mm = [0, 0, 0], angles_deg = [0, 0, 0] }"
    for body in (b for b in s.parts if b != s.base):
        lines += table("[[joint]]", name=f"hold_{body}", type="fixed", parent=s.base, child=body)
        lines += [f"on_parent = {here}", f"on_child = {here}"]
    centre = _middle(s.parts[s.tool]) / MM
    lines += [
        "",
        "[frame.tool] # at the middle of the outermost body: move it to the tool",
        f"body = {toml(s.tool)}",
        f"at = {{ position_mm = {toml(round(float(v), 3) for v in centre)}, angles_deg = [0, 0, 0] }}",
        "",
        "[posture.home] # a value for each driven joint, such as NAME_deg = 0 or NAME_mm = 0 for the drawn state",
    ]
    return "\n".join(lines) + "\n"


def _middle(parts: Iterable[Part]) -> Array:
    points = np.concatenate([p.vertices for p in parts])
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def read(path: Path, options: Options) -> Imported:
    """Raise an error: a STEP file has no joints."""
    raise SourceError(f"{path}: a STEP file has no joints: use `twin new`, which makes a skeleton from it")
