"""What a reader of one file knows about the other files of an audit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.sampled_states import SampledStates
from twin.exchange.audit.state_comparison import same_names
from twin.exchange.xacro import XacroSettings


@dataclass
class Context:
    """What a reader may use beside its file.

    Attributes:
        tracks: the tracks, which are read before files of all other formats.
        models: names, without suffix, of all files of the reader's format.
        states: returns states of the expected mechanism over its whole range; None: there is no expected mechanism.
        xacro: how a xacro is expanded.
        admitted: files that the parser in another process has already read.
    """

    tracks: list[Content] = field(default_factory=list)
    models: Sequence[str] = ()
    states: Callable[[], SampledStates] | None = None
    admitted: Collection[Path] = ()
    xacro: XacroSettings = field(default_factory=XacroSettings)


class JointTree(Protocol):
    """A file that gives the poses of links for joint values."""

    @property
    def content(self) -> Content:
        """The content of the file."""
        ...

    def play(self, clip: FileClip) -> FileClip:
        """Return the motion of the links for the joint values of a clip."""
        ...

    def check_limits(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> None:
        """Compare the limits of the joints with those of the file `name`, in rad or m."""
        ...


def _is_model_of_clip(stem: str, clip: str, models: Sequence[str]) -> bool:
    """Return whether the joint values of a clip are applied to a model file (MJCF or URDF) with the name `stem`.

    A model named <robot>_<clip> is used only for the clip <clip>, and the clip uses no other model. If a clip has no
    model of its own, the models without a clip in their names are used.
    """
    models_of_clip = set()
    prefixes = []
    for model in models:
        prefixes.append(f"{model}_")
        if f"{model}_{clip}" in models:
            models_of_clip.add(f"{model}_{clip}")
    if models_of_clip:
        return stem in models_of_clip
    # <robot>_<other clip> has the trocars of another protocol: only the robot's own model plays this clip
    return not stem.startswith(tuple(prefixes))


def played(tree: JointTree, path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a file with its link poses for the joint values of every track.

    A model can be valid for a single clip, because each clip can have different trocar positions. Without a track, the
    link poses are computed for the sampled states of the mechanism.
    """
    for track in context.tracks:
        for clip in track.clips:
            if _is_model_of_clip(path.stem, clip.name, context.models):
                tree.content.clips.append(tree.play(clip))
        low = track.extra.get("lower", {})
        high = track.extra.get("upper", {})
        tree.check_limits(track.file, low, high)
    states = context.states
    if not tree.content.clips and states is not None and same_names(tree.content.rest, states().links):
        tree.content.clips.append(tree.play(states().clip()))
    elif not context.tracks:
        text = "there is no track with joint values, so this file's link poses along the motions are not checked."
        ledger.add("compare.no_track", "info", text)
    return tree.content
