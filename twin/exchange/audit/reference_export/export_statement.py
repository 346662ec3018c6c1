"""What the files of an export state of their origin: from it, the caller of an audit makes the new export."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.poses import Array
from twin.exchange.audit.sampled_states import CLIP


@dataclass(frozen=True)
class ExportStatement:
    """What the files of an export state of their origin.

    Attributes:
        robots: names of the robots that the files state.
        model_hashes: hashes of the mechanism that the files state.
        rests: {link: T_world_link (4, 4) at rest} of each file that has a rest pose.
        key_counts: {name of a motion: numbers of its keys in the files}.
    """

    robots: frozenset[str]
    model_hashes: frozenset[str]
    rests: tuple[Mapping[str, Array], ...]
    key_counts: Mapping[str, frozenset[int]]


def export_statement(contents: Sequence[Content]) -> ExportStatement:
    """Return what files state of the export that wrote them."""
    robots = set()
    key_counts: dict[str, set[int]] = {}
    for content in contents:
        if content.stated.get(ROBOT):
            robots.add(str(content.stated[ROBOT]))
        for clip in content.clips:
            if clip.name != CLIP:
                key_counts.setdefault(clip.name, set()).add(len(clip.times))
    return ExportStatement(
        robots=frozenset(robots),
        model_hashes=frozenset(content.model_hash for content in contents if content.model_hash),
        rests=tuple(content.rest for content in contents if content.rest),
        key_counts={name: frozenset(counts) for name, counts in key_counts.items()},
    )
