"""Read the tables of a robot's C# class in a Unity package, and find parts of the class that were changed.

The tables are compared with the other files and with the mechanism, as the data of any format. The methods are not run;
the file states a hash of each, and of the tables, so that a change of a part is found, and named.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import TOOL, FileFrame, FileMass, FileMechanism
from twin.exchange.audit.motion_lines import motion_lines
from twin.exchange.audit.poses import Array
from twin.exchange.formats.unity.audit.shipped_files import PACKAGE, meta_difference

_PACKAGE = "com.twin.player"

ROBOTS = "Runtime/Robots"
"""Folder of the classes in a package."""

_TABLE = re.compile(r"private static readonly \w+(?:\[\])? (?P<name>\w+) =\s*(?P<value>\{.*?\}|\"[^\"]*\");", re.DOTALL)
_ENTRY = re.compile(r'"(?:[^"\\]|\\.)*"|[^,{}()\s]+')
_METHOD_LINE = re.compile(r"^ {8}(?:public|private)\b[^=]*?(?P<name>\w+)\([^()]*\)$")
_HASH = re.compile(r"^// {3}(?P<hash>[0-9a-f]{16}) (?P<name>\w+(?: \d+)?)$", re.MULTILINE)
_TABLE_HASH = re.compile(r"^// {3}(?P<hash>[0-9a-f]{16}) table (?P<name>\w+)$", re.MULTILINE)
_TABLE_DECLARATION = re.compile(
    r"^ {8}private (?:const|static readonly) \S+ (?P<name>\w+) =.*?(?=\n {8}private |\n\n|\Z)", re.MULTILINE | re.DOTALL
)
_MODEL = re.compile(r"\((sha256:[0-9a-f]{64})\)")
_ROBOT = re.compile(r'public string Robot \{ get \{ return "([^"]*)"; \} \}')
_NAMESPACE = re.compile(r"^namespace (?P<name>[\w.]+)", re.MULTILINE)
_CLASS_NAMESPACE = "Twin.Robots"
"""Namespace of the classes, which the samples of the package name in full."""

_FIRST_CODE_LINE = "using System;"
"""First line of the code, behind the comments at the start."""

_TABLES = "tables"
"""Name of the part before the first method."""

_ONE_COORDINATE = ("revolute", "prismatic")

_BOUND_SIGNS = {"minimum": 1.0, "maximum": -1.0}
"""Kinds of bounds of single joints: a bound is that this factor times the joint value is at least a number."""

_EQUAL_ROUNDING = 1e-9
"""Largest difference in m or rad of equal numbers in two tables, which have all digits."""


def read_classes(folder: Path, ledger: Ledger) -> Content | None:
    """Return the robot of the class in a package, and report changed parts of all classes.

    The content is None if there is no class, or several: then the package is not that of one robot. It is also None if
    the tables of the class cannot be read, which is reported.
    """
    contents = []
    files = sorted((folder / ROBOTS).glob("*.cs"))
    for file in files:
        name = file.relative_to(folder).as_posix()
        # The hashes are of lines with \n: a checkout on Windows must not count as a change.
        text = file.read_text(encoding="utf-8", errors="replace").replace("\r\n", "\n")
        _check_parts(name, text, ledger)
        _check_namespace(name, text, ledger)
        _check_meta(folder, name, ledger)
        try:
            contents.append(_content(text, ledger))
        except (KeyError, ValueError, IndexError, TypeError) as error:
            message = f"the tables of {name} cannot be read: {type(error).__name__}, {str(error)[:100]}."
            ledger.add("unity.kinematics", "error", message, name)
    for meta in sorted((folder / ROBOTS).glob("*.cs.meta")):
        name = meta.relative_to(folder).as_posix().removesuffix(".meta")
        if not (folder / name).is_file():
            ledger.wrong("unity.kinematics", f"{name} is missing; only its .meta file exists.", name)
    has_folder = (folder / ROBOTS).is_dir() or (folder / f"{ROBOTS}.meta").is_file()
    if has_folder and not any((folder / ROBOTS).glob("*.cs*")):
        text = f"the package has the folder {ROBOTS} of the robot's kinematics, but no class in it."
        ledger.wrong("unity.kinematics", text, ROBOTS, suggestion="export the package again")
    if len(files) != 1 or not contents:
        return None
    return contents[0]


# ------------------------------------------------------------------------------------------------- parts of the class


def _check_parts(name: str, text: str, ledger: Ledger) -> None:
    """Report parts of a class that are not as their hashes state."""
    stated: dict[str, str] = {}
    for match in _HASH.finditer(text):
        stated[match["name"]] = match["hash"]
    parts = _parts(text)
    wrong = 0
    for part in dict.fromkeys((*stated, *parts)):
        if part not in parts:
            fault = f"{name} states a hash of '{part}', which it does not have."
        elif part not in stated:
            fault = (
                f"{name} states no hash of '{part}': this part was added, renamed, or written by an earlier version."
            )
        elif _hash(parts[part]) != stated[part]:
            fault = f"'{part}' in {name} was changed after it was written: it has another hash than the file states."
            if part == _TABLES:
                fault += _changed_tables(text, parts[part])
        else:
            continue
        wrong += 1
        ledger.wrong("unity.kinematics", fault, name, suggestion="export the package again")
    ledger.row(f"hashes of {len(parts)} parts of {name}", float(wrong), "differ", 0.0, where=name)


def _changed_tables(text: str, part: str) -> str:
    """Return a sentence that names the constants and tables of a part with other hashes than the whole text states.

    Return "" if it states none.
    """
    stated: dict[str, str] = {}
    for match in _TABLE_HASH.finditer(text):
        stated[match["name"]] = match["hash"]
    if not stated:  # a class of an earlier version
        return ""
    present: dict[str, str] = {}
    for match in _TABLE_DECLARATION.finditer(part):
        present[match["name"]] = _hash(match[0])
    changed = [name for name in {*stated, *present} if stated.get(name) != present.get(name)]
    if not changed:
        return " Each table has the hash that the file states for it: what stands between them was changed."
    return f" What differs is {', '.join(sorted(changed))}."


def _check_namespace(name: str, text: str, ledger: Ledger) -> None:
    """Report a class in another namespace than that by which the scripts of the package find it."""
    _, _, code = text.partition(_FIRST_CODE_LINE)
    found = _NAMESPACE.search(code)
    stated = found["name"] if found else "none"
    if stated != _CLASS_NAMESPACE:
        message = (
            f"the class in {name} has the namespace {stated}; scripts of the package look for it in {_CLASS_NAMESPACE}."
        )
        ledger.wrong("unity.kinematics", message, name, suggestion=f"write namespace {_CLASS_NAMESPACE}")


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8")).hexdigest()[:16]


def _parts(text: str) -> dict[str, str]:
    """Return {name: text} of the parts of the code: what stands before the first method, and each method.

    A part whose name another part has gets the number of the parts before it, as "MoveTo 7".
    """
    parts: dict[str, list[str]] = {}
    current = parts.setdefault(_TABLES, [])
    _, _, code = text.partition(_FIRST_CODE_LINE)
    for line in code.split("\n"):
        match = _METHOD_LINE.match(line)
        if match is not None:
            name = match["name"]
            if name in parts:
                name = f"{name} {len(parts)}"
            current = parts.setdefault(name, [])
        current.append(line)
    return {name: "\n".join(lines) for name, lines in parts.items()}


def _check_meta(folder: Path, name: str, ledger: Ledger) -> None:
    """Report entries of .meta files that are not as twin writes them: another GUID breaks references to the class."""
    for path, alike in ((ROBOTS, "Runtime/Resources.meta"), (name, "Runtime/IRobotKinematics.cs.meta")):
        meta = folder / f"{path}.meta"
        if not meta.is_file():
            continue  # reported with the .meta files of the package
        difference = meta_difference(meta.read_bytes(), (PACKAGE / alike).read_bytes(), own_guid=True)
        if difference:
            ledger.wrong("unity.shipped", f"{path}.meta {difference}.", f"{path}.meta")
        # Unity's GUIDs have 32 digits, as MD5 has. Of the path, it is the same in each export, so that scenes keep
        # their links.
        expected = hashlib.md5(f"{_PACKAGE}/{path}".encode(), usedforsecurity=False).hexdigest()
        if f"guid: {expected}\n" not in meta.read_text(encoding="utf-8", errors="replace").replace("\r\n", "\n"):
            text = (
                f"{path}.meta has another GUID than twin gives '{path}': references to it are lost by the next export."
            )
            ledger.wrong("unity.guid", text, f"{path}.meta", suggestion="export the package again")


# --------------------------------------------------------------------------------------------------------- the tables


def _content(text: str, ledger: Ledger) -> Content:
    """Return the robot that the tables of a class describe.

    Raises:
        KeyError, ValueError, IndexError: a table is missing or has a wrong count of entries, or an entry is not of its
            kind.
    """
    tables: dict[str, list[str]] = {}
    for match in _TABLE.finditer(text):
        tables[match["name"]] = _ENTRY.findall(match["value"])
    links = tuple(_words(tables["links"]))
    model = _MODEL.search(text)
    robot = _ROBOT.search(text)
    content = Content(ledger, "unity", declared=links)
    if model is not None:
        content.model_hash = model[1]
    if robot is not None:
        content.stated[ROBOT] = robot[1]
    joints = _joints(tables, links)
    frames = {TOOL: FileFrame(_words(tables["toolLink"])[0], _pose(_numbers(tables["toolFrame"])))}
    masses = {}
    for link, mass in zip(links, _numbers(tables["linkMasses"]), strict=True):
        if mass:  # 0: unknown
            masses[link] = FileMass(float(mass))
    content.mechanism = FileMechanism(links, masses, joints=joints, frames=frames, complete=True)
    content.facts = {"units": "m", "up_axis": "Z", "handedness": "right"}
    # The checks below pair entries by their numbers, which a table of another size would shift.
    if _check_sizes(tables, ledger):
        home = _numbers(tables["homeJoints"]).tolist()
        content.mechanism.home_posture = dict(zip(_words(tables["joints"]), home, strict=True))
        _check_angles(tables, ledger)
        _check_tree(tables, links, ledger)
        _check_bounds(tables, ledger)
        _check_distances(tables, links, ledger)
    return content


def _joints(tables: Mapping[str, list[str]], links: tuple[str, ...]) -> list[FileJoint]:
    names = _words(tables["allJoints"])
    kinds = _words(tables["jointTypes"])
    parents = _numbers(tables["jointParents"]).astype(int)
    children = _numbers(tables["jointChildren"]).astype(int)
    active = _numbers(tables["jointActive"]).astype(int)
    # Python would take a negative number from the end of the list, and so another link.
    if min(*parents, *children, 0) < 0:
        raise ValueError("the number of a link is negative")
    frames = _numbers(tables["jointFrames"]).reshape(len(names), 2, 12)
    limits = _numbers(tables["jointLimits"]).reshape(len(names), 2)
    driven = _words(tables["joints"])
    joints = []
    for number, name in enumerate(names):
        T_parent_joint = _pose(frames[number, 0])
        # At zero coordinates, the joint's frames on both links coincide.
        T_parent_child = T_parent_joint @ poses.inverse(_pose(frames[number, 1]))
        drive = FileDrive()
        if kinds[number] in _ONE_COORDINATE:
            low, high = limits[number].tolist()
            drive = FileDrive((low, high), active[number] >= 0 and driven[active[number]] == name)
        motions = motion_lines(kinds[number], T_parent_joint)
        parent = links[parents[number]]
        child = links[children[number]]
        joints.append(FileJoint((name,), parent, child, T_parent_child, motions, drive))
    return joints


def _check_sizes(tables: Mapping[str, list[str]], ledger: Ledger) -> bool:
    """Report tables without an entry for each of what they belong to; return whether there are none."""
    findings_before = len(ledger.found)
    count = len(tables["joints"])
    for table, expected in (
        ("angles", count),
        ("restJoints", count),
        ("homeJoints", count),
        ("boundKinds", len(tables["boundNames"])),
        ("boundLeast", len(tables["boundNames"])),
        ("boundWeights", len(tables["boundNames"]) * count),
        ("drawnDistances", len(tables["distanceNames"])),
        ("publishedParameters", len(tables["parameterNames"])),
        ("measureAlarms", len(tables["measureNames"])),
        ("inLoops", len(tables["allJoints"])),
    ):
        if len(tables[table]) != expected:
            text = f"the table '{table}' of the class has {len(tables[table])} entries, not {expected}."
            ledger.wrong("unity.kinematics", text, table)
    return len(ledger.found) == findings_before


def _check_angles(tables: Mapping[str, list[str]], ledger: Ledger) -> None:
    """Report driven joints that are angles in one table, and slides in the other."""
    kinds = dict(zip(_words(tables["allJoints"]), _words(tables["jointTypes"]), strict=True))
    for name, angle in zip(_words(tables["joints"]), tables["angles"], strict=True):
        if angle != str(kinds.get(name) == "revolute").lower():
            text = f"the class states angle = {angle} for joint '{name}', which is {kinds.get(name, 'not there')}."
            ledger.wrong("unity.kinematics", text, f"joint '{name}'")


def _check_tree(tables: Mapping[str, list[str]], links: tuple[str, ...], ledger: Ledger) -> None:
    """Report links that are the child of no joint or of several, beside those that close loops."""
    owners = dict.fromkeys(links, 0)  # number of joints outside of loops that move a link
    children = _numbers(tables["jointChildren"]).astype(int)
    for child, loop in zip(children, tables["inLoops"], strict=True):
        owners[links[child]] += loop == "false"
    roots: list[str] = []
    with_several_owners: list[str] = []
    for link, count in owners.items():
        if count == 0:
            roots.append(link)
        elif count > 1:
            with_several_owners.append(link)
    if len(roots) > 1 or with_several_owners:
        link = with_several_owners[0] if with_several_owners else roots[-1]
        text = f"the class has {owners[link]} joints outside of loops that move link '{link}': the joints are no tree."
        ledger.wrong("unity.kinematics", text, f"link '{link}'")


def _check_bounds(tables: Mapping[str, list[str]], ledger: Ledger) -> None:
    """Report bounds of single joints that are not the limits of these joints, and postures beyond any bound."""
    joints = _words(tables["joints"])
    limits = _numbers(tables["jointLimits"]).reshape(-1, 2)
    by_joint = dict(zip(_words(tables["allJoints"]), limits, strict=True))
    lower_bounds = _numbers(tables["boundLeast"])
    weights = _numbers(tables["boundWeights"]).reshape(len(lower_bounds), len(joints))
    names = _words(tables["boundNames"])
    for number, kind in enumerate(_words(tables["boundKinds"])):
        name = names[number]
        if kind in _BOUND_SIGNS and name in joints:
            expected = np.zeros(len(joints))
            expected[joints.index(name)] = _BOUND_SIGNS[kind]
            side = 0 if kind == "minimum" else 1
            limit = _BOUND_SIGNS[kind] * by_joint[name][side]
            if not (np.allclose(weights[number], expected) and abs(lower_bounds[number] - limit) <= _EQUAL_ROUNDING):
                text = f"the {kind} by which the class judges joint '{name}' is not the limit in its table of limits."
                ledger.wrong("unity.kinematics", text, f"joint '{name}'")
    for table in ("homeJoints", "restJoints"):
        deficits = lower_bounds - weights @ _numbers(tables[table])
        worst_bound = int(np.argmax(deficits)) if len(deficits) else 0
        if len(deficits) and deficits[worst_bound] > _EQUAL_ROUNDING:
            text = f"{table}: bound '{names[worst_bound]}' is exceeded by {deficits[worst_bound]:.4g} m or rad."
            ledger.wrong("unity.kinematics", text, table)


def _check_distances(tables: Mapping[str, list[str]], links: tuple[str, ...], ledger: Ledger) -> None:
    """Report distances of two joints on a link that are not those between the frames of these joints."""
    joints = _words(tables["allJoints"])
    frames = _numbers(tables["jointFrames"]).reshape(len(joints), 2, 3, 4)
    parents = _numbers(tables["jointParents"]).astype(int)
    distances = _numbers(tables["drawnDistances"])
    for title, stated in zip(_words(tables["distanceNames"]), distances, strict=True):
        link, _, pair = title.partition(": ")
        points = []
        for name in pair.split(" to "):
            if name in joints and link in links:
                number = joints.index(name)
                side = 0 if links[parents[number]] == link else 1
                points.append(frames[number, side, :, 3])
        if len(points) != 2:
            text = f"the class states the distance '{title}', but has no such link or joints."
        else:
            distance = float(np.linalg.norm(points[1] - points[0]))
            if abs(distance - stated) <= _EQUAL_ROUNDING:
                continue
            text = f"the class states {stated:.6g} m for the distance '{title}'; by its frames it is {distance:.6g} m."
        ledger.wrong("unity.kinematics", text, title)


def _words(entries: list[str]) -> list[str]:
    words = []
    for entry in entries:
        if not (len(entry) >= 2 and entry[0] == entry[-1] == '"'):
            raise ValueError(f"{entry} is not a text")
        words.append(entry[1:-1])
    return words


def _numbers(entries: list[str]) -> Array:
    infinities = {"double.PositiveInfinity": np.inf, "double.NegativeInfinity": -np.inf}
    values: list[float] = []
    for entry in entries:
        if entry in infinities:
            values.append(infinities[entry])
        else:
            values.append(float(entry))
    return np.array(values)


def _pose(rows: Array) -> Array:
    """Return a pose (4, 4) from its first three rows, 12 numbers."""
    T = np.eye(4)
    T[:3] = rows.reshape(3, 4)
    return T
