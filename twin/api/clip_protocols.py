"""Find the protocols that the clips of exported files play."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence


def played_protocols(clips: Iterable[str], protocols: Sequence[str]) -> list[str]:
    """Return the names of the protocols that clips play, in the order of `protocols`."""
    played = {protocol_of_clip(clip, protocols) for clip in clips}
    return [name for name in protocols if name in played]


def clip_of_no_protocol(clip_formats: Mapping[str, Collection[str]], protocols: Sequence[str], robot: str) -> str:
    """Return the name of a clip that plays a protocol of its own, one that the robot does not have; "" if none does.

    A clip of another name in some of the formats only is no such clip, but one that was renamed there: an export plays
    each protocol in every format that has motion. Nor is a clip with the name of its file, <robot>_<name>: that of the
    first file for AR (<robot>_ar; another file plays its protocol too), or that of a stage which should be at rest.

    Args:
        clip_formats: {clip: names of the formats whose files play it}.
        protocols: names of the protocols of the robot.
        robot: name of the robot.
    """
    formats_with_motion: set[str] = set()
    for clip, formats in clip_formats.items():
        if clip in protocols:
            formats_with_motion.update(formats)
    for clip, formats in clip_formats.items():
        if protocol_of_clip(clip, protocols) is not None or clip.startswith(f"{robot}_"):
            continue
        if formats_with_motion <= set(formats):
            return clip
    return ""


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
