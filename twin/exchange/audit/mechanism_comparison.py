"""Compare the mechanism data of files, with one table of quantities and their tolerances.

Each format counts as one independent source, because several files of a format may share data (five stages may share
one layer). If a mechanism is given, the value in the mechanism counts as correct; otherwise, the value that most
sources state.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twin.core.json_types import JsonMapping
from twin.exchange.audit.colors import Rgba
from twin.exchange.audit.compared_quantities import NOTHING, QUANTITIES, ComparisonRule, difference_text, words_of
from twin.exchange.audit.file_content import Content, LinkShape
from twin.exchange.audit.file_joints import WORLD, FileJoint
from twin.exchange.audit.mechanism_data import TOOL, FileMechanism
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import MECHANISM, Ledger, Measured
from twin.exchange.format import Holds
from twin.exchange.formats import family, family_rank, is_leading_kind, kind_holds, trust

_MECHANISM_FORMAT = "truth"
"""`View.format` of the given mechanism, which is no file."""

_GEOMETRY = ("place", "axis", "pose", "zero")
"""Quantities that show where the joints of a robot are."""

_SINGLE = ("revolute", "prismatic")
"""Kinds of joints with one coordinate."""

_LIGHT = 1e-5
"""Maximum mass in kg of a link that is only between two hinges; simulators reject such links without any mass."""

_ZERO = 1e-6
"""Maximum absolute value of a coupling's ratio that counts as zero (rounding of single precision).

Before the comparison, the ratios are divided by the largest absolute ratio of the coupling."""


@dataclass
class View:
    """Data of one file, prepared for the comparison.

    Attributes:
        file: name of the file as reports show it.
        format: format of the file; "truth" for the given mechanism.
        ledger: receives the findings on the file; None for the given mechanism.
        mechanism: mechanism data of the file.
        shapes: {link: shape of its meshes}.
        colors: {link: {colour (linear rgba): fraction of the link's area}}.
        finishes: the same for metallic and roughness, see `Content`.
        values: {(subject, quantity): value in the file}, with keys such as ("joint 'j1'", "limits").
    """

    file: str
    format: str
    ledger: Ledger | None
    mechanism: FileMechanism
    shapes: Mapping[str, LinkShape] = field(default_factory=dict)
    colors: Mapping[str, Mapping[Rgba, float]] = field(default_factory=dict)
    finishes: Mapping[str, Mapping[Rgba, float]] = field(default_factory=dict)
    values: dict[tuple[str, str], Any] = field(default_factory=dict)

    @property
    def family(self) -> str:
        """Name of the source; formats that are written from the same data have the same source."""
        return family(self.format)

    @property
    def is_mechanism(self) -> bool:
        """Whether these are the data of the given mechanism."""
        return self.format == _MECHANISM_FORMAT

    def holds(self, what: Holds) -> bool:
        """Return whether files of this format contain something."""
        return kind_holds(self.format, what)

    def state(self, subject: str, values: JsonMapping) -> None:
        """Store the values {quantity: value} of a subject; None means that the file does not state the value."""
        for name, value in values.items():
            if value is not None:
                self.values[subject, name] = value


def compare_mechanisms(contents: Sequence[Content], truth: FileMechanism | None = None) -> None:
    """Compare links, joints, frames and gravity of all files, and report differences in each file's ledger.

    `truth` contains the data of the expected mechanism. If it is None, the files are compared only with each other.
    """
    views = []
    for content in contents:
        if content.mechanism is not None or content.shapes:
            mechanism = content.mechanism or FileMechanism()
            view = View(
                content.file,
                content.format,
                content.ledger,
                mechanism,
                content.shapes,
                content.colors,
                content.finishes,
            )
            views.append(view)
    if truth is not None:
        views.append(View(MECHANISM, _MECHANISM_FORMAT, None, truth))
    # By trust, because the first file of a group of equal ones is its reference.
    views.sort(key=_trust)
    if len(views) < 2:
        return
    _state_all(views, contents)
    _check_transmissions(views)
    worst: dict[str, dict[str, tuple[float, str]]] = {}
    for subject, name in _keys(views):
        stating = []
        for view in views:
            if (subject, name) in view.values:
                stating.append(view)
        if len(stating) > 1:
            _compare_values(subject, name, stating, worst)
    others = "the other files"
    if truth is not None and len(views) == 2:
        # With one file and the mechanism, the row states the mechanism as the source of the values.
        others = MECHANISM
    for view in views:
        if view.ledger is None:
            continue
        for name, (difference, subject) in worst.get(view.file, {}).items():
            rule = QUANTITIES[name]
            check = f"{words_of(name)} against {others}"
            finite = min(difference, 1e300)  # JSON has no infinity
            fits = True if rule.severity == "warning" else None  # a warning is no disagreement
            unit = rule.unit_of_difference
            view.ledger.row(check, finite, unit, rule.tolerance, where=subject, fits=fits, against=others)


def _state_all(views: Sequence[View], contents: Sequence[Content]) -> None:
    """Store the values of all quantities that the files state, and which subjects they lack."""
    for view in views:
        for content in contents:
            if content.file == view.file:
                declared = content.declared or ()
                view.mechanism.links = tuple(dict.fromkeys((*declared, *view.mechanism.links)))
    known_links = _known_links(views)
    canonical = _canonical(views, known_links)
    trocars = set()
    for view in views:
        trocars |= view.mechanism.trocars
    for view in views:
        _state(view, canonical, known_links, trocars, views)
        if view.holds(Holds.JOINT_TREE) and _is_for_one_motion(view, views):
            _forget_held_places(view)
    _state_absent_declarations(views)
    keys = _keys(views)
    for view in views:
        listed = _listed_kinds(view.mechanism)
        for subject, name in keys:
            if name != "existence" or not subject.startswith(listed):
                continue
            if view.mechanism.couples_pairs and _couples_more_than_two(subject, views):
                continue
            view.values.setdefault((subject, name), False)


_DECLARATIONS = {
    "further declarations": "motion_declarations",
    "declarations of contact or look": "contact_declarations",
    "settings of single programs": "program_settings",
}
"""Quantities of what formats declare beside all others, with the attributes of `FileMechanism`."""


def _state_absent_declarations(views: Sequence[View]) -> None:
    """State further declarations as text; files that could hold some and do not state "nothing"."""
    for quantity, attribute in _DECLARATIONS.items():
        subjects: set[str] = set()
        for view in views:
            subjects |= set(getattr(view.mechanism, attribute) or ())
        for view in views:
            declared = getattr(view.mechanism, attribute)
            if declared is None:
                continue
            for subject in sorted(subjects):
                fields = []
                for name, value in declared.get(subject, {}).items():
                    fields.append(f"{name} {value}")
                view.state(subject, {quantity: ", ".join(fields) or NOTHING})


def _keys(views: Sequence[View]) -> list[tuple[str, str]]:
    """Return (subject, quantity) of all values that files state, in the order of the files."""
    keys: dict[tuple[str, str], None] = {}
    for view in views:
        keys |= dict.fromkeys(view.values)
    return list(keys)


def _is_for_one_motion(view: View, views: Sequence[View]) -> bool:
    """Return whether a file <robot>_<protocol> stands beside a file <robot> of the same format."""
    for other in views:
        stem = other.file.rsplit(".", 1)[0]
        if other.format == view.format and view.file.startswith(f"{stem}_"):
            return True
    return False


def _forget_held_places(view: View) -> None:
    """Remove the places of joints on links that are fixed to the world.

    A file for a single motion has other trocar positions; its `play` checks whether the loops close.
    """
    mechanism = view.mechanism
    fixed_links = mechanism.fixed_to_world
    if not fixed_links:  # links that no joint moves
        children = {joint.child for joint in mechanism.joints}
        fixed_links = set(mechanism.links) - children
    endings = tuple(f" on '{link}'" for link in fixed_links)
    for subject, name in list(view.values):
        if name == "place" and subject.endswith(endings):
            del view.values[subject, name]


def _listed_kinds(mechanism: FileMechanism) -> tuple[str, ...]:
    """Return the first words of the subjects of which a file states all that the robot has."""
    kinds = list(mechanism.fully_listed)
    if mechanism.complete:
        kinds += ["joint", "body"]
        if mechanism.all_motors:
            kinds.append("motor")
    if mechanism.couplings is not None:
        kinds.append("coupling")
    return tuple(kinds)


def _couples_more_than_two(subject: str, views: Sequence[View]) -> bool:
    """Return whether a subject is, in one of the files, a coupling of more than two joints."""
    if not subject.startswith("coupling"):
        return False
    return any(len(view.values.get((subject, "links"), ())) > 2 for view in views)


def _check_transmissions(views: Sequence[View]) -> None:
    """Report a URDF without transmissions if other files state which joints are driven.

    A single file that is compared with the mechanism receives a warning, because URDFs of others often have none.
    """
    for view in views:
        if not view.holds(Holds.TRANSMISSIONS) or view.mechanism.reductions is not None or view.ledger is None:
            continue
        others = []
        for other in views:
            if other is not view:
                others.append(other)
        driven = _driven(view.mechanism.joints, others)
        if driven:
            sources = _file_names(others)
            names = ", ".join(sorted(driven))
            text = f"the file has no transmissions; in {sources} the driven joints are {names}."
            severity = "disagreement" if len(views) > 2 else "warning"
            advice = "write a transmission for each driven joint"
            code = f"{view.format}.transmission"
            view.ledger.add(code, severity, text, "transmissions", suggestion=advice)


def _driven(joints: Sequence[FileJoint], views: Sequence[View]) -> set[str]:
    """Return the names of the joints with one coordinate that one of the files states as driven."""
    driven = set()
    for joint in joints:
        # A transmission acts on one coordinate: joints in parts, such as balls, have none.
        if len(joint.names) != 1 or len(joint.motions) != 1:
            continue
        name = joint.names[0]
        for view in views:
            if view.values.get((f"joint '{name}'", "driven")):
                driven.add(name)
    return driven


# --------------------------------------------------------------------------------------------- values of each file


def _known_links(views: Sequence[View]) -> set[str]:
    """Return the links of the first source with links: the mechanism, or the file with the smallest rank.

    Files with auxiliary links, for example between the hinges of a ball joint, are used only if there are no others;
    then their links count, without those that are auxiliary.
    """
    links: set[str] = set()
    exact_views: list[View] = []
    for view in views:
        links.update(view.mechanism.links)
        if view.mechanism.links and (view.is_mechanism or view.holds(Holds.LINKS)):
            exact_views.append(view)
    if exact_views:
        return set(min(exact_views, key=_source_rank).mechanism.links)
    stating = []
    for view in views:
        if view.mechanism.links:
            stating.append(view)
    proper_links = set()
    for link in links:
        if not _is_auxiliary(link, stating):
            proper_links.add(link)
    return proper_links


def _is_auxiliary(link: str, views: Sequence[View]) -> bool:
    """Return whether a link is not in all files, and is only between joints where it is: no shape, no mass that counts.

    A link at the end of a chain is none: with it, its joint would be left out.
    """
    if all(link in view.mechanism.links for view in views):
        return False
    for view in views:
        joint_count = 0
        for joint in view.mechanism.joints:
            joint_count += link in (joint.parent, joint.child)
        if link in view.mechanism.links and joint_count < 2:
            return False
        mass = view.mechanism.masses.get(link)
        has_weight = mass is not None and mass.mass > _LIGHT
        if link in view.shapes or view.mechanism.shown.get(link) or has_weight:
            return False
    return True


def _source_rank(view: View) -> int:
    """Return the smallest rank of the files in the format of a source, 0 for the mechanism."""
    if view.is_mechanism:
        return 0
    return family_rank(view.format)


def _canonical(views: Sequence[View], known_links: set[str]) -> dict[str, FileJoint]:
    """Return {name: joint} for the joints between known links; each joint is from the first file that has it."""
    canonical: dict[str, FileJoint] = {}
    prefixes, coordinates = _names_of_coordinates(views, known_links)
    # Files with a tree of joints come last, because they may divide joints.
    for view in sorted(views, key=lambda v: v.holds(Holds.JOINT_TREE)):
        for joint in view.mechanism.joints_between(known_links):
            ends = {joint.parent, joint.child}
            if not ends <= known_links | {""} or not joint.names or _matching_name(joint, canonical, view):
                continue
            first = joint.names[0]
            if view.holds(Holds.COORDINATES) and (first.startswith(prefixes) or first in coordinates):
                continue  # one coordinate of a ball or cylindrical joint
            if joint.kind == "fixed" and view.holds(Holds.UNNAMED_FIXED_JOINTS):
                continue
            canonical[_stem(joint)] = joint
    return canonical


def _names_of_coordinates(views: Sequence[View], known_links: set[str]) -> tuple[tuple[str, ...], set[str]]:
    """Return (prefixes, names) by which a track may name the single coordinates of joints in other files."""
    prefixes = []
    names = set()
    for view in views:
        if view.holds(Holds.COORDINATES):
            continue
        for joint in view.mechanism.joints_between(known_links):
            if not joint.names:
                continue
            stem = _stem(joint)
            if joint.kind == "":  # a GLB contains the names of joints, but not their kinds
                names |= {f"{stem}_x", f"{stem}_y", f"{stem}_z", f"{stem}_slide"}
            elif joint.kind not in ("fixed", *_SINGLE):
                prefixes.append(f"{stem}_")
    return tuple(prefixes), names


def _stem(joint: FileJoint) -> str:
    """Return the name <joint> of a joint from the names of its parts, such as <joint>_0 (a tie) or <joint>_x (a hinge).

    A tie is a pair of coinciding points. From a single name, a number at the end is removed only if the joint is a tie:
    `setup_1` can be the name of a joint.
    """
    first, *others = joint.names
    if not others and not joint.tied:
        return first
    if not others:
        return re.sub(r"_\d+$", "", first)
    short = min(joint.names, key=len)
    if _are_parts(joint, short):
        return short
    common = first
    for name in others:
        while not name.startswith(common):
            common = common[:-1]
    return common.rstrip("_") or short


def _matching_name(joint: FileJoint, canonical: Mapping[str, FileJoint], view: View) -> str:
    """Return the name of the reference joint with the same name or the same links as a joint; "" if there is none."""
    if joint.names:
        for name in (joint.names[0], _stem(joint)):
            if name in canonical:
                return name
        if len(joint.names) > 1 or view.holds(Holds.COORDINATES):
            divided_name = _divided_name(joint, canonical)
            if divided_name:
                return divided_name
    if not joint.parent:
        return ""
    ends = {joint.parent, joint.child}
    names_in_file = _joint_and_part_names(view.mechanism.joints)
    candidates = []
    for name, candidate in canonical.items():
        if {candidate.parent, candidate.child} == ends and name not in names_in_file:
            candidates.append(name)
    if len(candidates) != 1:  # none, or several between the same two links
        return ""
    return candidates[0]


def _divided_name(joint: FileJoint, canonical: Mapping[str, FileJoint]) -> str:
    """Return the longest name of a reference joint whose parts are all parts of a joint; "" if there is none.

    Tracks have the coordinates of a ball as separate joints, each with one name.
    """
    longest = ""
    for name, candidate in canonical.items():
        divisible = len(joint.names) > 1 or candidate.kind not in _SINGLE
        if divisible and _are_parts(joint, name) and len(name) > len(longest):
            longest = name
    return longest


def _joint_and_part_names(joints: Sequence[FileJoint]) -> set[str]:
    """Return the names of the parts of joints, and of the joints without their parts."""
    names = set()
    for joint in joints:
        if joint.names:
            names |= {*joint.names, _stem(joint)}
    return names


def _are_parts(joint: FileJoint, name: str) -> bool:
    """Return whether all names of a joint are those of parts of the joint `name`, such as <name>_x."""
    return all(part == name or part.startswith(f"{name}_") for part in joint.names)


def _state(
    view: View, canonical: Mapping[str, FileJoint], known_links: set[str], trocars: set[str], views: Sequence[View]
) -> None:
    mechanism = view.mechanism
    immobile_links = mechanism.immobile_links(known_links)
    _state_links(view, known_links, immobile_links)
    _state_joints(view, canonical, known_links, trocars)
    frames = dict(mechanism.frames)
    if mechanism.tool in frames:
        frames.setdefault(TOOL, frames[mechanism.tool])
    for name, frame in frames.items():
        if name == TOOL:
            view.state("the tool frame", {"link": frame.link, "frame pose": frame.T})
        else:
            view.state(f"frame '{name}'", {"existence": True, "link": frame.link, "frame pose": frame.T})
    for name, point in mechanism.points.items():
        view.state(f"point '{name}'", {"existence": True, "link": point.link, "point": point.T[:3, 3]})
    if mechanism.robot and not _is_for_one_motion(view, views):
        view.state("the robot", {"robot": mechanism.robot})
    for name, coordinates in (mechanism.postures or {}).items():
        view.state(f"posture '{name}'", {"coordinates": coordinates})
    home_posture = mechanism.home_posture or (mechanism.postures or {}).get("home")
    if home_posture and not view.is_mechanism:
        view.state("posture 'home'", {"home coordinates": home_posture})
    if not _is_for_one_motion(view, views):  # with other trocars, home is another pose
        for name, coordinate in (mechanism.home or {}).items():
            view.state(f"joint '{name}'", {"home": coordinate})
    if mechanism.postures is not None and mechanism.tool:
        view.state("the robot", {"name of the tool": mechanism.tool})
    world = {
        "gravity": mechanism.gravity,
        "medium": mechanism.medium,
        "collisions of its own links": mechanism.self_collision,
    }
    view.state("the world", world)
    if immobile_links is not None:
        view.state("the world", {"held": tuple(sorted(immobile_links))})
    view.state("the loops", {"opening": mechanism.opening})
    for name, (ratios, total) in solved(mechanism.couplings or {}).items():
        joints = tuple(sorted(ratios))
        numbers = np.array([ratios[joint] for joint in joints])
        view.state(f"coupling of '{name}'", {"existence": True, "links": joints, "ratios": numbers, "sum": total})
    for name, motor in (mechanism.motors or {}).items():
        subject = f"motor '{name}'"
        if mechanism.all_motors:
            view.state(subject, {"existence": True})
        values = {
            "row": motor.row,
            "kind": motor.kind,
            "limits": motor.limits,
            "largest effort": motor.effort,
            "largest speed": motor.speed,
            "rotor inertia": motor.inertia,
            "stiffness": motor.stiffness,
            "damping": motor.damping,
            "law": motor.law,
        }
        view.state(subject, values)


def _state_joints(view: View, canonical: Mapping[str, FileJoint], known_links: set[str], trocars: set[str]) -> None:
    """State the joints between known links, and which of the reference joints a file lacks."""
    mechanism = view.mechanism
    matched_names = set()
    nameless = 0
    for joint in mechanism.joints_between(known_links):
        ends = {joint.parent, joint.child}
        if not ends <= known_links | {""}:
            continue
        name = _matching_name(joint, canonical, view)
        if name:
            matched_names.add(name)
            _state_joint(view, name, joint, canonical[name], name in trocars)
        elif not joint.names:
            nameless += 1
        elif joint.kind != "fixed" or joint.tied:
            view.state(f"joint '{_stem(joint)}'", {"existence": True})
    # A GLB states only names of joints, an MJCF has no names for fixed joints.
    names_only = []
    for name, joint in canonical.items():
        if name not in matched_names and not joint.kind and not joint.parent:
            names_only.append(name)
    if len(names_only) <= nameless:
        matched_names.update(names_only)
        for name in names_only:
            view.state(f"joint '{name}'", {"existence": True})
    for link in mechanism.load_links(known_links):
        view.state(f"body '{link}'", {"existence": True})
    for joint in mechanism.added_joints(known_links):
        view.state(f"joint '{_stem(joint)}'", {"existence": True})
    for name, joint in canonical.items():
        bare = joint.kind == "fixed" and not joint.parent
        if name not in matched_names and not bare and _would_list(view, joint):
            view.state(f"joint '{name}'", {"existence": False})


def _would_list(view: View, joint: FileJoint) -> bool:
    """Return whether a file would contain a joint if it belonged to the robot."""
    if view.mechanism.complete:
        return True
    if view.holds(Holds.COORDINATES) and is_leading_kind(view.format) and joint.kind in _SINGLE:
        return True
    return view.holds(Holds.ALL_MOTIONS) and bool(view.mechanism.joints)


def solved(couplings: Mapping[str, tuple[Mapping[str, float], float]]) -> dict[str, tuple[dict[str, float], float]]:
    """Return couplings in reduced row echelon form; the key of a row is its first joint in alphabetical order.

    A coupling is ({joint: ratio}, constant): the sum of ratio times joint coordinate equals the constant. The reduced
    form does not depend on whether a file couples each of several joints to the next, or all to the first. Couplings
    with numbers that are not finite are left out.
    """
    coupled: set[str] = set()
    for ratios, _ in couplings.values():
        coupled |= ratios.keys()
    joints = sorted(coupled)
    rows = np.zeros((len(couplings), len(joints) + 1))
    for row, (ratios, total) in zip(rows, couplings.values(), strict=True):
        for joint, ratio in ratios.items():
            row[joints.index(joint)] = ratio
        row[-1] = total
    usable = np.isfinite(rows).all(axis=1) & rows[:, :-1].any(axis=1)
    rows = rows[usable]
    if not len(rows):
        return {}
    # Gauss-Jordan elimination with partial pivoting; rows that depend on others are zero and stay below the pivots.
    rows /= np.abs(rows[:, :-1]).max(axis=1, keepdims=True)
    couplings_by_first_joint: dict[str, tuple[dict[str, float], float]] = {}
    pivot_count = 0
    for column in range(len(joints)):
        if pivot_count == len(rows):
            break
        pivot = pivot_count + int(np.argmax(np.abs(rows[pivot_count:, column])))
        if abs(rows[pivot, column]) <= _ZERO:
            continue
        rows[[pivot_count, pivot]] = rows[[pivot, pivot_count]]
        rows[pivot_count] /= rows[pivot_count, column]
        others = np.arange(len(rows)) != pivot_count
        rows[others] -= rows[others, column, None] * rows[pivot_count]
        pivot_count += 1
    for row in rows[:pivot_count]:
        ratios = {}
        for joint, ratio in zip(joints, row[:-1], strict=True):
            if abs(ratio) > _ZERO:
                ratios[joint] = float(ratio)
        first = next(iter(ratios))
        couplings_by_first_joint[first] = (ratios, float(row[-1]))
    return couplings_by_first_joint


def _state_links(view: View, known_links: set[str], immobile_links: frozenset[str] | None) -> None:
    """State shapes, colours and masses of the known links; `immobile_links` are those that cannot move."""
    mechanism = view.mechanism
    for link in dict.fromkeys((*mechanism.shown, *view.shapes)):
        if link in known_links:
            view.state(f"link '{link}'", {"shown": mechanism.shown.get(link, True)})
    for link, collides in mechanism.collides.items():
        if link in known_links:
            view.state(f"link '{link}'", {"collides": collides})
    for link, shape in view.shapes.items():
        if link in known_links:
            view.state(f"link '{link}'", {"surface": shape.points})
            # Whether a mesh is closed counts only if the rounding of its points has no influence on it.
            if shape.closed == shape.nearly_closed:
                view.state(f"link '{link}'", {"closed": shape.closed})
    for link, shares in view.colors.items():
        if link in known_links:
            view.state(f"link '{link}'", {"colours": shares})
    for link, shares in view.finishes.items():
        if link in known_links:
            view.state(f"link '{link}'", {"finish": shares})
    for link, share in (mechanism.weight_shares or {}).items():
        if link in known_links:
            view.state(f"link '{link}'", {"weightless": share})
    for link, mass in mechanism.masses.items():
        if link in known_links:
            if link not in mechanism.assumed:
                view.state(f"link '{link}'", {"weighed": True})
            view.state(f"link '{link}'", {"mass": mass.mass, "mass centre": mass.center, "inertia": mass.inertia})
    if view.holds(Holds.MASSES) and mechanism.masses:
        weightless = (known_links & set(mechanism.links)) - set(mechanism.masses) - {WORLD}
        if immobile_links is not None:  # the mass of a link that cannot move has no influence
            weightless -= immobile_links
        for link in sorted(weightless):
            view.state(f"link '{link}'", {"weighed": False})


def _state_joint(view: View, name: str, joint: FileJoint, canonical: FileJoint, is_trocar: bool) -> None:
    subject = f"joint '{name}'"
    identity: dict[str, Any] = {"existence": True}
    if not joint.stated_kind or joint.names == canonical.names:  # else one coordinate of a ball joint, in a track
        if joint.names:
            identity["name"] = _stated_name(name, joint)
        if joint.kind:
            identity["kind"] = joint.kind
    if joint.parent:
        identity["links"] = tuple(sorted((joint.parent, joint.child)))
    elif joint.child and canonical.parent and joint.child not in (canonical.parent, canonical.child):
        identity["links"] = (joint.child,)  # the file states one of the two links, and it is neither
    view.state(subject, identity)
    if joint.parent and not joint.kind.startswith(("chain", "free")):
        for link in (joint.parent, joint.child):
            end = joint.end(link)
            if end is not None:
                _state_line(view, f"{subject} on '{link}'", joint, end, is_trocar)
    posed = joint.kind in ("fixed", *_SINGLE) and not joint.tied
    if posed and joint.T is not None and joint.parent and not is_trocar:
        # Files may exchange parent and child: the pose is that from the first link in alphabetical order.
        ordered = joint
        if joint.parent >= joint.child:
            ordered = joint.reversed()
        quantity = "pose" if joint.kind == "fixed" else "zero"
        view.state(subject, {quantity: ordered.T})
    if joint.kind == "spherical":
        view.state(subject, {"cone": joint.drive.cone})
        view.state(f"{subject} on '{joint.parent}'", {"axis of its cone": joint.drive.cone_axis})
    if joint.kind in _SINGLE:
        drive = joint.drive
        if joint.tied:  # a tie is between points, and has no coordinate of its own
            drive = replace(drive, limits=None, soft=None, joint_dynamics=None, control=None)
        values = {
            "limits": drive.limits,
            "soft limits": drive.soft,
            "range of control": drive.control,
            "driven": drive.driven,
            "reduction": _reduction(view.mechanism, joint),
            "passive": drive.joint_dynamics,
            "law": drive.law,
            "breaks": drive.breaks,
            "stiffness": drive.stiffness,
            "damping": drive.damping,
            "largest effort": drive.effort,
            "largest speed": drive.speed,
            "largest acceleration": drive.acceleration,
            "largest jerk": drive.jerk,
        }
        view.state(subject, values)


def _stated_name(name: str, joint: FileJoint) -> str:
    """Return the reference's name of a joint if the joint has it too, also in the names of its parts; else its own."""
    odd_name = _odd_tie(name, joint)
    if odd_name:
        return odd_name
    stem = _stem(joint)
    divided = len(joint.names) > 1 and _are_parts(joint, name)
    if name in joint.names or name == stem or divided:
        return name
    return stem


def _odd_tie(name: str, joint: FileJoint) -> str:
    """Return the name of a tie that is none of the parts <name>_0, <name>_1, … of a joint; "" without one.

    If no tie is numbered, the file names its ties in another way, which says nothing.
    """
    if not joint.tied:
        return ""
    part_name = re.compile(rf"{re.escape(name)}_\d+")
    other_names = []
    for part in joint.names:
        if part_name.fullmatch(part) is None:
            other_names.append(part)
    if len(other_names) == len(joint.names):
        return ""
    if other_names:
        return other_names[0]
    if len(joint.names) < len(joint.tied):
        return f"{', '.join(joint.names)} and a tie without a name"
    return ""


def _state_line(view: View, subject: str, joint: FileJoint, end: tuple[Array, Array | None], is_trocar: bool) -> None:
    """State the place and the direction of a joint's axis on one of its links."""
    _, direction = end
    if joint.kind != "prismatic" and not is_trocar:  # a slide has a direction, but no place
        view.state(subject, {"place": end})
    if direction is not None:
        view.state(subject, {"axis": (direction, not joint.tied)})


def _reduction(mechanism: FileMechanism, joint: FileJoint) -> float | None:
    """Return motor coordinate / joint coordinate of a joint with a motor of its own; None if it is not stated.

    In files with all motors, driven joints without one have the drive at the joint, which is a reduction of 1.
    """
    name = joint.names[0] if len(joint.names) == 1 else ""
    if mechanism.reductions is not None:
        return mechanism.reductions.get(name)
    if not mechanism.all_motors or mechanism.motors is None or not joint.drive.driven:
        return None
    rows = []
    for motor in mechanism.motors.values():
        if motor.row and name in motor.row:
            rows.append(motor.row)
    if not rows:
        return 1.0
    if len(rows) > 1 or len(rows[0]) > 1:  # several motors move the joint, or the motor moves several joints
        return None
    return rows[0][name]


# --------------------------------------------------------------------------------------------- the comparison


def _compare_values(
    subject: str, name: str, views: Sequence[View], worst: dict[str, dict[str, tuple[float, str]]]
) -> None:
    """Compare the values of one quantity in the files that state it.

    `worst` gets the largest difference of each file and quantity: {file: {quantity: (difference, subject)}}.
    """
    rule = QUANTITIES[name]
    key = (subject, name)
    groups = _groups(key, rule, views)
    right_group = max(groups, key=_weight)
    if rule.usual is not None:
        for group in groups:
            if group[0].values[key] == rule.usual:
                right_group = group
    reference = right_group[0]
    with_mechanism = any(view.is_mechanism for view in views)
    if rule.by_majority and not with_mechanism and len(_families(right_group)) < 2:
        return
    for view in views:
        if view.ledger is not None and with_mechanism:
            view.ledger.placed |= name in _GEOMETRY
        difference = rule.difference(reference.values[key], view.values[key])
        row = worst.setdefault(view.file, {})
        if rule.is_check and (name not in row or difference > row[name][0]):
            row[name] = (difference, subject)
        if view in right_group or view.ledger is None:
            continue
        others = _file_names(right_group)
        text = difference_text(subject, name, view.values[key], reference.values[key], difference, others)
        if len(_families(right_group)) == 1 and not reference.is_mechanism:
            text += " One of the two statements is wrong."
        advice = "find out which file is wrong: `twin audit --robot NAME` compares every file with the mechanism"
        if reference.is_mechanism:
            advice = "export the file again; if its value is the right one, correct the robot"
        value: float | None = None
        if np.isfinite(difference):
            value = difference
        size = Measured(value, rule.tolerance, rule.unit_of_difference)
        # "physics", as before in results that other programs read
        code = f"physics.{name.replace(' ', '_')}"
        view.ledger.add(code, rule.severity, text, subject, suggestion=advice, size=size)


def _groups(key: tuple[str, str], rule: ComparisonRule, views: Sequence[View]) -> list[list[View]]:
    """Return the files in groups: each agrees with the first of its group."""
    groups: list[list[View]] = []
    for view in views:
        for group in groups:
            # With the first of the group: along a chain of neighbours, files farther apart than the tolerance would
            # agree.
            if rule.difference(group[0].values[key], view.values[key]) <= rule.tolerance:
                group.append(view)
                break
        else:
            groups.append([view])
    return groups


def _families(views: Sequence[View]) -> set[str]:
    """Return the independent sources among files."""
    return {view.family for view in views}


def _trust(view: View) -> int:
    if view.is_mechanism:
        return 0
    return trust(view.format)


def _weight(group: Sequence[View]) -> tuple[bool, int, int]:
    """Return what decides which group is right: the mechanism, the number of sources, the trust in its first file."""
    families = _families(group)
    # Negative: of groups with as many sources, the one with the most trusted file, whose number is the smallest.
    return _MECHANISM_FORMAT in families, len(families), -min(map(_trust, group))


def _file_names(views: Sequence[View]) -> str:
    """Return the names of files as text; of more than three, the first two and the number of the others."""
    names = [view.file for view in views]
    if len(names) > 3:
        names = [*names[:2], f"{len(views) - 2} more"]
    *first, last = names
    if not first:
        return last
    return f"{', '.join(first)} and {last}"
