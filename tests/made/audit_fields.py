"""Every declared field of an exported URDF or MJCF, and one change of each: a defect that nobody had to think of.

A field is an attribute, one number of an attribute, an element as a whole, or an attribute that the format knows and
the file does not state. The changes are small (0.5 mm, 0.5 degrees, 1 %), a sign, an exchange of neighbours, another
reference, a removal, a duplicate, another parent. `kind` says which field and which change, without the place: a
campaign draws some places of each kind.
"""

from __future__ import annotations

import copy
import random
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

LENGTHS = {"xyz", "pos", "anchor", "center", "meshpos"}
"""Attributes in m, which change by 0.5 mm."""

ANGLES = {"rpy", "euler"}
"""Attributes in rad, which change by 0.5 degrees."""

NAMING = ("name", "link", "joint", "body", "body1", "body2", "joint1", "joint2", "site", "site1", "site2", "mesh")
"""Attributes whose values are names that a finding may state."""

MILLIMETRES = 0.0005
RADIANS = 0.00873


@dataclass(frozen=True)
class FieldChange:
    """One change of one field of a file.

    Attributes:
        file: path of the file relative to the folder of the export.
        kind: the field without its place, and the change: "joint/origin@xyz[0]: small".
        place: where the field is, for a reader.
        subjects: names and words of which a finding must state one to name the cause.
        edit: changes the file in a folder.
    """

    file: str
    kind: str
    place: str
    subjects: frozenset[str]
    edit: Callable[[Path], None]


Path_ = tuple[int, ...]
"""Place of an element: the index of the child at each level below the root."""


def parsed(file: Path) -> ET.Element:
    """Return the root of an XML file, with its comments, in which exports state assumptions."""
    return ET.fromstring(file.read_bytes(), ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))


def element_at(root: ET.Element, place: Path_) -> ET.Element:
    for k in place:
        root = root[k]
    return root


def elements(root: ET.Element, place: Path_ = (), tags: str = "") -> Iterator[tuple[Path_, str, ET.Element]]:
    """Yield (place, tags from the root down, element) of all elements below `root`."""
    for k, child in enumerate(root):
        if not isinstance(child.tag, str):
            continue
        # The depth of a body in the tree is no other field.
        below = tags if child.tag == "body" and tags.endswith("body") else f"{tags}/{child.tag}".lstrip("/")
        yield (*place, k), below, child
        yield from elements(child, (*place, k), below)


def numbers_of(text: str) -> list[float] | None:
    try:
        values = [float(token) for token in text.split()]
    except ValueError:
        return None
    return values or None


def subjects_of(root: ET.Element, place: Path_, words: Iterable[str]) -> frozenset[str]:
    """Return the names at a place: of the element, of the nearest named ones around it, of its children; and words."""
    found = set(words)
    around = [element_at(root, place[:depth]) for depth in range(1, len(place) + 1)]
    named = [e for e in around if e.get("name") and e.tag not in ("default",)]
    own = element_at(root, place)
    chosen = [*named[-2:], *own]
    if named:
        chosen += named[-1]  # the links of a joint
    if own is not root:
        chosen.append(own)
    for e in chosen:
        found |= {e.get(key, "") for key in NAMING}
    return frozenset(found - {""})


def stored(file: Path, root: ET.Element) -> None:
    text = ET.tostring(root, encoding="unicode")
    file.unlink()
    file.write_text(f'<?xml version="1.0"?>\n{text}\n')


def xml_change(
    file: str, kind: str, place: Path_, root: ET.Element, words: Iterable[str], change: Callable[[ET.Element], None]
) -> FieldChange:
    """Return a change of the element at a place; `change` gets the root, so that it may also move elements."""

    def edit(folder: Path) -> None:
        own = parsed(folder / file)
        change(own)
        stored(folder / file, own)

    names = "/".join(element_at(root, place[:d]).get("name", "") for d in range(1, len(place) + 1))
    return FieldChange(file, kind, names.strip("/"), subjects_of(root, place, words), edit)


def written(values: Sequence[float]) -> str:
    return " ".join(f"{value:.15g}" for value in values)


def number_changes(attribute: str, values: list[float], k: int) -> Iterator[tuple[str, list[float]]]:
    """Yield (name of the change, changed numbers) for the number k of an attribute."""
    value = values[k]
    step = 0.01 * value if value else MILLIMETRES
    if attribute in LENGTHS:
        step = MILLIMETRES
    elif attribute in ANGLES:
        step = RADIANS
    small = list(values)
    small[k] += step
    yield "small", small
    if value:
        negated = list(values)
        negated[k] = -value
        yield "sign", negated
    if k + 1 < len(values) and abs(value - values[k + 1]) > 1e-9 + 1e-6 * abs(value):
        swapped = list(values)
        swapped[k], swapped[k + 1] = swapped[k + 1], swapped[k]
        yield "exchanged with the next", swapped


def setter(place: Path_, attribute: str, text: str | None) -> Callable[[ET.Element], None]:
    def change(root: ET.Element) -> None:
        e = element_at(root, place)
        if text is None:
            del e.attrib[attribute]
        else:
            e.set(attribute, text)

    return change


def attribute_changes(
    file: str, root: ET.Element, place: Path_, tags: str, e: ET.Element, others: dict[str, list[str]]
) -> Iterator[FieldChange]:
    for attribute, text in e.attrib.items():
        field = f"{tags}@{attribute}"
        words = {attribute, e.tag, text} if numbers_of(text) is None else {attribute, e.tag}
        yield xml_change(file, f"{field}: removed", place, root, words, setter(place, attribute, None))
        values = numbers_of(text)
        if values is None:
            other = next((o for o in others[field] if o != text), None)
            if other is not None:
                yield xml_change(
                    file, f"{field}: another's", place, root, {*words, other}, setter(place, attribute, other)
                )
            yield xml_change(
                file, f"{field}: unknown", place, root, {*words, f"{text}_x"}, setter(place, attribute, f"{text}_x")
            )
            continue
        for k in range(len(values)):
            for name, changed in number_changes(attribute, values, k):
                index = f"[{k}]" if len(values) > 1 else ""
                yield xml_change(
                    file, f"{field}{index}: {name}", place, root, words, setter(place, attribute, written(changed))
                )


def element_changes(
    file: str, root: ET.Element, place: Path_, tags: str, e: ET.Element, parents: dict[str, list[Path_]]
) -> Iterator[FieldChange]:
    *above, k = place
    parent_place = tuple(above)

    def removed(own: ET.Element) -> None:
        del element_at(own, parent_place)[k]

    def duplicated(own: ET.Element) -> None:
        parent = element_at(own, parent_place)
        parent.insert(k + 1, copy.deepcopy(parent[k]))

    def reordered(own: ET.Element) -> None:
        parent = element_at(own, parent_place)
        moved = parent[k]
        del parent[k]
        parent.insert(k + 1, moved)

    yield xml_change(file, f"{tags}: removed", place, root, {e.tag}, removed)
    yield xml_change(file, f"{tags}: duplicated", place, root, {e.tag}, duplicated)
    if k + 1 < len(element_at(root, parent_place)):
        yield xml_change(file, f"{tags}: after the next", place, root, {e.tag}, reordered)
    tags_above = tags.rpartition("/")[0]
    elsewhere = [p for p in parents[tags_above] if p != parent_place and p[: len(place)] != place]
    if elsewhere and place[:-1] and e.tag != "body":
        target = elsewhere[len(elsewhere) // 2]

        def moved(own: ET.Element) -> None:
            parent, other = element_at(own, parent_place), element_at(own, target)
            e = parent[k]
            other.append(e)
            del parent[k]

        words = subjects_of(root, target, {e.tag})
        yield xml_change(file, f"{tags}: in another parent", place, root, words, moved)


def declared_changes(folder: Path, file: str) -> Iterator[FieldChange]:
    """Yield one change of each kind for each declared field of an XML file."""
    root = parsed(folder / file)
    others: dict[str, list[str]] = defaultdict(list)
    parents: dict[str, list[Path_]] = defaultdict(list)
    listed = list(elements(root))
    for place, tags, e in listed:
        parents[tags].append(place)
        for attribute, text in e.attrib.items():
            others[f"{tags}@{attribute}"].append(text)
    for attribute in list(root.attrib):
        field = f"{root.tag}@{attribute}"
        text = root.attrib[attribute]

        def renamed(own: ET.Element, attribute: str = attribute, text: str = text) -> None:
            own.set(attribute, f"{text}_x")

        yield xml_change(file, f"{field}: unknown", (), root, {attribute, root.tag, f"{text}_x"}, renamed)
    for place, tags, e in listed:
        yield from attribute_changes(file, root, place, tags, e, others)
        yield from element_changes(file, root, place, tags, e, parents)
        if e.text and e.text.strip():
            yield from text_changes(file, root, place, tags, e)


def text_changes(file: str, root: ET.Element, place: Path_, tags: str, e: ET.Element) -> Iterator[FieldChange]:
    """Yield changes of the text of an element: a number, or a word."""
    values = numbers_of(e.text or "")
    texts = {"unknown": f"{(e.text or '').strip()}_x", "removed": ""}
    if values is not None and len(values) == 1:
        texts = {"small": written([values[0] * 1.01]), "sign": written([-values[0]]), "removed": ""}
    for name, text in texts.items():

        def change(own: ET.Element, text: str = text) -> None:
            element_at(own, place).text = text

        yield xml_change(file, f"{tags} text: {name}", place, root, {e.tag}, change)


def undeclared_changes(folder: Path, file: str, known: Mapping[str, Iterable[str]]) -> Iterator[FieldChange]:
    """Yield attributes that elements could have, with values of several forms.

    Args:
        folder: folder of the export.
        file: the file.
        known: {tags or tag: its attributes in the format}; a value of the form "attribute=value" states the value.
    """
    root = parsed(folder / file)
    for place, tags, e in elements(root):
        for attribute in known.get(tags, known.get(e.tag, ())):
            name, _, given = attribute.partition("=")
            if name in e.attrib:
                continue
            for value in [given] if given else VALUES:
                yield xml_change(
                    file, f"{tags}@{name} added: {value}", place, root, {name, e.tag}, setter(place, name, value)
                )


VALUES = ("0.1", "1", "2", "true", "false", "0 0 0.1", "0 0 0.1 1", "0.02 1", "0.9 0.95", "0.1 0.2")
"""Values of undeclared attributes, of which a reader takes the ones of the right form."""


def drawn(changes: Iterable[FieldChange], each: int, seed: int) -> list[FieldChange]:
    """Return at most `each` changes of every kind, at drawn places."""
    kinds: dict[str, list[FieldChange]] = defaultdict(list)
    for change in changes:
        kinds[change.kind].append(change)
    random_ = random.Random(seed)
    chosen = []
    for same in kinds.values():
        chosen += random_.sample(same, min(each, len(same)))
    return chosen


def known_fields(format: str) -> dict[str, list[str]]:
    """Return {tag: attributes that the format knows}, of a format "mjcf" or "urdf"."""
    if format == "mjcf":
        return mjcf_fields()
    return URDF_FIELDS


def mjcf_fields() -> dict[str, list[str]]:
    """Return {tag: attributes} of the schema that MuJoCo prints; of a tag at several places, all attributes."""
    import mujoco

    mujoco.MjModel.from_xml_string("<mujoco/>")  # prints nothing before something was compiled
    known: dict[str, list[str]] = defaultdict(list)
    tag = ""
    for line in mujoco.mj_printSchema(False, False).splitlines():
        found = re.match(r" *([\w()]+) \(.\) +(.*)", line)
        if found:
            tag = found[1].replace("(world)", "")
            known[tag] += found[2].split()
        else:
            known[tag] += line.split()
    known["freejoint"] = []
    return {tag: sorted(set(attributes) - {"user", "class", "name"}) for tag, attributes in known.items()}


URDF_FIELDS = {
    "robot/joint": ["type=floating"],
    "limit": ["lower=-0.1", "upper=0.1", "effort=1", "velocity=0.1"],
    "mesh": ["scale=0.01 0.01 0.01"],
    "origin": ["rpy=0 0 0.1"],
    "color": ["rgba=1 0 0 1"],
}
"""Attributes that a URDF may have; most are required, so that they are declared."""


def wrapped_changes(folder: Path, file: str, format: str) -> Iterator[FieldChange]:
    """Yield elements that a file could have: defaults and flags of an MJCF, children of the joints of a URDF."""
    root = parsed(folder / file)
    for place, tags, e in elements(root):
        if format == "urdf" and tags == "joint":
            for text in URDF_CHILDREN:
                child = ET.fromstring(text)
                if e.find(child.tag) is None:
                    yield xml_change(file, f"{tags}/{child.tag} added: {text}", place, root, *_added(place, child))
        if format == "urdf" and tags == "link":
            for text in URDF_SHAPES:
                child = ET.fromstring(text)
                yield xml_change(file, f"{tags}/{child.tag} added: {text}", place, root, *_added(place, child))
    if format == "mjcf":
        for text in MJCF_CHILDREN:
            child = ET.fromstring(text)
            yield xml_change(file, f"{child.tag} added: {text}", (), root, *_added((), child))


def _added(place: Path_, child: ET.Element) -> tuple[set[str], Callable[[ET.Element], None]]:
    words = {e.tag for e in child.iter()} | {key for e in child.iter() for key in e.attrib}

    def change(root: ET.Element) -> None:
        element_at(root, place).append(copy.deepcopy(child))

    return words, change


URDF_CHILDREN = (
    '<mimic joint="q1" multiplier="2" offset="0.1"/>',
    '<dynamics damping="1.5" friction="0"/>',
    '<dynamics damping="0" friction="0.7"/>',
    '<safety_controller soft_lower_limit="-0.05" soft_upper_limit="0.05" k_position="20" k_velocity="10"/>',
    '<safety_controller k_velocity="10"/>',
    '<calibration rising="0.1"/>',
    '<limit lower="-0.1" upper="0.1" effort="3" velocity="0.2"/>',
    '<axis xyz="0 1 0"/>',
)
URDF_SHAPES = (
    '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>',
    '<collision><geometry><sphere radius="0.2"/></geometry></collision>',
    '<inertial><mass value="3"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>',
)
MJCF_CHILDREN = (
    *(f'<option><flag {name}="disable"/></option>' for name in ("constraint", "contact", "spring", "damper", "sensor")),
    *(f'<option><flag {name}="disable"/></option>' for name in ("frictionloss", "clampctrl", "warmstart", "refsafe")),
    *(f'<option><flag {name}="disable"/></option>' for name in ("filterparent", "eulerdamp", "midphase", "nativeccd")),
    *(f'<option><flag {name}="enable"/></option>' for name in ("override", "energy", "multiccd", "invdiscrete")),
    *(f"<option {text}/>" for text in ('wind="1 0 0"', 'density="1000"', 'viscosity="0.1"', 'impratio="10"')),
    *(f"<option {text}/>" for text in ('timestep="0.02"', 'integrator="Euler"', 'cone="elliptic"', 'gravity="0 0 -5"')),
    '<default><joint damping="0.5"/></default>',
    '<default><joint armature="0.5"/></default>',
    '<default><joint frictionloss="0.5"/></default>',
    '<default><joint stiffness="5" springref="0.1"/></default>',
    '<default><joint limited="false"/></default>',
    '<default><joint solreflimit="0.5 1"/></default>',
    '<default><joint margin="0.05"/></default>',
    '<default><joint actuatorfrcrange="-0.1 0.1"/></default>',
    '<default><mesh scale="2 2 2"/></default>',
    '<default><mesh maxhullvert="5"/></default>',
    '<default><geom contype="1" conaffinity="1"/></default>',
    '<default><geom friction="0.1 0 0"/></default>',
    '<default><geom rgba="1 0 0 1"/></default>',
    '<default><geom pos="0 0 0.01"/></default>',
    '<default><geom solref="0.5 1"/></default>',
    '<default><geom margin="0.05"/></default>',
    '<default><geom condim="1"/></default>',
    '<default><site pos="0 0 0.01"/></default>',
    '<default><general gear="2"/></default>',
    '<default><general dyntype="filter" dynprm="0.1"/></default>',
    '<default><general ctrllimited="false"/></default>',
    '<default><general forcelimited="false"/></default>',
    '<default><equality active="false"/></default>',
    '<default><tendon damping="1"/></default>',
    '<default><tendon stiffness="1"/></default>',
    '<default><tendon frictionloss="1"/></default>',
    '<default><material rgba="1 0 0 0.2"/></default>',
    '<compiler inertiafromgeom="true"/>',
    '<compiler settotalmass="5"/>',
    '<compiler balanceinertia="true" boundmass="5"/>',
    '<compiler angle="degree"/>',
    '<compiler eulerseq="zyx"/>',
    '<compiler fusestatic="true"/>',
    '<compiler discardvisual="true"/>',
    '<statistic meanmass="3"/>',
    '<contact><exclude body1="world" body2="world"/></contact>',
    '<worldbody><light pos="0 0 3"/></worldbody>',
    '<worldbody><camera name="c" pos="0 0 3"/></worldbody>',
    '<worldbody><geom type="plane" size="1 1 0.1"/></worldbody>',
    '<worldbody><body name="ballast" pos="1 0 0"><freejoint/><geom size="0.1"/></body></worldbody>',
    '<worldbody><body name="ballast" mocap="true"/></worldbody>',
    "<sensor><clock/></sensor>",
    '<size memory="100M"/>',
    '<visual><global azimuth="5"/></visual>',
)
"""Elements that an MJCF may have besides, with and without an effect."""
