"""Compare the mechanism data of files, with one table of quantities and their tolerances.

Each format counts as one independent source, because several files of a format may share data (five stages may share
one layer). If a mechanism is given, the value in the mechanism counts as correct; otherwise, the value that most
sources state.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from twin.core.json_types import JsonMapping
from twin.exchange.audit import poses
from twin.exchange.audit.colors import Rgba, apart
from twin.exchange.audit.motion import Content, Shape
from twin.exchange.audit.physics import TOOL, WORLD, Joint, Physics
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import MECHANISM, Ledger, Measured, quantity
from twin.exchange.format import Holds
from twin.exchange.formats import family, family_rank, holding, trust

_GEOMETRY = ("place", "axis", "pose", "zero")
"""Quantities that show where the joints of a robot are."""

_ZERO = 1e-6
"""Maximum absolute value of a coupling's ratio that counts as zero (rounding of single precision).

Before the comparison, the ratios are divided by the largest absolute ratio of the coupling."""


def _number(a: float, b: float) -> float:
    if a == b:
        return 0.0
    return abs(a - b) / max(abs(a), abs(b)) if np.isfinite(a) and np.isfinite(b) else np.inf


def _row(a: Mapping[str, float], b: Mapping[str, float]) -> float:
    """Return the relative difference between two mappings {joint: factor}; a missing joint has the factor 0."""
    both = np.array([(a.get(n, 0.0), b.get(n, 0.0)) for n in dict.fromkeys((*a, *b))], float).reshape(-1, 2)
    size = float(np.linalg.norm(both, axis=0).max(initial=0.0))
    return float(np.linalg.norm(both[:, 0] - both[:, 1])) / size if size else 0.0


def _word(a: Any, b: Any) -> float:
    return 0.0 if a == b else 1.0


def _ends(a: tuple[float, float], b: tuple[float, float]) -> float:
    return max((0.0 if x == y else abs(x - y) / max(1.0, min(abs(x), abs(y)))) for x, y in zip(a, b, strict=True))


def _passive(a: Sequence[float], b: Sequence[float]) -> float:
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _distance(a: Array | float, b: Array | float) -> float:
    return float(np.linalg.norm(np.subtract(a, b)))


def _tensor(a: Array, b: Array) -> float:
    """Return the largest difference of two entries, relative to the largest entry: products of inertia are small."""
    largest = max(np.abs(a).max(), np.abs(b).max(), 1e-300)
    return float(np.abs(a - b).max() / largest)


def _direction(a: Array, b: Array) -> float:
    return float(min(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def _sense(a: tuple[Array, bool], b: tuple[Array, bool]) -> float:
    """Return the distance between two unit vectors; their sign is ignored if one of the files states no sign."""
    return _distance(a[0], b[0]) if a[1] and b[1] else _direction(a[0], b[0])


def _line(a: tuple[Array, Array | None], b: tuple[Array, Array | None]) -> float:
    """Return the distance in m from b's point to line a; if a or b has no direction, the distance of their points."""
    off = b[0] - a[0]
    if a[1] is None or b[1] is None:
        return float(np.linalg.norm(off))
    return float(np.linalg.norm(np.cross(a[1], off)))


def _place(a: Array, b: Array) -> float:
    return max(_distance(a[:3, 3], b[:3, 3]), 0.1 * float(poses.angle(a[:3, :3], b[:3, :3])))


def _surface(a: Array, b: Array) -> float:
    """Return the Hausdorff distance in m between the points of two meshes.

    Return 0 if fewer than 70 % of the points of a mesh coincide with points of the other mesh: the meshes then have
    different triangles, and only `compare_shapes` compares them, by bounding box and volume.
    """
    if a.shape == b.shape and np.array_equal(a, b):
        return 0.0
    there, back = (_tree(y).query(x)[0] for x, y in ((a, b), (b, a)))
    if min(np.mean(there < ALIKE), np.mean(back < ALIKE)) < 0.7:
        return 0.0
    return float(max(there.max(), back.max()))


def _tree(points: Array) -> KDTree:
    return KDTree(points, balanced_tree=False, compact_nodes=False)


ALIKE = 3e-6
"""Distance in m below which two points count as equal, despite rounding to 0.001 mm and to single precision."""


@dataclass(frozen=True)
class Compared:
    """One compared quantity.

    Attributes:
        apart: function that returns the difference between two values.
        tolerance: maximum difference between equal values.
        unit: unit of the values, and of the difference if `relative` is False.
        relative: whether `apart` returns a relative difference; messages then show the ratio.
    """

    apart: Callable[[Any, Any], float]
    tolerance: float
    unit: str = ""
    relative: bool = False


QUANTITIES: Mapping[str, Compared] = {
    "weighed": Compared(_word, 0.0),
    "mass": Compared(_number, 1e-5, "kg", True),
    "mass centre": Compared(_distance, 2e-6, "m"),
    "inertia": Compared(_tensor, 1e-5, "", True),
    "existence": Compared(_word, 0.0),
    "name": Compared(_word, 0.0),
    "kind": Compared(_word, 0.0),
    "links": Compared(_word, 0.0),
    "place": Compared(_line, 2e-6, "m"),
    "axis": Compared(_sense, 1e-5),
    "pose": Compared(_place, 5e-6, "m"),
    "zero": Compared(_place, 5e-6, "m"),
    "limits": Compared(_ends, 1e-5, "m or rad"),
    "driven": Compared(_word, 0.0),
    "stiffness": Compared(_number, 1e-5, "N/m or N m/rad", True),
    "damping": Compared(_number, 1e-5, "N s/m or N m s/rad", True),
    "largest effort": Compared(_number, 1e-5, "N or N m", True),
    "largest speed": Compared(_number, 1e-5, "m/s or rad/s", True),
    "frame pose": Compared(_place, 2e-6, "m"),
    "point": Compared(_distance, 2e-6, "m"),
    "link": Compared(_word, 0.0),
    "shown": Compared(_word, 0.0),
    "surface": Compared(_surface, ALIKE, "m"),
    "closed": Compared(_word, 0.0),
    "colours": Compared(apart, 0.02),
    "gravity": Compared(_distance, 1e-3, "m/s2"),
    "held": Compared(_word, 0.0),
    "ratios": Compared(_distance, 1e-5),
    "sum": Compared(_distance, 1e-6, "m or rad"),
    "opening": Compared(_distance, 1e-7, "m or rad"),
    "passive": Compared(_passive, 1e-9),
    "law": Compared(_word, 0.0),
    "breaks": Compared(_number, 1e-5, "N", True),
    "weightless": Compared(_distance, 1e-9),
    "reduction": Compared(_number, 1e-6, "", True),
    "row": Compared(_row, 1e-6, "", True),
    "rotor inertia": Compared(_number, 1e-5, "kg m2 or kg", True),
}
"""Rule of comparison for each quantity of links, joints, frames, couplings, motors and the world."""


@dataclass
class View:
    """Data of one file, prepared for the comparison.

    Attributes:
        file: name of the file as reports show it.
        format: format of the file; "truth" for the given mechanism.
        ledger: receives the findings on the file; None for the given mechanism.
        physics: mechanism data of the file.
        shapes: {link: shape of its meshes}.
        colors: {link: {colour (linear rgba): fraction of the link's area}}.
        said: {(subject, quantity): value in the file}, with keys such as ("joint 'j1'", "limits").
    """

    file: str
    format: str
    ledger: Ledger | None
    physics: Physics
    shapes: Mapping[str, Shape] = field(default_factory=dict)
    colors: Mapping[str, Mapping[Rgba, float]] = field(default_factory=dict)
    said: dict[tuple[str, str], Any] = field(default_factory=dict)

    @property
    def family(self) -> str:
        """Name of the source; formats that are written from the same data have the same source."""
        return family(self.format)

    def say(self, subject: str, values: JsonMapping) -> None:
        """Store the values {quantity: value} of a subject; None means that the file does not state the value."""
        self.said |= {(subject, name): value for name, value in values.items() if value is not None}


def compare_physics(contents: Sequence[Content], truth: Physics | None = None) -> None:
    """Compare links, joints, frames and gravity of all files, and report differences in each file's ledger.

    `truth` contains the data of the expected mechanism. If it is None, the files are compared only with each other.
    """
    views = [
        View(c.file, c.format, c.ledger, c.physics or Physics(), c.shapes, c.colors)
        for c in contents
        if c.physics is not None or c.shapes
    ]
    if truth is not None:
        views.append(View(MECHANISM, "truth", None, truth))
    views.sort(key=_trust)
    if len(views) < 2:
        return
    for content, view in ((c, v) for v in views for c in contents if c.file == v.file):
        view.physics.links = tuple(dict.fromkeys((*(content.declared or ()), *view.physics.links)))
    known = _known_links(views)
    canonical = _canonical(views, known)
    movable = {n for v in views for n in v.physics.trocars}
    stems = {(v.format, v.file.rsplit(".", 1)[0]) for v in views}
    for view in views:
        _state(view, canonical, known, movable)
        if holding(view.format, Holds.JOINT_TREE) and any(
            f == view.format and view.file.startswith(f"{s}_") for f, s in stems
        ):
            # A file for a single motion has other trocar positions; its `play` checks whether the loops close.
            children = {j.child for j in view.physics.joints}
            still = view.physics.held or {n for n in view.physics.links if n not in children}
            held = tuple(f" on '{n}'" for n in still)
            view.said = {k: v for k, v in view.said.items() if k[1] != "place" or not k[0].endswith(held)}
    there = [s for s, name in dict.fromkeys(key for v in views for key in v.said) if name == "existence"]
    for view in views:
        stated = tuple(view.physics.marks)
        if view.physics.complete:
            stated += ("joint",)
            stated += ("motor",) * view.physics.all_motors
            stated += ("coupling",) * (view.physics.couplings is not None)
        for subject in there:
            if subject.startswith(stated):
                view.said.setdefault((subject, "existence"), False)
    _check_transmissions(views)
    subjects = dict.fromkeys(key for v in views for key in v.said)
    worst: dict[str, dict[str, tuple[float, str]]] = {}
    alone = truth is not None and len(views) == 2
    for subject, name in subjects:
        saying = [v for v in views if (subject, name) in v.said]
        if len(saying) > 1:
            _hold(subject, name, saying, worst)
    for view in views:
        if view.ledger is not None:
            for name, (off, where) in worst.get(view.file, {}).items():
                q = QUANTITIES[name]
                unit = "" if q.relative else q.unit
                others = MECHANISM if alone else "the other files"
                check = f"{_WORDS.get(name, name)} against {others}"
                view.ledger.row(check, min(off, 1e300), unit, q.tolerance, where=where, against=others)


def _check_transmissions(views: Sequence[View]) -> None:
    """Report a URDF without transmissions if other files state which joints are driven.

    A single file that is compared with the mechanism receives a warning, because URDFs of others often have none.
    """
    for view in views:
        if view.format != "urdf" or view.physics.reductions is not None or view.ledger is None:
            continue
        joints = {j.names[0] for j in view.physics.joints if len(j.names) == 1 and len(j.motions) == 1}
        stating = [v for v in views if v is not view]
        driven = {n for n in joints if any(v.said.get((f"joint '{n}'", "driven")) for v in stating)}
        if driven:
            text = (
                f"the file has no transmissions; in {_listed([v.file for v in stating])} the driven joints are "
                f"{', '.join(sorted(driven))}."
            )
            severity = "disagreement" if len(views) > 2 else "warning"
            advice = "write a transmission for each driven joint"
            view.ledger.add("urdf.transmission", severity, text, "transmissions", suggestion=advice)


# --------------------------------------------------------------------------------------------- values of each file


def _known_links(views: Sequence[View]) -> set[str]:
    """Return the links of the first source with links: the mechanism, or the file with the smallest rank.

    Files with auxiliary links, for example between the hinges of a ball joint, are used only if there are no others.
    """
    exact = [v for v in views if v.physics.links and (v.format == "truth" or holding(v.format, Holds.LINKS))]
    if exact:
        return set(min(exact, key=_order).physics.links)
    return {n for v in views for n in v.physics.links}


def _order(view: View) -> int:
    """Return the smallest rank of the files in the format of a source, 0 for the mechanism."""
    return 0 if view.format == "truth" else family_rank(view.format)


def _canonical(views: Sequence[View], known: set[str]) -> dict[str, Joint]:
    """Return {name: joint} for the joints between known links; each joint is from the first file that has it."""
    out: dict[str, Joint] = {}
    elsewhere = [(_stem(j), j.kind) for v in views if v.family != "tracks" for j in v.physics.reduced(known) if j.names]
    several = tuple(f"{name}_" for name, kind in elsewhere if kind not in ("", "fixed", "revolute", "prismatic"))
    # A GLB contains the names of joints, but not their kinds.
    turns = {f"{name}_{part}" for name, kind in elsewhere if not kind for part in ("x", "y", "z", "slide")}
    for view in sorted(views, key=lambda v: holding(v.format, Holds.JOINT_TREE)):  # these may divide joints
        for joint in view.physics.reduced(known):
            within = {joint.parent, joint.child} <= known | {""}
            if not within or not joint.names or _match(joint, out, view):
                continue
            if view.family == "tracks" and (joint.names[0].startswith(several) or joint.names[0] in turns):
                continue  # one coordinate of a ball or cylindrical joint
            if joint.kind == "fixed" and view.format == "mjcf":
                continue
            out[_stem(joint)] = joint
    return out


def _stem(joint: Joint) -> str:
    """Return the name <joint> of a joint from the names of its parts, such as <joint>_0 (a tie) or <joint>_x (a hinge).

    A tie is a pair of coinciding points. From a single name, a number at the end is removed only if the joint is a tie:
    `setup_1` can be the name of a joint.
    """
    names = joint.names
    if len(names) == 1:
        return re.sub(r"_\d+$", "", names[0]) if joint.tied else names[0]
    short = min(names, key=len)
    if all(n == short or n.startswith(f"{short}_") for n in names):
        return short
    common = names[0]
    for n in names[1:]:
        while not n.startswith(common):
            common = common[:-1]
    return common.rstrip("_") or short


def _match(joint: Joint, canonical: Mapping[str, Joint], view: View) -> str:
    """Return the name of the reference joint with the same name or the same links as a joint; "" if there is none."""
    for name in (*joint.names[:1], _stem(joint)) if joint.names else ():
        if name in canonical:
            return name
    if len(joint.names) > 1 or view.family == "tracks":  # tracks have the coordinates of a ball as separate joints
        begins = [
            n
            for n, j in canonical.items()
            if joint.names and _parts(joint, n) and (len(joint.names) > 1 or j.kind not in ("revolute", "prismatic"))
        ]
        if begins:
            return max(begins, key=len)
    if not joint.parent:
        return ""
    pair = {joint.parent, joint.child}
    taken = {p for j in view.physics.joints for p in (*j.names, _stem(j) if j.names else "")}
    fits = [n for n, j in canonical.items() if {j.parent, j.child} == pair and n not in taken]
    return fits[0] if len(fits) == 1 else ""


def _parts(joint: Joint, name: str) -> bool:
    return all(p == name or p.startswith(f"{name}_") for p in joint.names)


def _state(view: View, canonical: Mapping[str, Joint], known: set[str], movable: set[str]) -> None:
    p = view.physics
    still = p.still(known)
    _state_links(view, known, still)
    found = set()
    nameless = 0
    for joint in p.reduced(known):
        if not {joint.parent, joint.child} <= known | {""}:
            continue
        name = _match(joint, canonical, view)
        if not name:
            nameless += not joint.names
            if joint.names and (joint.kind != "fixed" or joint.tied):
                view.say(f"joint '{_stem(joint)}'", {"existence": True})
            continue
        found.add(name)
        _state_joint(view, name, joint, canonical[name], name in movable)
    lacking = [name for name, joint in canonical.items() if name not in found and not joint.kind and not joint.parent]
    if len(lacking) <= nameless:  # a GLB states only names of joints, an MJCF has no names for fixed joints
        found.update(lacking)
        for name in lacking:
            view.say(f"joint '{name}'", {"existence": True})
    for joint in p.added(known):
        view.say(f"joint '{_stem(joint)}'", {"existence": True})
    for name, joint in canonical.items():
        if name in found or (joint.kind == "fixed" and not joint.parent):
            continue
        if (
            p.complete
            or (view.format == "tracks" and joint.kind in ("revolute", "prismatic"))
            or (holding(view.format, Holds.ALL_MOTIONS) and p.joints)
        ):
            view.say(f"joint '{name}'", {"existence": False})
    frames = dict(p.frames)
    if p.tool in frames:
        frames.setdefault(TOOL, frames[p.tool])
    for name, frame in frames.items():
        subject = "the tool frame" if name == TOOL else f"frame '{name}'"
        view.say(subject, {"existence": None if name == TOOL else True, "link": frame.link, "frame pose": frame.T})
    for name, point in p.points.items():
        view.say(f"point '{name}'", {"existence": True, "link": point.link, "point": point.T[:3, 3]})
    held = None if still is None else tuple(sorted(still))
    view.say("the world", {"gravity": p.gravity, "held": held})
    view.say("the loops", {"opening": p.opening})
    for name, (ratios, total) in solved(p.couplings or {}).items():
        joints = tuple(sorted(ratios))
        numbers = np.array([ratios[n] for n in joints])
        view.say(f"coupling of '{name}'", {"existence": True, "links": joints, "ratios": numbers, "sum": total})
    for name, motor in (p.motors or {}).items():
        values = {
            "existence": True if p.all_motors else None,
            "row": motor.row,
            "kind": motor.kind,
            "limits": motor.limits,
            "largest effort": motor.effort,
            "largest speed": motor.speed,
            "rotor inertia": motor.inertia,
            "stiffness": motor.stiffness,
            "damping": motor.damping,
        }
        view.say(f"motor '{name}'", values)


def solved(couplings: Mapping[str, tuple[Mapping[str, float], float]]) -> dict[str, tuple[dict[str, float], float]]:
    """Return couplings in reduced row echelon form; the key of a row is its first joint in alphabetical order.

    A coupling is ({joint: ratio}, constant): the sum of ratio times joint coordinate equals the constant. The reduced
    form does not depend on whether a file couples each of several joints to the next, or all to the first. Couplings
    with numbers that are not finite are left out.
    """
    joints = sorted({n for ratios, _ in couplings.values() for n in ratios})
    rows = np.array([[*(ratios.get(n, 0.0) for n in joints), total] for ratios, total in couplings.values()], float)
    rows = rows[np.isfinite(rows).all(axis=1) & rows[:, :-1].any(axis=1)] if len(rows) else rows
    if not len(rows):
        return {}
    rows /= np.abs(rows[:, :-1]).max(axis=1, keepdims=True)
    out: dict[str, tuple[dict[str, float], float]] = {}
    done = 0
    for k in range(len(joints)):
        if done == len(rows):
            break
        at = done + int(np.argmax(np.abs(rows[done:, k])))
        if abs(rows[at, k]) <= _ZERO:
            continue
        rows[[done, at]] = rows[[at, done]]
        rows[done] /= rows[done, k]
        others = np.arange(len(rows)) != done
        rows[others] -= rows[others, k, None] * rows[done]
        done += 1
    for row in rows[:done]:
        ratios = {n: float(r) for n, r in zip(joints, row[:-1], strict=True) if abs(r) > _ZERO}
        out[next(iter(ratios))] = ratios, float(row[-1])
    return out


def _state_links(view: View, known: set[str], still: frozenset[str] | None) -> None:
    """State shapes, colours and masses of the links that are `known`; `still` are those that cannot move."""
    p = view.physics
    for link in dict.fromkeys((*p.shown, *view.shapes)):
        if link in known:
            view.say(f"link '{link}'", {"shown": p.shown.get(link, True)})
    for link, shape in view.shapes.items():
        if link in known:
            closed = shape.closed if shape.closed == shape.nearly_closed else None
            view.say(f"link '{link}'", {"surface": shape.points, "closed": closed})
    for link, shares in view.colors.items():
        if link in known:
            view.say(f"link '{link}'", {"colours": shares})
    for link, share in (p.floats or {}).items():
        if link in known:
            view.say(f"link '{link}'", {"weightless": share})
    for link, m in p.masses.items():
        if link in known:
            inertial = {"mass": m.mass, "mass centre": m.center, "inertia": m.inertia}
            view.say(f"link '{link}'", inertial if link in p.assumed else {"weighed": True} | inertial)
    if holding(view.format, Holds.MASSES) and p.masses:
        for link in known & set(p.links) - set(p.masses) - (still or frozenset()) - {WORLD}:
            view.say(f"link '{link}'", {"weighed": False})


def _state_joint(view: View, name: str, joint: Joint, canonical: Joint, movable: bool) -> None:
    subject = f"joint '{name}'"
    part = joint.kind_said and joint.names != canonical.names  # one coordinate of a ball joint, in a track
    stated = None
    if joint.names and not part:
        own = name in (*joint.names, _stem(joint)) or (len(joint.names) > 1 and _parts(joint, name))
        stated = name if own else _stem(joint)
    identity = {
        "existence": True,
        "name": stated,
        "kind": joint.kind if joint.kind and not part else None,
        "links": tuple(sorted((joint.parent, joint.child))) if joint.parent else None,
    }
    view.say(subject, identity)
    for link in (joint.parent, joint.child) if joint.parent else ():
        if (end := joint.end(link)) is None or joint.kind.startswith(("chain", "free")):
            continue
        point, direction = end
        place = (point, direction) if joint.kind != "prismatic" and not movable else None
        axis = None if direction is None else (direction, not joint.tied)
        view.say(f"{subject} on '{link}'", {"place": place, "axis": axis})
    placed = joint.kind in ("fixed", "revolute", "prismatic") and not joint.tied
    if placed and joint.T is not None and joint.parent and not movable:
        first = joint if joint.parent < joint.child else joint.turned()
        view.say(subject, {"pose" if joint.kind == "fixed" else "zero": first.T})
    d = joint.drive
    if joint.kind in ("revolute", "prismatic"):
        drive = {
            "limits": None if joint.tied else d.limits,
            "driven": d.driven,
            "reduction": _reduction(view.physics, joint),
            "passive": None if joint.tied else d.passive,
            "law": d.law,
            "breaks": d.breaks,
            "stiffness": d.stiffness,
            "damping": d.damping,
            "largest effort": d.effort,
            "largest speed": d.speed,
        }
        view.say(subject, drive)


def _reduction(p: Physics, joint: Joint) -> float | None:
    """Return motor coordinate / joint coordinate of a joint with a motor of its own; None if it is not stated.

    In files with all motors, driven joints without one have the drive at the joint, which is a reduction of 1.
    """
    name = joint.names[0] if len(joint.names) == 1 else ""
    if p.reductions is not None:
        return p.reductions.get(name)
    if not p.all_motors or p.motors is None or not joint.drive.driven:
        return None
    rows = [m.row for m in p.motors.values() if m.row and name in m.row]
    if not rows:
        return 1.0
    return rows[0][name] if len(rows) == 1 and len(rows[0]) == 1 else None


# --------------------------------------------------------------------------------------------- the comparison


def _hold(subject: str, name: str, views: Sequence[View], worst: dict) -> None:
    q = QUANTITIES[name]
    key = (subject, name)
    groups: list[list[View]] = []
    for view in views:
        for group in groups:
            if q.apart(group[0].said[key], view.said[key]) <= q.tolerance:
                group.append(view)
                break
        else:
            groups.append([view])
    right = max(groups, key=_weight)
    expected = any(v.format == "truth" for v in views)
    for view in views:
        if view.ledger is not None and expected:
            view.ledger.placed |= name in _GEOMETRY
        off = q.apart(right[0].said[key], view.said[key])
        row = worst.setdefault(view.file, {})
        if name not in row or off > row[name][0]:
            row[name] = (off, subject)
        if view in right or view.ledger is None:
            continue
        others = [v.file for v in right]
        tie = len({v.family for v in right}) == 1 and right[0].format != "truth"
        text = _text(subject, name, q, view.said[key], right[0].said[key], _listed(others))
        message = text + (" One of the two statements is wrong." if tie else "")
        view.ledger.wrong(
            f"physics.{name.replace(' ', '_')}",
            message,
            subject,
            suggestion="export the file again; if its value is the right one, correct the robot"
            if right[0].format == "truth"
            else "find out which file is wrong: `twin audit --robot NAME` compares every file with the mechanism",
            size=Measured(off if np.isfinite(off) else None, q.tolerance, "" if q.relative else q.unit),
        )


def _trust(view: View) -> int:
    return 0 if view.format == "truth" else trust(view.format)


def _weight(group: Sequence[View]) -> tuple[bool, int, int]:
    families = {v.family for v in group}
    return "truth" in families, len(families), -min(map(_trust, group))


def _listed(files: Sequence[str]) -> str:
    shown = list(files) if len(files) <= 3 else [*files[:2], f"{len(files) - 2} more"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def _text(subject: str, name: str, q: Compared, mine: Any, right: Any, others: str) -> str:
    if name == "existence":
        return (
            f"{subject} is in this file, but not in {others}." if mine else f"{subject} is missing; it is in {others}."
        )
    if name in _SAID:
        said = _SAID[name]
        return f"{subject} {said[bool(mine)]}; in {others} it {said[bool(right)]}."
    if q.relative and isinstance(mine, int | float):
        ratio = f" (x {mine / right:.4g})" if right else ""
        word = _WORDS.get(name, name)
        here, there = (f"{value:.6g} {q.unit}".rstrip() for value in (mine, right))
        return f"{subject}: {word} is {here}; in {others} it is {there}{ratio}."
    off = q.apart(mine, right)
    if name == "opening":
        return (
            f"{subject} open by {quantity(mine, 'm')} if 1 g pulls at them, by the parameters of the solver; in "
            f"{others} by {quantity(right, 'm')}."
        )
    if name in ("mass centre", "place", "frame pose", "point", "pose", "zero"):
        return f"{subject}: {_WORDS.get(name, name)} differs by {quantity(off, 'm')} from {others}."
    if name == "surface":
        return f"{subject}: a point of its mesh is {quantity(off, 'm')} from the mesh of {others}."
    if name == "colours":
        return f"{subject}: {100 * off:.3g} % of its surface has a different colour in {others}."
    if name == "inertia":
        return f"{subject}: inertia differs from {others} by {100 * off:.3g} %."
    if name == "axis":
        return f"{subject}: axis is {_vector(mine[0])}; in {others} it is {_vector(right[0])}."
    told = f"{_plain(right)} {q.unit}".rstrip()
    return f"{subject}: {_WORDS.get(name, name)} is {_plain(mine)}; in {others} it is {told}."


_SAID = {
    "closed": ("has an open mesh", "has closed meshes"),
    "driven": ("is passive", "is driven"),
    "shown": ("has no mesh", "has a mesh"),
    "weighed": ("has no mass", "has a mass"),
}

_WORDS = {
    "frame pose": "pose of the frame on its link",
    "pose": "relative pose of the two links",
    "zero": "relative pose of the two links at zero",
    "place": "axis or centre of the joint",
    "link": "link of the frame",
    "largest effort": "maximum effort",
    "largest speed": "maximum speed",
    "held": "bodies fixed to the world",
    "shown": "presence of a mesh",
    "weighed": "presence of a mass",
    "closed": "closed or open meshes",
    "driven": "driven or passive",
    "existence": "presence in the file",
    "row": "joint factors of the transmission",
    "opening": "opening of the loops if 1 g pulls at them",
    "point": "position of the point on its link",
    "reduction": "reduction of its transmission",
    "passive": "stiffness, damping, friction and inertia of the joint itself",
    "law": "quantity that the gains of the drive give",
    "breaks": "force at which the joint breaks",
    "weightless": "share of its weight that is compensated",
}


def _vector(v: Iterable[float]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in v) + ")"


def _plain(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _vector(value)
    if isinstance(value, Mapping):
        return " + ".join(f"{c:.9g} {n}" for n, c in value.items()) or "nothing"
    if isinstance(value, tuple):
        numbers = value and all(isinstance(v, int | float) for v in value)
        return " .. ".join(f"{v:g}" for v in value) if numbers else ", ".join(map(str, value)) or "nothing"
    return str(value)
