"""A STEP assembly as the skeleton of a robot: one body a node, features, and joints proposed where bodies touch.

The STEP knows shapes, not joints: every body is held to the base until its joint is named. The joints that the faces
suggest stand in the description as comments.
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
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.exchange.read.folder import TOLERANCE, write_robot
from twin.exchange.read.pairs import GROSS, Pair, find_pairs
from twin.exchange.read.proposals import Proposal, propose
from twin.exchange.read.source import Names, note, warning
from twin.exchange.read.text import numbers, one_line, string
from twin.model.mechanism import Mechanism

DRIVE = (
    "",
    "# A simulator needs the drive of each driven joint; nothing else does.",
    "# [[drive]]",
    '# joints = ["NAME"]',
    "# stiffness = 1000 # N m/rad; of a slide N/m",
    "# damping = 20 # N m s/rad; of a slide N s/m",
    "# max_effort = 50 # N m; of a slide N",
    '# provenance = "ASSUMED"',
    '# note = "where the gains come from"',
)
"""What a skeleton says of drives."""

_GROUND = ("base", "frame", "ground", "world", "housing", "fixed")
"""Words in the name of the body that stands still."""


@dataclass
class Skeleton:
    """What a STEP shows: parts by body, the node of each body, the base, pairs of faces and proposed joints."""

    parts: dict[str, list[Part]]
    nodes: dict[str, str]
    base: str
    pairs: list[Pair]
    proposals: list[Proposal]
    findings: list[Finding] = field(default_factory=list)

    @property
    def tool(self) -> str:
        """The body that hangs furthest out."""
        return self.proposals[-1].child if self.proposals else list(self.parts)[-1]


def read_skeleton(path: Path) -> Skeleton:
    """Read a STEP assembly.

    Raises:
        SourceError: it cannot be read, or holds one part only.
    """
    try:
        step = read_step(path)
    except CadError as error:
        raise SourceError(str(error)) from error
    findings: list[Finding] = []
    by_node = bodies(step.parts)
    if len(by_node) < 2:
        raise SourceError(
            f"{path}: it holds one body, '{next(iter(by_node))}': a mechanism needs an assembly, a node for each body"
        )
    names = Names("node", by_node, findings)
    parts = {names[n]: p for n, p in by_node.items()}
    for node, own in by_node.items():
        seen: set[tuple[str, ...]] = set()
        twice = {p.name for p in own if (key := (*p.path, p.name)) in seen or seen.add(key)}
        if twice:
            text = (
                f"node '{node}' holds several parts named '{min(twice)}': if the node itself stands there several "
                "times, its copies are read as one body. Name the copies apart in the CAD."
            )
            findings.append(warning("copies", text, node))
    base = next((b for w in _GROUND for b in parts if w in b.split("_")), next(iter(parts)))
    findings.append(note("base", f"body '{base}' is taken for the base; change `base` if another stands still.", base))
    findings.append(warning("mass", "a STEP has no densities: bodies have no mass until [material.*] says them.", base))
    pairs = find_pairs(parts)
    proposals, left = propose(parts, pairs, base)
    findings += [_near(p) for p in proposals if p.misses or p.pair.near]
    findings += [_left(p) for p in left]
    findings += [f for node, own in by_node.items() if (f := _inside(node, own))]
    held = sorted(set(parts) - {base} - {b for p in proposals for b in (p.parent, p.child)})
    if held:
        text = f"no joint is proposed for {', '.join(held)}: no bore, pin, rail or ball of theirs fits another body's."
        findings.append(warning("held", text, held[0]))
    text = (
        f"{len(proposals)} joints are proposed, as comments: all bodies are held to '{base}' until you name theirs. "
        f"Axes up to {GROSS[0] / MM:g} mm and {GROSS[1] / DEG:g}° apart, and less than the radius, are taken for one."
    )
    findings.append(warning("joints", text, base))
    if step.placement_error > 0:
        text = f"instances are placed by matrices: faces are measured to {step.placement_error * 1e6:.2g} um."
        findings.append(note("placement", text, base))
    return Skeleton(parts, {names[n]: n for n in by_node}, base, pairs, proposals, findings)


def _near(p: Proposal) -> Finding:
    text = (
        f"joint {p.name} of '{p.parent}' and '{p.child}': {p.pair.radii} are {p.miss} apart as drawn (confidence "
        f"{p.pair.confidence}). Proposed all the same; once taken, info and validate find it: cad.meeting, cad.tilt."
    )
    return Finding("import.near", "warning", text, p.name, size=p.offset, unit="m")


def _left(p: Pair) -> Finding:
    """Return the finding for a fit between two bodies that no proposal stands on."""
    text = f"'{p.a.part.name}' of '{p.a.body}' fits '{p.b.part.name}' of '{p.b.body}' as well, "
    off = f"{p.offset / MM:.4g} mm and {p.tilt / DEG:.4g}° off (confidence {p.confidence})" if p.near else "exactly"
    return warning("left", f"{text}{off}: it places no joint here, and is not checked.", p.a.body)


def _inside(node: str, parts: list[Part]) -> Finding | None:
    """Return the finding for pins and balls that can move in bores and cups of the same node."""
    pairs = [p for p in find_pairs({str(i): [part] for i, part in enumerate(parts)}) if p.movable()]
    if not pairs:
        return None
    some = ", ".join(f"'{p.a.part.name}' in or on '{p.b.part.name}'" for p in pairs[:3])
    inner = sorted({(*part.path, part.name)[part.path.index(node) + 1] for part in parts if node in part.path})
    text = (
        f"node '{node}' is read as one body, but parts of it can move in one another: {some}"
        f"{f' and {len(pairs) - 3} more' if len(pairs) > 3 else ''}. If these are joints, write a [body.*] with `node` "
        f"for each inner node that moves ({', '.join(inner[:6])}{', ...' if len(inner) > 6 else ''}), or export the "
        "sub-assembly opened."
    )
    return warning("inside", text, node)


def bodies(parts: Iterable[Part]) -> dict[str, list[Part]]:
    """Return the parts of each assembly node on the first level where the tree forks."""
    chains = [((*p.path, p.name), p) for p in parts]
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
    """Write the robot folder of a STEP; see `folder.write_robot`.

    Returns:
        The files written, the description first, and the mechanism, which is rigid.
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
        f"# {name}, made by `twin new` from {one_line(source)}. A skeleton: every body is held to the base.",
        "# Name the joints: take the comment off those below that exist, name them, mark the driven ones with",
        "# `active = true` (list those first), and delete the hold of each body that now moves.",
        f"name = {string(name)}",
        f"title = {string(name)}",
        f"source = {string(source)}",
        'default_protocol = "first"',
        f"base = {string(s.base)}",
        'tool = "tool"',
        f"step = {string(f'{name}.step')}",
        *TOLERANCE,
        "",
        "# [material.steel]",
        "# density_kg_m3 = 7850",
        '# parts = ["*"] # names of parts, with * and ?',
        '# provenance = "ASSUMED"',
        '# note = "where the density comes from"',
        *DRIVE,
    ]
    for body in s.parts:
        lines += ["", f"[body.{body}]"] + ([f"node = {string(s.nodes[body])}"] if s.nodes[body] != body else [])
    used: dict[str, dict[str, str]] = {}
    for proposal in s.proposals:
        for body, features in (
            (proposal.parent, proposal.on_parent.features),
            (proposal.child, proposal.on_child.features),
        ):
            used.setdefault(body, {}).update(features)
    for body in s.parts:
        if body in used:
            lines += ["", f"[feature.{body}]", *(f"{n} = {text}" for n, text in used[body].items())]
    for p in s.proposals:
        lines += [
            "",
            f"# {one_line(p.why)}",
            *([f"# As drawn, its sides are {p.miss} apart (confidence {p.pair.confidence})."] if p.misses else []),
            "# [[joint]]",
            f"# name = {string(p.name)}",
            f"# type = {string(p.type)}",
            f"# parent = {string(p.parent)}",
            f"# child = {string(p.child)}",
            f"# on_parent = {p.on_parent.text}",
            f"# on_child = {p.on_child.text}",
        ]
    here = "{ position_mm = [0, 0, 0], angles_deg = [0, 0, 0] }"
    for body in s.parts:
        if body != s.base:
            lines += [
                "",
                "[[joint]]",
                f"name = {string(f'hold_{body}')}",
                'type = "fixed"',
                f"parent = {string(s.base)}",
                f"child = {string(body)}",
                f"on_parent = {here}",
                f"on_child = {here}",
            ]
    centre = _middle(s.parts[s.tool]) / MM
    lines += [
        "",
        "[frame.tool] # amid the outermost body: move it where the tool is",
        f"body = {string(s.tool)}",
        f"at = {{ position_mm = {numbers(round(float(v), 3) for v in centre)}, angles_deg = [0, 0, 0] }}",
        "",
        "[posture.home]",
    ]
    return "\n".join(lines) + "\n"


def _middle(parts: Iterable[Part]) -> Array:
    points = np.concatenate([p.vertices for p in parts])
    return 0.5 * (points.min(axis=0) + points.max(axis=0))
