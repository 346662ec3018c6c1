"""Which joint of one side is which joint of the other: by names, by links, else by the structure of the chains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from twin.comparison.side import Axis, RobotSide, common_prefix, plain_name
from twin.core.errors import TwinError


@dataclass(frozen=True)
class Matching:
    """Pairs of joints.

    Attributes:
        pairs: for each joint of the second side, the index of the joint of the first side that it is.
        renamed: (name in the first side, name in the second side) of pairs whose names differ.
    """

    pairs: tuple[int, ...]
    renamed: tuple[tuple[str, str], ...]


def match(first: RobotSide, second: RobotSide) -> Matching:
    """Match the joints of two sides.

    Raises:
        TwinError: the sides have different numbers or types of joints, so that no joint-by-joint match exists.
    """
    # names are what the author says of a joint; places in a tree only count where no name helps
    pairs = _pairs_of_names(first, second) or _pairs_of_loops(first, second)
    if pairs is None:
        pairs = _pairs_of_structure(first, second)
    renamed = []
    for j, i in enumerate(pairs):
        names = (first.axes[i].name, second.axes[j].name)
        if names[0] != names[1]:
            renamed.append(names)
    return Matching(tuple(pairs), tuple(renamed))


def pairs_by_name(first: RobotSide, second: RobotSide) -> Iterator[list[int]]:
    """Yield for each joint of the second side the joint of the first with its name; nothing if the names differ.

    Case and punctuation of the names do not matter; nor, in the pairs that are yielded last, a common prefix.
    """
    if not first.axes or not second.axes:
        return
    pairs_of_whole_names = _index_pairs(first.joint_names, second.joint_names)
    if pairs_of_whole_names is not None:
        yield pairs_of_whole_names
    pairs_of_bare_names = _index_pairs(_without_prefix(first.joint_names), _without_prefix(second.joint_names))
    if pairs_of_bare_names is not None:
        yield pairs_of_bare_names


def _index_pairs(of_first: Sequence[str], of_second: Sequence[str]) -> list[int] | None:
    """Return for each name of the second list the index of the same name in the first, by `plain_name`; or None.

    None if a name has no partner, or two: names that differ only in case or punctuation are the same.
    """
    names_of_first = list(map(plain_name, of_first))
    names_of_second = list(map(plain_name, of_second))
    index = dict(zip(names_of_first, range(len(names_of_first)), strict=True))
    is_unique = len(index) == len(of_first)
    if not is_unique or len(names_of_second) != len(index) or set(names_of_second) != index.keys():
        return None
    return [index[name] for name in names_of_second]


def _without_prefix(names: Sequence[str]) -> list[str]:
    """Return names without their common beginning, but with its digits: it is the name or the maker of the robot."""
    common = common_prefix(names).rstrip("0123456789")
    bare_names = []
    for name in names:
        bare_names.append(name.removeprefix(common))
    return bare_names


def pairs_by_links(first: RobotSide, second: RobotSide) -> list[int] | None:
    """Return for each joint of the second side that of the first with its name or, without one, between its links.

    Where two robots with loops are cut at different joints, each side may call the joint that closes a loop as it
    likes. Links are the same if bodies on them have the same name. None if a joint has no partner, or two.
    """
    if len(first.axes) != len(second.axes):
        return None
    links = _links_by_bodies(first, second)
    index_of_first = _indices_of_unique(first.joint_names)
    index_of_second = _indices_of_unique(second.joint_names)
    pairs: dict[int, int] = {}
    for name, j in index_of_second.items():
        if name in index_of_first:
            pairs[j] = index_of_first[name]
    unpaired = sorted(set(range(len(first.axes))) - set(pairs.values()))
    if not pairs or not unpaired:
        return None
    for j, axis in enumerate(second.axes):
        if j in pairs:
            continue
        ends = {links.get(axis.parent), links.get(axis.child)}
        candidates = []
        for i in unpaired:
            if _linked_groups(first, i) == ends:
                candidates.append(i)
        if len(candidates) != 1:
            return None
        i = candidates[0]
        partner = first.axes[i]
        # in a tree, a joint of another name is found by its place, or missing
        if partner.kind != axis.kind or not (axis.closes_loop or partner.closes_loop):
            return None
        pairs[j] = i
        unpaired.remove(i)
    return [pairs[j] for j in range(len(second.axes))]


def _linked_groups(side: RobotSide, i: int) -> set[int]:
    """Return the groups of links that a joint connects."""
    return {side.axes[i].parent, side.axes[i].child}


def _links_by_bodies(first: RobotSide, second: RobotSide) -> dict[int, int]:
    """Return {group of links of the second side: group of the first with bodies of the same names}."""
    group_of = {}
    for group, links in enumerate(first.groups):
        for body in links.bodies:
            group_of[plain_name(body)] = group
    partner_of_group = {0: 0}
    for group, links in enumerate(second.groups):
        partners = set()
        for body in links.bodies:
            if plain_name(body) in group_of:
                partners.add(group_of[plain_name(body)])
        if len(partners) == 1:  # bodies of two groups that are one link here say nothing about either
            partner_of_group[group] = partners.pop()
    return partner_of_group


def _indices_of_unique(names: Sequence[str]) -> dict[str, int]:
    """Return {plain name: its index} of the names that occur once."""
    count = Counter(map(plain_name, names))
    indices = {}
    for i, name in enumerate(names):
        if count[plain_name(name)] == 1:
            indices[plain_name(name)] = i
    return indices


def _pairs_of_loops(first: RobotSide, second: RobotSide) -> list[int] | None:
    """Return `pairs_by_links` of two robots with loops, if the joints are of the same kinds."""
    if not (first.has_loops and second.has_loops):
        return None
    pairs = pairs_by_links(first, second)
    if pairs is None or not _same_kinds(first, second, pairs):
        return None
    _require_same_tree(first, second, pairs)
    return pairs


def _pairs_of_names(first: RobotSide, second: RobotSide) -> list[int] | None:
    """Return the first of `pairs_by_name` with the same kinds of joints; None if there are none."""
    for pairs in pairs_by_name(first, second):
        if _same_kinds(first, second, pairs):
            _require_same_tree(first, second, pairs)
            return pairs
    return None


def _require_same_tree(first: RobotSide, second: RobotSide, pairs: Sequence[int]) -> None:
    """Raise an error if joints of the same names connect other links: their lines could coincide all the same.

    Each link must be one link of the other side, in both directions: where a loop is open, a link occurs twice.

    Raises:
        TwinError: it names the first such joint, and its links on both sides.
    """
    partner_of = {0: 0}  # group of links of the second side: group of the first side; the base is the base
    group_of_partner = {0: 0}  # the reverse
    for j, i in enumerate(pairs):
        axis_of_first = first.axes[i]
        axis_of_second = second.axes[j]
        for group, partner in (
            (axis_of_second.parent, axis_of_first.parent),
            (axis_of_second.child, axis_of_first.child),
        ):
            known_partner = partner_of.setdefault(group, partner)
            known_group = group_of_partner.setdefault(partner, group)
            if known_partner != partner or known_group != group:
                text = (
                    f"joint '{axis_of_first.name}' of {first.label} and joint '{axis_of_second.name}' of {second.label}"
                )
                way_out = "Correct the parent and the child of the joint, or its name, in one of the files."
                what = "the joints have another order, or a loop of one side is open in the other"
                raise TwinError(f"{text} connect different links: {what}. {way_out}")


def _same_kinds(first: RobotSide, second: RobotSide, pairs: Sequence[int]) -> bool:
    """Return whether the joints of all pairs are of the same type."""
    kinds_of_first = [first.axes[i].kind for i in pairs]
    kinds_of_second = [axis.kind for axis in second.axes]
    return kinds_of_first == kinds_of_second


def _pairs_of_structure(first: RobotSide, second: RobotSide) -> list[int]:
    """Return pairs of joints at the same places of two trees with the same shape and types.

    Raises:
        TwinError: the trees differ; the message names the joints without partner, and the way out.
    """
    if _tree_structure(first) == _tree_structure(second):
        return list(range(len(second.axes)))
    other_type = _type_mismatch_text(first, second)
    if other_type is not None:
        raise TwinError(other_type)
    raise TwinError(_mismatch_text(first, second))


def _type_mismatch_text(first: RobotSide, second: RobotSide) -> str | None:
    """Return the text of the error for joints with the same names and other types; None if there are none."""
    axis_of_name: dict[str, Axis] = {}
    for axis in first.axes:
        axis_of_name[plain_name(axis.name)] = axis
    parts = []
    for axis in second.axes:
        partner = axis_of_name.get(plain_name(axis.name))
        if partner is not None and partner.kind != axis.kind:
            text = f"joint '{partner.name}' is {partner.kind} in {first.label}, {axis.kind} in {second.label}"
            parts.append(text)
    if not parts:
        return None
    way_out = "Correct the type of the joint in one of the files, or leave it out with --only."
    return f"{'; '.join(parts)}. {way_out}"


def _tree_structure(side: RobotSide) -> list[tuple[str, int, int]]:
    """Return for each joint its type and the groups of links that it connects."""
    structure = []
    for axis in side.axes:
        # groups are numbered from the base outwards: equal numbers are equal places in the tree
        structure.append((axis.kind, axis.parent, axis.child))
    return structure


def _shared_names(side: RobotSide, other_side: RobotSide) -> tuple[list[str], list[str]]:
    """Return (names of the joints of a side that the other side also has, names that it does not have)."""
    names_of_other = set(map(plain_name, other_side.joint_names))
    shared = []
    alone = []
    for name in side.joint_names:
        if plain_name(name) in names_of_other:
            shared.append(name)
        else:
            alone.append(name)
    return shared, alone


def _mismatch_text(first: RobotSide, second: RobotSide) -> str:
    """Return the text of the error for sides whose joints do not match."""
    parts = []
    for side, other_side in ((first, second), (second, first)):
        _, alone = _shared_names(side, other_side)
        listed = ", ".join(alone) or "none"
        parts.append(f"{side.label} has {len(side.axes)} moving joints, without a joint of the same name: {listed}")
    common, _ = _shared_names(first, second)
    way_out = "Name the joints to compare with --only; all others are then held at zero"
    if common:
        way_out += f", for example --only {','.join(common)}"
    return f"the joints cannot be matched: {'; '.join(parts)}. {way_out}."
