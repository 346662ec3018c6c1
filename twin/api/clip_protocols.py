"""Find the protocol that a clip of an exported file plays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def protocols_of_clips(clips: Iterable[str], protocols: Sequence[str], robot: str) -> list[str] | None:
    """Return the names of the protocols that clips play, in the order of `protocols`; None if a clip plays none.

    A clip that has the name of its file, <robot>_<name>, is passed over if it plays none: that of the first file for AR
    (<robot>_ar; another file plays its protocol too), or that of a stage which should be at rest.
    """
    played = set()
    for clip in clips:
        protocol = protocol_of_clip(clip, protocols)
        if protocol is not None:
            played.add(protocol)
        elif not clip.startswith(f"{robot}_"):
            return None
    return [name for name in protocols if name in played]


def protocol_of_clip(clip: str, protocols: Sequence[str]) -> str | None:
    """Return the name of the protocol that a clip plays; None if there is none.

    The name of a clip is that of its protocol. A clip without a name has that of its file: <robot>_<protocol>, or
    <robot>_<protocol>_ar.
    """
    name_of_clip = clip.removesuffix("_ar")
    matching_names = []
    for name in protocols:
        if clip == name or name_of_clip.endswith(f"_{name}"):
            matching_names.append(name)
    if not matching_names:
        return None
    # the name of one protocol can be the end of another's
    return max(matching_names, key=len)
