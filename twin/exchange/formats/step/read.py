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
from twin.core.toml_text import one_line, rows, table, toml
from twin.core.units import DEG, MM
from twin.exchange.read.description_text import TOLERANCE
from twin.exchange.read.fitting_faces import NEAR_FIT, FacePair, find_pairs
from twin.exchange.read.imported_robot import Findings, Imported, Names, Options, warning
from twin.exchange.read.proposals import Proposal, propose
from twin.exchange.read.robot_folder import write_robot
from twin.model.mechanism import Mechanism

DRIVE_COMMENT = (
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


_MOST_EXAMPLES = 3
"""Number of movable pairs of parts that a finding names."""

_MOST_NODES = 6
"""Number of inner nodes that a finding names."""


@dataclass
class Skeleton:
    """Content of a STEP assembly.

    `nodes` maps the name of each body to the name of its assembly node. `pairs` are the pairs of fitting faces.
    """

    parts: dict[str, list[Part]]
    nodes: dict[str, str]
    base: str
    pairs: list[FacePair]
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
    parts: dict[str, list[Part]] = {}
    nodes: dict[str, str] = {}
    for node, node_parts in by_node.items():
        body = names[node]
        parts[body] = node_parts
        nodes[body] = node
        _note_copies(node, node_parts, findings)
    base = _base(parts)
    findings.note("base", f"body '{base}' is assumed to be the base; change `base` if another body is fixed.", base)
    findings.warn("mass", "a STEP has no densities: bodies have no mass until [material.*] states the densities.", base)
    pairs = find_pairs(parts)
    proposals, unused = propose(parts, pairs, base)
    bodies_without_joint = set(parts) - {base}
    for proposal in proposals:
        bodies_without_joint -= {proposal.parent, proposal.child}
        # Also a fit that is only near: later the description is measured on these faces, and would be reported there.
        if proposal.misses or proposal.pair.near:
            findings.append(_inexact_fit(proposal))
    for pair in unused:
        findings.append(_unused_fit(pair))
    for node, node_parts in by_node.items():
        moving_parts = _moving_parts(node, node_parts)
        if moving_parts is not None:
            findings.append(moving_parts)
    if bodies_without_joint:
        listed = sorted(bodies_without_joint)
        text = (
            f"no joint is proposed for {', '.join(listed)}: none of their bores, pins, rails or balls fits a face of "
            "another body."
        )
        findings.warn("held", text, listed[0])
    distance, angle = NEAR_FIT
    text = (
        f"{len(proposals)} joints are proposed, as comments: all bodies are fixed to '{base}' until you name their "
        "joints. "
        f"Axes count as coincident below a distance of {distance / MM:g} mm (or the smaller radius, if less) and "
        f"an angle of {angle / DEG:g}°."
    )
    findings.warn("joints", text, base)
    if step.placement_error > 0:
        text = (
            "the file places instances with rounded matrices, so faces are measured with an accuracy of "
            f"{step.placement_error * 1e6:.2g} um."
        )
        findings.note("placement", text, base)
    return Skeleton(parts, nodes, base, pairs, proposals, findings)


def _note_copies(node: str, parts: list[Part], findings: Findings) -> None:
    """Note that a node has another name in the file, because it occurs there several times."""
    names = set()
    for part in parts:
        path = (*part.path, part.name)
        names.add(path[part.chain.index(node)])
    if node not in names:
        text = f"node '{min(names)}' occurs several times in the assembly: this one is named '{node}'."
        findings.note("copies", text, node)


def _base(names: Iterable[str]) -> str:
    """Return the body whose name has the word that comes first in `_GROUND`; without such a word, the first body."""
    bodies = list(names)
    for word in _GROUND:
        for body in bodies:
            if word in body.split("_"):
                return body
    return bodies[0]


def _inexact_fit(proposal: Proposal) -> Finding:
    text = (
        f"joint {proposal.name} of '{proposal.parent}' and '{proposal.child}' ({proposal.pair.radii}): the joint's two "
        f"frames are {proposal.miss} apart in the CAD. The joint is proposed (confidence {proposal.pair.confidence}), "
        "but `info` and `validate` will report cad.meeting or cad.tilt"
    )
    return finding("warning", "import.near", proposal.name, text, Quantity(proposal.offset, "m"), word="")


def _unused_fit(pair: FacePair) -> Finding:
    """Return a finding that a fit is not used for a joint."""
    deviation = "exactly"
    if pair.near:
        distance = f"{pair.offset / MM:.4g} mm"
        angle = f"{pair.tilt / DEG:.4g}°"
        deviation = f"within {distance} and {angle} (confidence {pair.confidence})"
    text = (
        f"'{pair.a.part.name}' of '{pair.a.body}' also fits '{pair.b.part.name}' of '{pair.b.body}' {deviation}: this "
        "fit is not used for a joint, and not checked."
    )
    return warning("left", text, pair.a.body)


def _moving_parts(node: str, parts: list[Part]) -> Finding | None:
    """Return a finding if pins or balls can move in bores or cups of the same node; else None."""
    parts_as_bodies: dict[str, list[Part]] = {}
    for number, part in enumerate(parts):
        parts_as_bodies[str(number)] = [part]
    pairs = [pair for pair in find_pairs(parts_as_bodies) if pair.movable()]
    if not pairs:
        return None
    inner_nodes = set()
    for part in parts:
        if node in part.chain[:-1]:
            inner_nodes.add(part.chain[part.chain.index(node) + 1])
    examples: list[str] = []
    for pair in pairs[:_MOST_EXAMPLES]:
        examples.append(f"'{pair.a.part.name}' in or on '{pair.b.part.name}'")
    example_text = ", ".join(examples)
    if len(pairs) > _MOST_EXAMPLES:
        example_text += f" and {len(pairs) - _MOST_EXAMPLES} more"
    names = ", ".join(sorted(inner_nodes)[:_MOST_NODES])
    if len(inner_nodes) > _MOST_NODES:
        names += ", ..."
    text = (
        f"node '{node}' is read as one body, but some parts of the node can move relative to others: {example_text}. "
        f"If these are joints, write a [body.*] with `node` for each moving inner node ({names}), or export the "
        "sub-assembly as separate nodes."
    )
    return warning("inside", text, node)


def bodies(parts: Iterable[Part]) -> dict[str, list[Part]]:
    """Return {body name: its parts}.

    The bodies are the assembly nodes at the first level with more than one node. Nodes with one name are numbered, so
    that a part that is used several times is several bodies.
    """
    placed = list(parts)
    level = 0  # assemblies often are in folders of one node each
    while _is_one_node(placed, level):
        level += 1
    by_node: dict[str, list[Part]] = {}
    for part in placed:
        # A part above the level is a body of its own.
        node = part.chain[min(level, len(part.chain) - 1)]
        by_node.setdefault(node, []).append(part)
    return by_node


def _is_one_node(parts: Iterable[Part], level: int) -> bool:
    """Return whether all parts are below the same node of a level of the assembly."""
    nodes = set()
    for part in parts:
        # A part directly at this level is a body itself: one level deeper, it would be lost among the parts of
        # others.
        if len(part.chain) <= level + 1:
            return False
        nodes.add(part.chain[level])
    return len(nodes) == 1


def write_skeleton(
    skeleton: Skeleton, name: str, target: Path, source: Path, force: bool = False
) -> tuple[list[Path], Mechanism]:
    """Write the robot folder of a STEP assembly; for the arguments see `folder.write_robot`.

    Returns:
        (files, mechanism): the written files, with the description first; the mechanism with all bodies fixed.
    """
    mechanisms: list[Mechanism] = []  # filled by `write_cad`, whose result `write_robot` does not return

    def write_cad(folder: Path) -> Mechanism:
        # Without masses: the materials of a skeleton are still comments.
        shutil.copyfile(source, folder / f"{name}.step")
        (folder / f"{name}.toml").write_text(describe(skeleton, name, source.name), "utf-8")
        mechanisms.append(read_mechanism(folder / f"{name}.toml", with_mass=False).mechanism)
        return mechanisms[0]

    files = write_robot(name, target, write_cad, skeleton.findings, source, force)
    return files, mechanisms[0]


def describe(skeleton: Skeleton, name: str, source: str) -> str:
    """Return the description of a skeleton in TOML."""
    lines = [
        f"# {name}, made by `twin new` from {one_line(source)}. A skeleton: every body is fixed to the base.",
        "# To add joints: uncomment the correct proposals below, name them, mark the driven joints with",
        "# `active = true` (list driven joints first), and delete the temporary fixed joint of each body that now "
        "moves.",
        *rows({"name": name, "title": name, "source": source, "default_protocol": "first", "base": skeleton.base}),
        *rows({"tool": "tool", "step": f"{name}.step"}),
        *TOLERANCE,
        "",
        "# [material.steel]",
        "# density_kg_m3 = 7850",
        '# parts = ["*"] # names of parts, with * and ?',
        '# provenance = "ASSUMED"',
        '# note = "where the density comes from"',
        *DRIVE_COMMENT,
        "",
        "# [[limit]]",
        '# joints = ["NAME"]',
        "# limits_deg = [-90, 90] # of a slide: limits_mm",
        '# provenance = "ASSUMED"',
        '# note = "where the limits come from"',
    ]
    for body in skeleton.parts:
        node = skeleton.nodes[body]
        lines += table(f"[body.{body}]", node=node if node != body else None)
    features: dict[str, JsonObject] = {}
    for proposal in skeleton.proposals:
        features.setdefault(proposal.parent, {}).update(proposal.on_parent.features)
        features.setdefault(proposal.child, {}).update(proposal.on_child.features)
    for body in skeleton.parts:
        if body in features:
            lines += table(f"[feature.{body}]", **features[body])
    for proposal in skeleton.proposals:
        lines += _joint_comment(proposal)
    origin = "{ position_mm = [0, 0, 0], angles_deg = [0, 0, 0] }"
    for body in skeleton.parts:
        if body == skeleton.base:
            continue
        # The skeleton must load before its first joint is named: every body hangs on the base until then.
        lines += table("[[joint]]", name=f"hold_{body}", type="fixed", parent=skeleton.base, child=body)
        lines += [f"on_parent = {origin}", f"on_child = {origin}"]
    # The tool of a STEP file is not known; the user moves it from the middle of the outermost body.
    middle = _middle(skeleton.parts[skeleton.tool]) / MM
    position = [round(coordinate, 3) for coordinate in middle.tolist()]
    lines += [
        "",
        "[frame.tool] # at the middle of the outermost body: move it to the tool",
        f"body = {toml(skeleton.tool)}",
        f"at = {{ position_mm = {toml(position)}, angles_deg = [0, 0, 0] }}",
        "",
        "[posture.home] # a value for each driven joint, such as NAME_deg = 0 or NAME_mm = 0 for the drawn state",
    ]
    return "\n".join(lines) + "\n"


def _joint_comment(proposal: Proposal) -> list[str]:
    """Return the lines of a proposed joint, which are comments."""
    lines = ["", f"# {one_line(proposal.evidence)}"]
    if proposal.misses:
        lines.append(f"# In the CAD, the two frames of this joint are {proposal.miss} apart.")
        lines.append(f"# Confidence that the faces of the two bodies fit: {proposal.pair.confidence}.")
    _, *rows_of_joint = table(
        "[[joint]]",
        name=proposal.name,
        type=proposal.type,
        parent=proposal.parent,
        child=proposal.child,
        on_parent=proposal.on_parent.frame,
        on_child=proposal.on_child.frame,
    )
    for row in rows_of_joint:
        lines.append(f"# {row}")
    return lines


def _middle(parts: Iterable[Part]) -> Array:
    points = np.concatenate([part.vertices for part in parts])
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def read(path: Path, options: Options) -> Imported:
    """Raise an error: a STEP file has no joints."""
    raise SourceError(f"{path}: a STEP file has no joints: use `twin new`, which makes a skeleton from it")
