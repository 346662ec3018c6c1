"""Compare files without motion with a mechanism at joint states drawn from its whole range.

A file whose links have the names of the mechanism is played at these states like a track, and its poses are compared.
In a file with other names, joints are found by their names or, if their names are unknown too, by structure: each joint
of the file is a joint of the mechanism of the same kind, between the corresponding parts. The lines of two joints, seen
from each other, do not depend on the frames of the links. If all agree, and the frames are those of the mechanism too,
the links get the names of the mechanism, so that masses, limits and drives are compared as well.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.motion import Clip, Content, largest
from twin.exchange.audit.physics import Frame, Joint, Line, Physics
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import MECHANISM, POSITION_TOL, ROTATION_TOL, quantity, um
from twin.exchange.format import Holds
from twin.exchange.formats import holding

CLIP = "drawn joint states"
"""Name of the clip of the drawn states."""

LINE_TOL = 5e-6
"""Maximum difference in m between distances of two joint lines that agree; formats store single precision."""

ANGLE_TOL = 1e-5
"""Maximum difference between cosines of angles of two joint lines that agree."""

REST_TOL = 2e-5
"""Maximum distance in m of two links at rest from the positions that their joint allows; see `usd.GAP_TOL`."""

MOST_WAYS = 64
"""Maximum number of assignments of a file's joints to those of the mechanism that are compared."""

MOST_STEPS = 20_000
"""Maximum number of steps in the search of assignments."""

_SINGLE = ("revolute", "prismatic")


@dataclass(frozen=True)
class States:
    """Drawn states of a mechanism with closed loops.

    Attributes:
        joints: {joint: values (k,) in m or rad} of the joints with one coordinate.
        links: {body: T_world_body (k, 4, 4)}.
    """

    joints: Mapping[str, Array]
    links: Mapping[str, Array]

    def clip(self) -> Clip:
        """Return the states as a clip, one state per second."""
        return Clip(CLIP, np.arange(self.count, dtype=float), self.links, self.joints)

    @property
    def count(self) -> int:
        """Number of states."""
        return len(next(iter(self.links.values())))


def same_names(names: Collection[str], links: Collection[str]) -> bool:
    """Return whether the links of a file have the names of a mechanism's links, at least half of them."""
    shared = len(set(names) & set(links))
    return 2 * shared >= min(len(set(names)), len(links))


def compare_states(content: Content, truth: Physics, states: States) -> None:
    """Compare the joints of a file, whose links have other names than the mechanism, at the drawn states.

    Differences are reported in the file's ledger. If no assignment of the joints is possible, nothing is reported.
    """
    physics = content.physics
    if physics is None:
        return
    ways = _assignments(physics, truth)
    by_name = len(ways) == 1 and all(a == b for a, b in ways[0].items())
    seen = [(_apart(physics, truth, states, way, by_name), way) for way in ways]
    seen = [(rows, way) for rows, way in seen if rows]
    if not seen:
        return
    rows, way = min(seen, key=lambda s: max(row.share for row in s[0]))
    ledger = content.ledger
    worst = max(rows, key=lambda row: row.distance)
    turned = max(rows, key=lambda row: row.cosine)
    count = f"{len(way)} joints x {states.count} states"
    how = "by name" if by_name else "by structure"
    for kind, row, off, unit, limit in (
        ("distances", worst, worst.distance, "m", LINE_TOL),
        ("angles", turned, turned.cosine, "1", ANGLE_TOL),
    ):
        text = f"{kind} of joints (assigned {how}) against {MECHANISM}, {count}"
        ledger.row(text, off, unit, limit, where=f"{row.first}, {row.second}", against=MECHANISM)
    ledger.placed = True
    wrong = [row for row in rows if row.share > 1]
    if not wrong:
        _take_names(content, way, truth, states)
        return
    rigid = [row for row in wrong if row.rigid]
    if by_name or rigid:
        for row in sorted(rigid or wrong, key=lambda row: (row.between, -row.share)):
            ledger.wrong("states.joints", row.text(), row.first, size=um(row.distance, LINE_TOL))
        return
    text = (
        f"{content.file}: its joints were assigned to those of {MECHANISM} by structure only; the zero positions of "
        f"the joints or the distances along their axes differ: {wrong[0].text()}"
    )
    advice = "give joints and links the names of the robot"
    ledger.add("audit.not_compared", "error", text, wrong[0].first, suggestion=advice)


@dataclass(frozen=True)
class _Pair:
    """Two joints of a file: the largest difference to those of the mechanism, over all states.

    Attributes:
        first, second: names of the joints in the file.
        distance: difference of the distances of the two lines in m; 0 if one of the joints is a slide.
        cosine: difference of the cosines of their angles.
        found, meant: the distances in m, or the angles in deg if only these differ, at the state of the difference.
        rigid: whether both joints are on one rigid part, so that zero positions have no influence.
        between: number of joints from the first to the second in the file.
    """

    first: str
    second: str
    distance: float
    cosine: float
    found: float
    meant: float
    rigid: bool
    between: int

    @property
    def share(self) -> float:
        """Difference divided by the tolerance."""
        return max(self.distance / LINE_TOL, self.cosine / ANGLE_TOL)

    def text(self) -> str:
        """Return the difference as a sentence."""
        if self.distance > LINE_TOL:
            return (
                f"the axes of joints '{self.first}' and '{self.second}' are {_length(self.found)} apart; in "
                f"{MECHANISM} they are {_length(self.meant)} apart."
            )
        return (
            f"the axes of joints '{self.first}' and '{self.second}' are at {self.found:.5g} deg; in {MECHANISM} they "
            f"are at {self.meant:.5g} deg."
        )


def _length(value: float) -> str:
    return quantity(value, "m") if value > 1e-9 else "0 mm"


# ------------------------------------------------------------------------------------------------ assignments


def _assignments(physics: Physics, truth: Physics) -> list[dict[str, str]]:
    """Return assignments {joint of the file: joint of the mechanism}: the one by names, else those by structure."""
    own = _singles(physics)
    there = _singles(truth)
    shared = {n: n for n, j in own.items() if n in there and there[n].kind == j.kind}
    if len(shared) >= 2 and 2 * len(shared) >= len(own):
        return [shared]
    ways: list[dict[str, str]] = []
    for steps, way in enumerate(_ways(physics, truth)):
        if way:
            ways.append(way)
        if len(ways) == MOST_WAYS or steps == MOST_STEPS:
            break
    return ways


def _singles(physics: Physics) -> dict[str, Joint]:
    """Return {name: joint} of the joints with one coordinate, which all formats state by one name."""
    return {j.names[0]: j for j in physics.joints if j.kind in _SINGLE and len(j.names) == 1 and j.T is not None}


def _parts(physics: Physics) -> dict[str, str]:
    """Return {link: name of its rigid part}; fixed joints connect the links of a part."""
    part = {n: n for n in (*physics.links, *(n for j in physics.joints for n in (j.parent, j.child)))}
    for joint in physics.joints:
        if joint.kind == "fixed" and joint.parent and joint.child:
            kept, gone = part[joint.parent], part[joint.child]
            part = {n: kept if p == gone else p for n, p in part.items()}
    return part


def _base(physics: Physics) -> str:
    """Return the link from which the joints lead outwards: no joint's child, with the most joints beyond it."""
    children = {j.child for j in physics.joints}
    roots = [n for n in dict.fromkeys(j.parent for j in physics.joints) if n and n not in children]
    held = [n for n in physics.held or () if n in physics.links]
    return (held or roots or list(physics.links) or [""])[0]


def _ways(physics: Physics, truth: Physics) -> Iterator[dict[str, str]]:
    """Yield the assignments by structure, each complete; {} for a step of the search without a result."""
    own, there = _parts(physics), _parts(truth)
    start = (own.get(_base(physics), ""), there.get(_base(truth), ""))
    edges = _outwards(physics, own, start[0])
    singles = list(_singles(truth).items())
    parts = set(there.values())
    if not edges or len(edges) != len(set(own.values())) - 1:
        return

    def search(k: int, placed: dict[str, str], way: dict[str, str]) -> Iterator[dict[str, str]]:
        if k == len(edges):
            yield dict(way) if set(placed.values()) == parts else {}
            return
        yield {}
        name, joint, near, far = edges[k]
        for other, candidate in singles:
            ends = (there[candidate.parent], there[candidate.child])
            if candidate.kind != joint.kind or placed[near] not in ends or other in way.values():
                continue
            beyond = ends[1] if placed[near] == ends[0] else ends[0]
            if beyond not in placed.values():
                yield from search(k + 1, placed | {far: beyond}, way | {name: other})

    yield from search(0, {start[0]: start[1]}, {})


def _outwards(physics: Physics, part: Mapping[str, str], start: str) -> list[tuple[str, Joint, str, str]]:
    """Return (name, joint, nearer part, farther part) for the joints of a tree from the part `start` outwards."""
    reached, out = {start}, []
    singles = list(_singles(physics).items())
    grown = True
    while grown:
        grown = False
        for name, joint in singles:
            near, far = part[joint.parent], part[joint.child]
            if near in reached and far not in reached:
                out.append((name, joint, near, far))
                reached.add(far)
                grown = True
    return out


# -------------------------------------------------------------------------------------------------- geometry


def _placed(physics: Physics, values: Mapping[str, Array], count: int) -> dict[str, Array]:
    """Return {link: T_base_link (k, 4, 4)} of the links that joints with known values (k,) connect with the base."""
    base = _base(physics)
    placed = {base: np.broadcast_to(np.eye(4), (count, 4, 4))}
    grown = True
    while grown:
        grown = False
        for joint in physics.joints:
            for one in (joint, joint.turned()) if joint.T is not None else ():
                if one.parent in placed and one.child not in placed and (T := _relative(one, values)) is not None:
                    placed[one.child] = placed[one.parent] @ T
                    grown = True
    return placed


def _relative(joint: Joint, values: Mapping[str, Array]) -> Array | None:
    """Return T_parent_child (k, 4, 4) or (4, 4) of a joint at its values; None if they are unknown."""
    if joint.kind == "fixed":
        return joint.T
    if joint.kind not in _SINGLE or len(joint.names) != 1 or joint.names[0] not in values:
        return None
    return joint.motions[0].moved(values[joint.names[0]]) @ joint.T


def _lines(joint: Joint, links: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return points and directions, both (k, 3), of a joint's line in the world."""
    line: Line = joint.motions[0]
    T = links[joint.parent]
    return T[:, :3, :3] @ line.point + T[:, :3, 3], T[:, :3, :3] @ line.direction


def _apart(physics: Physics, truth: Physics, states: States, way: Mapping[str, str], signed: bool) -> list[_Pair]:
    """Return the differences of all pairs of assigned joints; [] if fewer than two can be placed.

    `signed` is whether the directions of the axes count: a file can have parent and child of a joint exchanged.
    """
    own, there = _singles(physics), _singles(truth)
    values = {name: states.joints[other] for name, other in way.items() if other in states.joints}
    links = _placed(physics, values, states.count)
    part = _parts(physics)
    names = [n for n in way if n in values and own[n].parent in links]
    out = []
    for i, k in combinations(range(len(names)), 2):
        a, b = names[i], names[k]
        slides = "prismatic" in (own[a].kind, own[b].kind)
        here = _seen(_lines(own[a], links), _lines(own[b], links))
        meant = _seen(_lines(there[way[a]], states.links), _lines(there[way[b]], states.links))
        if not signed:
            here, meant = ((np.abs(cosine), np.abs(distance)) for cosine, distance in (here, meant))
        cosine = np.abs(here[0] - meant[0])
        distance = np.zeros(states.count) if slides else np.abs(here[1] - meant[1]).max(axis=1)
        at = int(np.argmax(distance))
        shown = [float(np.abs(s[1][at]).max()) for s in (here, meant)]
        if distance[at] <= LINE_TOL:
            at = int(np.argmax(cosine))
            shown = [float(np.degrees(np.arccos(np.clip(s[0][at], -1, 1)))) for s in (here, meant)]
        ends = [{part[own[n].parent], part[own[n].child]} for n in (a, b)]
        rigid = bool(ends[0] & ends[1])
        out.append(_Pair(a, b, float(distance.max()), float(cosine.max()), shown[0], shown[1], rigid, k - i))
    return out


def _seen(one: tuple[Array, Array], two: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return (cosines of the angles (k,), distances (k, 2) in m) of two lines at k states.

    The first distance is signed, by the side on which one line passes the other; it is zero for parallel lines. The
    second is the distance of parallel lines; it is zero for other lines.
    """
    (p, d), (q, e) = one, two
    cosine = np.sum(d * e, axis=1)
    normal = np.cross(d, e)
    size = np.linalg.norm(normal, axis=1)
    parallel = size < 1e-4
    passing = np.sum((q - p) * normal, axis=1) / np.where(parallel, 1.0, size)
    beside = np.linalg.norm(np.cross(d, q - p), axis=1)
    return cosine, np.column_stack([np.where(parallel, 0.0, passing), np.where(parallel, beside, 0.0)])


# ----------------------------------------------------------------------------------------------------- names


def _take_names(content: Content, way: Mapping[str, str], truth: Physics, states: States) -> None:
    """Give links and joints of a file the names of the mechanism, if their frames are those of the mechanism.

    Otherwise, state in the file's ledger that masses, shapes and limits are not compared.
    """
    physics = content.physics
    assert physics is not None
    values = {name: states.joints[other] for name, other in way.items() if other in states.joints}
    links = _placed(physics, values, states.count)
    base = _base(truth)
    named: dict[str, str] = {}
    for body in truth.links:
        meant = poses.inverse(states.links[base]) @ states.links[body]
        for link, T in links.items():
            p, _, r, _ = largest(np.broadcast_to(T, meant.shape), meant)
            if link not in named and p <= POSITION_TOL and r <= ROTATION_TOL:
                named[link] = body
                break
    if len(named) < len(truth.links):
        lacking = [n for n in truth.links if n not in named.values()]
        more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
        text = (
            f"{content.file}: the joints agree with {MECHANISM}, but no link has the frame of '{lacking[0]}'"
            f"{more}: masses, shapes and limits are not compared."
        )
        content.ledger.add("audit.not_compared", "error", text, lacking[0], suggestion="give links the robot's names")
        return
    between = {frozenset((j.parent, j.child)): j.names[0] for j in truth.joints}
    joints = dict(way)
    for joint in physics.joints:
        ends = frozenset((named.get(joint.parent, ""), named.get(joint.child, "")))
        if len(joint.names) == 1 and not joint.tied and ends in between:
            joints.setdefault(joint.names[0], between[ends])
    _rename(content, named, joints)
    # The joints of links without a body have no counterpart by name: in a URDF, two such links join the ends of a loop.
    bodies = {"", *truth.links}
    for i, joint in enumerate(physics.joints):
        if not {joint.parent, joint.child} <= bodies:
            physics.joints[i] = replace(joint, names=())
    pairs = ", ".join(f"{a} is {b}" for a, b in named.items() if a != b)
    content.ledger.add("states.names", "info", f"links have other names than in {MECHANISM}: {pairs}.")


def _keyed(row: Mapping[str, float], names: Mapping[str, str]) -> dict[str, float]:
    return {names.get(n, n): value for n, value in row.items()}


def _rename(content: Content, links: Mapping[str, str], joints: Mapping[str, str]) -> None:
    physics = content.physics
    assert physics is not None

    def link(name: str) -> str:
        return links.get(name, name)

    physics.links = tuple(map(link, physics.links))
    physics.masses = {link(n): m for n, m in physics.masses.items()}
    physics.shown = {link(n): shown for n, shown in physics.shown.items()}
    if physics.floats is not None:
        physics.floats = {link(n): share for n, share in physics.floats.items()}
    physics.assumed = frozenset(map(link, physics.assumed))
    physics.partly = frozenset(map(link, physics.partly))
    physics.held = None if physics.held is None else frozenset(map(link, physics.held))
    physics.frames = {n: Frame(link(f.link), f.T) for n, f in physics.frames.items()}
    physics.points = {n: Frame(link(f.link), f.T) for n, f in physics.points.items()}
    physics.joints = [
        replace(j, names=tuple(joints.get(n, n) for n in j.names), parent=link(j.parent), child=link(j.child))
        for j in physics.joints
    ]
    if physics.reductions is not None:
        physics.reductions = _keyed(physics.reductions, joints)
    if physics.couplings is not None:
        physics.couplings = {n: (_keyed(row, joints), total) for n, (row, total) in physics.couplings.items()}
    if physics.motors is not None:
        motors = {
            n: replace(m, row=None if m.row is None else _keyed(m.row, joints)) for n, m in physics.motors.items()
        }
        physics.motors = motors
    content.declared = None if content.declared is None else tuple(map(link, content.declared))
    content.rest = {link(n): T for n, T in content.rest.items()}
    content.shapes = {link(n): s for n, s in content.shapes.items()}
    content.colors = {link(n): c for n, c in content.colors.items()}


# ------------------------------------------------------------------------------------------------------ rest


def compare_joints(content: Content, truth: Physics) -> None:
    """Compare the poses of a file at rest with the joints of the mechanism, which hold at any joint values."""
    if not content.rest or holding(content.format, Holds.JOINT_TREE) or not same_names(content.rest, truth.links):
        return
    links = {n: T[None] for n, T in content.rest.items()}
    within = [j for j in truth.joints if {j.parent, j.child} <= set(links) and not truth.trocars & set(j.names)]
    off = {joint.names[0]: _misfit(joint, links) for joint in within}
    if not off:
        return
    ledger = content.ledger
    for kind, at, unit, limit in (("position", 0, "m", REST_TOL), ("rotation", 1, "rad", ROTATION_TOL)):
        name = max(off, key=lambda n: off[n][at])
        worst = off[name][at]
        ledger.row(f"rest: {kind} at the joints of {MECHANISM}", worst, unit, limit, where=name, against=MECHANISM)
        if worst > limit:
            size = quantity(worst, "m") if unit == "m" else f"{np.degrees(worst):.4g} deg"
            text = f"rest: the links of joint '{name}' are {size} from any position that {MECHANISM} allows."
            ledger.wrong("states.rest", text, name)
    ledger.placed = True


def _misfit(joint: Joint, links: Mapping[str, Array]) -> tuple[float, float]:
    """Return the largest distance (m) and angle (rad) of a joint's two links from the positions that it allows."""
    assert joint.T is not None
    off = poses.inverse(links[joint.parent] @ joint.T) @ links[joint.child]  # from the child at zero to the child
    lines = [line.seen(poses.inverse(joint.T)) for line in joint.motions]
    turns = [line for line in lines if line.kind == "turn"]
    R = off[:, :3, :3]
    point, turn = np.zeros(3), 0.0
    if turns:
        point = turns[0].point
    if len(turns) == 1:
        axis = turns[0].direction
        turn = float(np.linalg.norm(R @ axis - axis, axis=1).max())
    elif not turns:
        turn = float(poses.angle(R, np.broadcast_to(np.eye(3), R.shape)).max())
    shift = R @ point + off[:, :3, 3] - point
    for line in lines:
        if line.kind == "slide":
            shift = shift - np.sum(shift * line.direction, axis=1, keepdims=True) * line.direction
    return float(np.linalg.norm(shift, axis=1).max()), turn
