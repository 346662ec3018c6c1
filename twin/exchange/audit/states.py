"""Compare files without motion with a mechanism at joint states drawn from its whole range.

A file whose links have the names of the mechanism is played at these states like a track, and its poses are compared.
In a file with other names, joints are found by their names or, if their names are unknown too, by structure: each joint
of the file is a joint of the mechanism of the same kind, between the corresponding parts. The lines of two joints, seen
from each other, do not depend on the frames of the links. If all agree, and the frames are those of the mechanism too,
the links get the names of the mechanism, so that masses, limits and drives are compared as well.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.mechanism_data import FileJoint, FilePhysics, JointLine, meeting
from twin.exchange.audit.motion import Content, FileClip, largest
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
class DrawnStates:
    """Drawn states of a mechanism with closed loops.

    Attributes:
        joints: {joint: values (k,) in m or rad} of the joints with one coordinate.
        links: {body: T_world_body (k, 4, 4)}.
    """

    joints: Mapping[str, Array]
    links: Mapping[str, Array]

    def clip(self) -> FileClip:
        """Return the states as a clip, one state per second."""
        return FileClip(CLIP, np.arange(self.count, dtype=float), self.links, self.joints)

    @property
    def count(self) -> int:
        """Number of states."""
        return len(next(iter(self.links.values())))


def same_names(names: Collection[str], links: Collection[str]) -> bool:
    """Return whether the links of a file have the names of a mechanism's links, at least half of them."""
    shared = len(set(names) & set(links))
    return 2 * shared >= min(len(set(names)), len(links))


def compare_states(content: Content, truth: FilePhysics, states: DrawnStates) -> None:
    """Compare the joints of a file, whose links have other names than the mechanism, at the drawn states.

    Differences are reported in the file's ledger. If no assignment of the joints is possible, nothing is reported.
    """
    physics = content.physics
    if physics is None:
        return
    assignments = _assignments(physics, truth)
    by_name = False
    if len(assignments) == 1:
        by_name = list(assignments[0].keys()) == list(assignments[0].values())
    compared: list[tuple[float, list[_Pair], dict[str, str]]] = []
    for assignment in assignments:
        pairs = _differences(physics, truth, states, assignment, by_name)
        if pairs:
            worst_pair = max(pairs, key=lambda p: p.share)
            compared.append((worst_pair.share, pairs, assignment))
    if not compared:
        return
    # The assignment with the smallest of the largest differences; of equal ones the first.
    _, pairs, assignment = min(compared, key=lambda c: c[0])
    ledger = content.ledger
    how = "by name" if by_name else "by structure"
    kind = f"of joints (assigned {how}) against {MECHANISM}, {len(assignment)} joints x {states.count} states"
    pair = max(pairs, key=lambda p: p.distance)
    ledger.row(f"distances {kind}", pair.distance, "m", LINE_TOL, where=pair.names, against=MECHANISM)
    pair = max(pairs, key=lambda p: p.cosine)
    ledger.row(f"angles {kind}", pair.cosine, "1", ANGLE_TOL, where=pair.names, against=MECHANISM)
    ledger.placed = True
    wrong = [pair for pair in pairs if pair.share > 1]
    if not wrong:
        _take_names(content, assignment, truth, states)
        return
    rigid = [pair for pair in wrong if pair.rigid]
    if by_name or rigid:
        reported = rigid or wrong
        reported.sort(key=lambda p: (p.between, -p.share))
        for pair in reported:
            ledger.wrong("states.joints", pair.text(), pair.first, size=um(pair.distance, LINE_TOL))
        return
    first = wrong[0]
    text = (
        f"{content.file}: its joints were assigned to those of {MECHANISM} by structure only; the zero positions of "
        f"the joints or the distances along their axes differ: {first.text()}"
    )
    advice = "give joints and links the names of the robot"
    ledger.add("audit.not_compared", "error", text, first.first, suggestion=advice)


@dataclass(frozen=True)
class _Pair:
    """Two joints of a file: the largest difference to those of the mechanism, over all states.

    The differences are infinite if a number of the file is not finite: such joints agree with none.

    Attributes:
        first, second: names of the joints in the file.
        distance: difference of the distances of the two lines in m; 0 if one of the joints is a slide.
        cosine: difference of the cosines of their angles.
        found, meant: the distances in m, or the angles in deg if only these differ, at the state of the difference.
        rigid: whether both joints are on one rigid part, so that zero positions have no influence.
        between: places from the first to the second among the compared joints, in the order of their assignment.
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
    def names(self) -> str:
        """Names of both joints."""
        return f"{self.first}, {self.second}"

    @property
    def share(self) -> float:
        """Difference divided by the tolerance."""
        return max(self.distance / LINE_TOL, self.cosine / ANGLE_TOL)

    def text(self) -> str:
        """Return the difference as a sentence."""
        if not np.isfinite(self.share):
            return (
                f"the axes of joints '{self.first}' and '{self.second}' cannot be compared with {MECHANISM}: a number "
                "of their poses in the file is not finite."
            )
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
    if value <= 1e-9:  # rounding
        return "0 mm"
    return quantity(value, "m")


# ------------------------------------------------------------------------------------------------ assignments


def _assignments(physics: FilePhysics, truth: FilePhysics) -> list[dict[str, str]]:
    """Return assignments {joint of the file: joint of the mechanism}: the one by names, else those by structure."""
    own = _singles(physics)
    others = _singles(truth)
    shared = {}
    for name, joint in own.items():
        if name in others and others[name].kind == joint.kind:
            shared[name] = name
    if len(shared) >= 2 and 2 * len(shared) >= len(own):
        return [shared]
    found: list[dict[str, str]] = []
    for steps, assignment in enumerate(_by_structure(physics, truth)):
        if assignment:
            found.append(assignment)
        if len(found) == MOST_WAYS or steps == MOST_STEPS:
            break
    return found


def _singles(physics: FilePhysics) -> dict[str, FileJoint]:
    """Return {name: joint} of the joints with one coordinate, which all formats state by one name."""
    singles = {}
    for joint in physics.joints:
        if joint.kind in _SINGLE and len(joint.names) == 1 and joint.T is not None:
            singles[joint.names[0]] = joint
    return singles


def _parts(physics: FilePhysics) -> dict[str, str]:
    """Return {link: name of its rigid part}; fixed joints connect the links of a part."""
    part = {link: link for link in physics.links}
    for joint in physics.joints:
        part.setdefault(joint.parent, joint.parent)
        part.setdefault(joint.child, joint.child)
    for joint in physics.joints:
        if joint.kind == "fixed" and joint.parent and joint.child:
            kept = part[joint.parent]
            joined = part[joint.child]
            for link, name in part.items():
                if name == joined:
                    part[link] = kept
    return part


def _base(physics: FilePhysics) -> str:
    """Return the link from which the joints lead outwards: one that is held, else the first that is no joint's child.

    Without such links, this is the first link.
    """
    for link in physics.held or ():
        if link in physics.links:
            return link
    children = {joint.child for joint in physics.joints}
    for joint in physics.joints:
        if joint.parent and joint.parent not in children:
            return joint.parent
    if not physics.links:
        return ""
    return physics.links[0]


@dataclass(frozen=True)
class _Edge:
    """A joint with one coordinate, between the rigid parts `near` and `far` of a tree, seen from its base."""

    name: str
    joint: FileJoint
    near: str
    far: str


def _by_structure(physics: FilePhysics, truth: FilePhysics) -> Iterator[dict[str, str]]:
    """Yield the assignments by structure, each complete; {} for a step of the search without a result."""
    own = _parts(physics)
    others = _parts(truth)
    start = own.get(_base(physics), "")
    edges = _outwards(physics, own, start)
    singles = _singles(truth)
    if not edges or len(edges) != len(set(own.values())) - 1:
        return

    def search(k: int, placed: dict[str, str], assignment: dict[str, str]) -> Iterator[dict[str, str]]:
        """Assign the edges from number k on; `placed` is {part of the file: part of the mechanism}."""
        if k == len(edges):
            if set(placed.values()) == set(others.values()):
                yield dict(assignment)
            else:
                yield {}
            return
        yield {}
        edge = edges[k]
        near = placed[edge.near]
        for name, candidate in singles.items():
            ends = (others[candidate.parent], others[candidate.child])
            if candidate.kind != edge.joint.kind or near not in ends or name in assignment.values():
                continue
            first, second = ends
            far = second if near == first else first
            if far not in placed.values():
                yield from search(k + 1, placed | {edge.far: far}, assignment | {edge.name: name})

    yield from search(0, {start: others.get(_base(truth), "")}, {})


def _outwards(physics: FilePhysics, part: Mapping[str, str], start: str) -> list[_Edge]:
    """Return the joints of a tree from the part `start` outwards."""
    reached = {start}
    edges = []
    singles = _singles(physics)
    grown = True
    while grown:
        grown = False
        for name, joint in singles.items():
            near = part[joint.parent]
            far = part[joint.child]
            if near in reached and far not in reached:
                edges.append(_Edge(name, joint, near, far))
                reached.add(far)
                grown = True
    return edges


# -------------------------------------------------------------------------------------------------- geometry


def _placed(physics: FilePhysics, values: Mapping[str, Array], count: int) -> dict[str, Array]:
    """Return {link: T_base_link (k, 4, 4)} of the links that joints with known values (k,) connect with the base."""
    base = _base(physics)
    placed = {base: np.broadcast_to(np.eye(4), (count, 4, 4))}
    grown = True
    while grown:
        grown = False
        for joint in physics.joints:
            if joint.T is None:
                continue
            # A file may lead from the base outwards by the child of a joint.
            for outward in (joint, joint.turned()):
                if outward.parent not in placed or outward.child in placed:
                    continue
                T = _relative(outward, values)
                if T is not None:
                    placed[outward.child] = placed[outward.parent] @ T
                    grown = True
    return placed


def _relative(joint: FileJoint, values: Mapping[str, Array]) -> Array | None:
    """Return T_parent_child (k, 4, 4) or (4, 4) of a joint at its values; None if they are unknown."""
    if joint.kind == "fixed":
        return joint.T
    if joint.kind not in _SINGLE or len(joint.names) != 1 or joint.names[0] not in values:
        return None
    return joint.motions[0].moved(values[joint.names[0]]) @ joint.T


def _lines(joint: FileJoint, links: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return points and directions, both (k, 3), of a joint's line in the world."""
    line: JointLine = joint.motions[0]
    T = links[joint.parent]
    R = T[:, :3, :3]
    return R @ line.point + T[:, :3, 3], R @ line.direction


def _values(states: DrawnStates, assignment: Mapping[str, str]) -> dict[str, Array]:
    """Return {joint of the file: values (k,)} for the joints that are assigned to joints with known values."""
    values = {}
    for name, other in assignment.items():
        if other in states.joints:
            values[name] = states.joints[other]
    return values


def _differences(
    physics: FilePhysics, truth: FilePhysics, states: DrawnStates, assignment: Mapping[str, str], signed: bool
) -> list[_Pair]:
    """Return the differences of all pairs of assigned joints; [] if fewer than two can be placed.

    `signed` is whether the directions of the axes count: a file can have parent and child of a joint exchanged.
    """
    own = _singles(physics)
    others = _singles(truth)
    values = _values(states, assignment)
    links = _placed(physics, values, states.count)
    part = _parts(physics)
    names = [name for name in assignment if name in values and own[name].parent in links]
    pairs = []
    for i, k in combinations(range(len(names)), 2):
        a = names[i]
        b = names[k]
        cosine, distance = _seen(_lines(own[a], links), _lines(own[b], links))
        expected_lines = _lines(others[assignment[a]], states.links), _lines(others[assignment[b]], states.links)
        expected_cosine, expected_distance = _seen(*expected_lines)
        if not signed:
            cosine = np.abs(cosine)
            distance = np.abs(distance)
            expected_cosine = np.abs(expected_cosine)
            expected_distance = np.abs(expected_distance)
        turned = np.abs(cosine - expected_cosine)
        shifted = np.zeros(states.count)
        if "prismatic" not in (own[a].kind, own[b].kind):  # the line of a slide has no place
            shifted = np.abs(distance - expected_distance).max(axis=1)
        at = int(np.argmax(shifted))
        if shifted[at] <= LINE_TOL:
            at = int(np.argmax(turned))
            shown = _degrees(cosine[at])
            expected = _degrees(expected_cosine[at])
        else:  # also if the distance is not a number
            shown = float(np.abs(distance[at]).max())
            expected = float(np.abs(expected_distance[at]).max())
        parts_of_a = {part[own[a].parent], part[own[a].child]}
        parts_of_b = {part[own[b].parent], part[own[b].child]}
        rigid = bool(parts_of_a & parts_of_b)
        distance_off = _or_infinite(shifted.max())
        cosine_off = _or_infinite(turned.max())
        pairs.append(_Pair(a, b, distance_off, cosine_off, shown, expected, rigid, k - i))
    return pairs


def _or_infinite(difference: float) -> float:
    """Return a difference; infinity for NaN, which no limit would find too large."""
    if np.isnan(difference):
        return np.inf
    return float(difference)


def _degrees(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _seen(one: tuple[Array, Array], two: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return (cosines of the angles (k,), distances (k, 2) in m) of two lines at k states.

    The first distance is signed, by the side on which one line passes the other; it is zero for parallel lines. The
    second is the distance of parallel lines; it is zero for other lines.
    """
    point, direction = one
    other_point, other_direction = two
    between = other_point - point
    cosine = np.sum(direction * other_direction, axis=1)
    normal = np.cross(direction, other_direction)
    sine = np.linalg.norm(normal, axis=1)
    parallel = sine < 1e-4  # the common normal of nearly parallel lines is only rounding
    passing = np.sum(between * normal, axis=1) / np.where(parallel, 1.0, sine)
    beside = np.linalg.norm(np.cross(direction, between), axis=1)
    distances = np.column_stack([np.where(parallel, 0.0, passing), np.where(parallel, beside, 0.0)])
    return cosine, distances


# ----------------------------------------------------------------------------------------------------- names


def _take_names(content: Content, assignment: Mapping[str, str], truth: FilePhysics, states: DrawnStates) -> None:
    """Give links and joints of a file the names of the mechanism, if their frames are those of the mechanism.

    Otherwise, state in the file's ledger that masses, shapes and limits are not compared.
    """
    physics = content.physics
    assert physics is not None
    links = _placed(physics, _values(states, assignment), states.count)
    bodies = _bodies_of_links(links, truth, states)
    if len(bodies) < len(truth.links):
        lacking = [body for body in truth.links if body not in bodies.values()]
        more = ""
        if len(lacking) > 1:
            more = f" and {len(lacking) - 1} more"
        text = (
            f"{content.file}: the joints agree with {MECHANISM}, but no link has the frame of '{lacking[0]}'"
            f"{more}: masses, shapes and limits are not compared."
        )
        content.ledger.add("audit.not_compared", "error", text, lacking[0], suggestion="give links the robot's names")
        return
    by_ends = {}
    for joint in truth.joints:
        by_ends[frozenset((joint.parent, joint.child))] = joint.names[0]
    joints = dict(assignment)
    for joint in physics.joints:
        ends = frozenset((bodies.get(joint.parent, ""), bodies.get(joint.child, "")))
        if len(joint.names) == 1 and not joint.tied and ends in by_ends:
            joints.setdefault(joint.names[0], by_ends[ends])
    content.rename(bodies, joints)
    # The joints of links without a body have no counterpart by name: in a URDF, two such links join the ends of a loop.
    named = {"", *truth.links}
    for i, joint in enumerate(physics.joints):
        if not {joint.parent, joint.child} <= named:
            physics.joints[i] = replace(joint, names=())
    renamed = []
    for link, body in bodies.items():
        if link != body:
            renamed.append(f"{link} is {body}")
    text = f"links have other names than in {MECHANISM}: {', '.join(renamed)}."
    content.ledger.add("states.names", "info", text)


def _bodies_of_links(links: Mapping[str, Array], truth: FilePhysics, states: DrawnStates) -> dict[str, str]:
    """Return {link: body of the mechanism with the same frame at all states}."""
    from_base = poses.inverse(states.links[_base(truth)])
    bodies: dict[str, str] = {}
    for body in truth.links:
        expected = from_base @ states.links[body]
        for link, T in links.items():
            difference = largest(np.broadcast_to(T, expected.shape), expected)
            same = difference.distance <= POSITION_TOL and difference.angle <= ROTATION_TOL
            if same and link not in bodies:
                bodies[link] = body
                break
    return bodies


# ------------------------------------------------------------------------------------------------------ rest


def compare_joints(content: Content, truth: FilePhysics, source: str = MECHANISM) -> None:
    """Compare the poses of a file at rest with the joints of the mechanism, which hold at any joint values.

    `truth` may also be that of another file, `source`, in which all joints have places.
    """
    if not content.rest or holding(content.format, Holds.JOINT_TREE) or not same_names(content.rest, truth.links):
        return
    links = {link: T[None] for link, T in content.rest.items()}
    distances = {}
    angles = {}
    for joint in truth.joints:
        moved = truth.trocars & set(joint.names)  # each protocol has its own positions of trocars
        if {joint.parent, joint.child} <= set(links) and not moved:
            name = f"{joint.parent} to {joint.child}"  # fixed joints may have no name
            if joint.names:
                name = joint.names[0]
            distance, angles[name] = _misfit(joint, links)
            if distance is not None:
                distances[name] = distance
    if not angles:
        return
    ledger = content.ledger
    ending = f"from any position that {source} allows."

    if distances:
        name = max(distances, key=lambda n: distances[n])
        worst = distances[name]
        check = f"rest: position at the joints of {source}"
        ledger.row(check, worst, "m", REST_TOL, where=name, against=source)
        if worst > REST_TOL:
            text = f"rest: the links of joint '{name}' are {quantity(worst, 'm')} {ending}"
            ledger.wrong("states.rest", text, name)

    name = max(angles, key=lambda n: angles[n])
    worst = angles[name]
    check = f"rest: rotation at the joints of {source}"
    ledger.row(check, worst, "rad", ROTATION_TOL, where=name, against=source)
    if worst > ROTATION_TOL:
        text = f"rest: the links of joint '{name}' are {np.degrees(worst):.4g} deg {ending}"
        ledger.wrong("states.rest", text, name)
    ledger.placed |= source == MECHANISM


def _misfit(joint: FileJoint, links: Mapping[str, Array]) -> tuple[float | None, float]:
    """Return the largest distance (m) and angle (rad) of a joint's two links from the positions that it allows.

    The distance is None if the joint has no point whose positions are known to be on a line or a plane, such as two
    turns that do not meet, or a turn that swings the slide after it.
    """
    assert joint.T is not None
    zero = links[joint.parent] @ joint.T  # the child at zero
    T = poses.inverse(zero) @ links[joint.child]
    R = T[:, :3, :3]
    to_child = poses.inverse(joint.T)
    lines = [line.seen(to_child) for line in joint.motions]
    turns = [line for line in lines if line.kind == "turn"]
    angle = 0.0
    if len(turns) == 1:
        axis = turns[0].direction
        angle = float(np.linalg.norm(R @ axis - axis, axis=1).max())
    elif not turns:
        unturned = np.broadcast_to(np.eye(3), R.shape)
        angle = float(poses.angle(R, unturned).max())
    point = _unturned_point(turns)
    if point is None or _swings_slide(lines):
        return None, _or_infinite(angle)
    shift = R @ point + T[:, :3, 3] - point
    for direction in _slide_directions(lines):
        along = np.sum(shift * direction, axis=1, keepdims=True)
        shift = shift - along * direction
    return _or_infinite(np.linalg.norm(shift, axis=1).max()), _or_infinite(angle)


def _unturned_point(turns: Sequence[JointLine]) -> Array | None:
    """Return a point (3,) in m that turns do not move, because it is on all of their lines; None without one."""
    if not turns:
        return np.zeros(3)
    for point in (turns[0].point, meeting(turns)):
        distances = [np.linalg.norm(np.cross(line.direction, point - line.point)) for line in turns]
        if max(distances) <= LINE_TOL:
            return point
    return None


def _swings_slide(lines: Sequence[JointLine]) -> bool:
    """Return whether a turn changes the direction of a slide after it, from the parent outwards."""
    turns: list[JointLine] = []
    for line in lines:
        if line.kind == "turn":
            turns.append(line)
            continue
        for turn in turns:
            if np.linalg.norm(np.cross(turn.direction, line.direction)) > ANGLE_TOL:
                return True
    return False


def _slide_directions(lines: Sequence[JointLine]) -> list[Array]:
    """Return unit vectors (3,), at right angles to each other, that span the directions of all slides."""
    directions: list[Array] = []
    for line in lines:
        if line.kind != "slide":
            continue
        rest = line.direction
        for direction in directions:
            rest = rest - (rest @ direction) * direction
        size = np.linalg.norm(rest)
        if size > ANGLE_TOL:  # else it is a direction of the slides before
            directions.append(rest / size)
    return directions
