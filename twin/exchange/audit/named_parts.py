"""The names of the parts that the files of an export have."""

from __future__ import annotations

from collections.abc import Sequence

from twin.exchange.audit.file_content import Content
from twin.exchange.format import Holds
from twin.exchange.formats import kind_holds


def named_parts(contents: Sequence[Content]) -> set[str]:
    """Return the names of links, joints, frames, points, motors, postures and motions in the files."""
    names: set[str] = set()
    for content in contents:
        names.update(content.rest)
        for clip in content.clips:
            names.add(clip.name)
            names.update(clip.joints)
        mechanism = content.mechanism
        if mechanism is None:
            continue
        names.update(
            mechanism.links, mechanism.frames, mechanism.points, mechanism.motors or (), mechanism.postures or ()
        )
        for joint in mechanism.joints:
            names.update(joint.names)
    return names


def has_all_names(contents: Sequence[Content]) -> bool:
    """Return whether a file is there that names all parts of a mechanism, as a USD stage does."""
    return any(content.mechanism is not None and kind_holds(content.format, Holds.ALL_NAMES) for content in contents)


def check_names(content: Content) -> None:
    """Report unusable names of links and joints: empty, with line breaks, or with spaces at the start or end."""
    joints = []
    if content.mechanism is not None:
        for joint in content.mechanism.joints:
            joints += joint.names
    _check_names_of(content, "link", content.declared or ())
    _check_names_of(content, "joint", joints)


def _check_names_of(content: Content, kind: str, names: Sequence[str]) -> None:
    for name in dict.fromkeys(names):
        if name and name == name.strip() and name.isprintable():
            continue
        trouble = "has a line break, a control character, or a space at its start or end"
        if not name.strip():
            trouble = "is empty"
        text = f"the name {name!r} of a {kind} {trouble}."
        content.ledger.wrong(f"{content.format}.name", text, repr(name))
