"""What the files of an export state of their origin, and what the caller of an audit makes from it: the new export."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

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
        clip_formats: {name of a motion: names of the formats whose files play it}.
    """

    robots: frozenset[str]
    model_hashes: frozenset[str]
    rests: tuple[Mapping[str, Array], ...]
    key_counts: Mapping[str, frozenset[int]]
    clip_formats: Mapping[str, frozenset[str]]

    def reason_of_other_keys(self, clip: str, key_count: int) -> str:
        """Return why the files are not compared with an export that has so many keys of a motion; "" if they are.

        Files that were made with another budget of errors have other keys.
        """
        counts = self.key_counts.get(clip)
        if counts is None or key_count in counts:
            return ""
        found = " or ".join(str(count) for count in sorted(counts))
        return f"clip '{clip}' has {found} keys; with the present budget of errors it has {key_count}"


@dataclass(frozen=True)
class NewExport:
    """The new export of what files state, or why there is none.

    Attributes:
        folder: its folder; None: the files are not compared.
        reason: why not, as the rest of the sentence "the files are not compared with a new export: "; "" if the files
            are no export of a robot of twin, so that nobody expects the comparison.
    """

    folder: Path | None
    reason: str = ""


def export_statement(contents: Sequence[Content]) -> ExportStatement:
    """Return what files state of the export that wrote them."""
    robots = set()
    key_counts: dict[str, set[int]] = {}
    clip_formats: dict[str, set[str]] = {}
    for content in contents:
        if content.stated.get(ROBOT):
            robots.add(str(content.stated[ROBOT]))
        for clip in content.clips:
            if clip.name != CLIP:
                key_counts.setdefault(clip.name, set()).add(len(clip.times))
                clip_formats.setdefault(clip.name, set()).add(content.format)
    return ExportStatement(
        robots=frozenset(robots),
        model_hashes=frozenset(content.model_hash for content in contents if content.model_hash),
        rests=tuple(content.rest for content in contents if content.rest),
        key_counts={name: frozenset(counts) for name, counts in key_counts.items()},
        clip_formats={name: frozenset(formats) for name, formats in clip_formats.items()},
    )
