"""The reference clip of each motion, and which clip of a file is which of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.ledger import MECHANISM
from twin.exchange.audit.poses import Array
from twin.exchange.format import Holds
from twin.exchange.formats import kind_holds, rank


@dataclass(frozen=True)
class Reference:
    """A reference clip, and its source: "the mechanism" or the name of a file."""

    clip: FileClip
    source: str


def references(
    contents: Sequence[Content], truth: Mapping[str, tuple[Array, Mapping[str, Array]]]
) -> dict[str, Reference]:
    """Return {clip name: `Reference`}.

    The reference for a clip is `truth` if it contains the clip, else the clip's track, else the first file with it. If
    there are tracks, other files are references only for the motions of tracks that cannot be used. A .usdz is a
    reference only if no other file has a motion.
    """
    refs = {}
    for name, (times, links) in truth.items():
        refs[name] = Reference(FileClip(name, np.asarray(times, float), links), MECHANISM)
    tracks = []
    for content in contents:
        if content.is_track:
            tracks.append(content)
    unusable: list[str] = []
    for track in tracks:
        if not track.clips:
            unusable.append(str(track.facts.get("protocol")))
    # A stage does not state the name of its clip, which is then that of the file: <robot>_<clip>. The other files do.
    stated_names: dict[str, None] = {}
    repeating_files = set()
    for content in contents:
        if not is_unnamed(content):
            for clip in content.clips:
                stated_names[clip.name] = None
        if kind_holds(content.format, Holds.REPEATED_MOTION):
            repeating_files.add(content.file)
    stated_names |= dict.fromkeys(unusable)
    # By rank, so that the reference does not depend on the names of the files.
    for content in sorted(contents, key=lambda c: rank(c.format)):
        sources = {ref.source for ref in refs.values()}
        if content.file in repeating_files and sources - repeating_files:
            continue  # <robot>_ar.usdz has the motion of another file, which `counterpart` finds
        for clip in content.clips:
            name = clip.name
            if is_unnamed(content):
                name = _clip_in_name(clip.name, refs) or _clip_in_name(clip.name, stated_names) or clip.name
            if tracks and not content.is_track and name not in unusable:
                continue
            refs.setdefault(name, Reference(clip, content.file))
    return refs


def is_unnamed(content: Content) -> bool:
    """Return whether the motion of a file has the name of the file."""
    return kind_holds(content.format, Holds.UNNAMED_MOTION)


def _clip_in_name(name: str, clip_names: Mapping[str, object]) -> str | None:
    """Return the known clip in the name of a stage, <robot>_<clip> or <robot>_<clip>_ar; None if no clip matches."""
    stem = name.removesuffix("_ar")
    longest: str | None = None
    for clip in clip_names:
        fits = stem == clip or stem.endswith(f"_{clip}")
        if clip and fits and (longest is None or len(clip) > len(longest)):
            longest = clip
    return longest


def clip_prefixes(contents: Sequence[Content], refs: Mapping[str, Reference]) -> frozenset[str]:
    """Return the parts before the name of the clip in the names of stages, such as <robot>_ in <robot>_<clip>."""
    prefixes = set()
    for content in contents:
        if not is_unnamed(content):
            continue
        for clip in content.clips:
            name = _clip_in_name(clip.name, refs)
            if name is not None:
                prefixes.add(clip.name.removesuffix("_ar").removesuffix(name))
    return frozenset(prefixes - {""})


def counterpart(
    content: Content, clip: FileClip, refs: Mapping[str, Reference], prefixes: Collection[str]
) -> str | None:
    """Return the name of the reference clip for a clip; None if the clip has a name of its own, or nothing is alike."""
    if clip.name in refs:
        return clip.name
    if not is_unnamed(content):
        return None
    name = _clip_in_name(clip.name, refs)
    if name is not None:
        return name
    if clip.name.removesuffix("_ar").startswith(tuple(prefixes)):
        return None
    # The file does not state the name of its clip: choose the clip with the most similar first and last poses.
    scores = {}
    for name, ref in refs.items():
        score = _difference_score(clip, ref.clip)
        if score is not None:
            scores[name] = score
    if not scores:
        return None
    return min(scores, key=lambda n: scores[n])


def _difference_score(clip: FileClip, ref: FileClip) -> float | None:
    """Return how different two clips are: their durations, and the poses at their ends; None without common links."""
    differences = []
    for name in ref.links:
        if name in clip.links:
            for key in (0, -1):
                difference = np.abs(clip.links[name][key] - ref.links[name][key])
                differences.append(difference.max())
    if not differences:
        return None
    return float(abs(clip.duration - ref.duration) + max(differences))
