"""Compare files: poses of every link at every key, joint values, rest poses, shapes, clips and model hashes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.exchange.audit.file_content import Content, FileClip, LinkShape, largest
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.interpolation_error import midway
from twin.exchange.audit.pose_mistakes import mistake_behind
from twin.exchange.audit.poses import Array, angle
from twin.exchange.audit.report import (
    MECHANISM,
    POSITION_TOL,
    ROTATION_TOL,
    Ledger,
    Measured,
    distinguishable,
    quantity,
    um,
)
from twin.exchange.audit.sampled_states import CLIP
from twin.exchange.format import Holds
from twin.exchange.formats import family, kind_holds, motion_groups, rank

TIME_TOL = 1e-5
"""Maximum difference in s between the times of the same key in two files; glTF stores times in single precision."""

BETWEEN_TOL = 1e-5
"""Maximum error in m of a position halfway between two keys. For rotations, the maximum is `ROTATION_TOL`."""

BOX_TOL = 2e-5
"""Maximum difference in m between the bounding boxes of one link's meshes in two files."""


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
        if not _is_unnamed(content):
            for clip in content.clips:
                stated_names[clip.name] = None
        if kind_holds(content.format, Holds.REPEATED_MOTION):
            repeating_files.add(content.file)
    stated_names |= dict.fromkeys(unusable)
    # By rank, so that the reference does not depend on the names of the files.
    for content in sorted(contents, key=lambda c: rank(c.format)):
        sources = {ref.source for ref in refs.values()}
        if content.file in repeating_files and sources - repeating_files:
            continue  # <robot>_ar.usdz has the motion of another file, which `_counterpart` finds
        for clip in content.clips:
            name = clip.name
            if _is_unnamed(content):
                name = _clip_in_name(clip.name, refs) or _clip_in_name(clip.name, stated_names) or clip.name
            if tracks and not content.is_track and name not in unusable:
                continue
            refs.setdefault(name, Reference(clip, content.file))
    return refs


def _is_unnamed(content: Content) -> bool:
    """Return whether the motion of a file has the name of the file."""
    return kind_holds(content.format, Holds.UNNAMED_MOTION)


def compare_clips(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Compare the clips of each file with the references, and report differences in the file's ledger."""
    compared: dict[str, list[_ClipComparison]] = {}
    prefixes = _prefixes(contents, refs)
    for content in contents:
        for clip in content.clips:
            name = _counterpart(content, clip, refs, prefixes)
            if name is None:
                if len(contents) > 1 and refs:
                    known_clips = ", ".join(sorted(refs))
                    text = f"clip '{clip.name}' is in no other file; the known clips are {known_clips}."
                    # A file that states its robot has the motions of the tracks beside it, and no others.
                    severity = "warning"
                    if ROBOT in content.stated and any(other.is_track for other in contents):
                        severity = "disagreement"
                    content.ledger.add("compare.clip", severity, text, clip.name)
                continue
            ref = refs[name]
            if ref.source == content.file:
                continue
            findings_before = len(content.ledger.found)
            _compare_clip(content, clip, ref, name)
            agrees = len(content.ledger.found) == findings_before
            compared.setdefault(name, []).append(_ClipComparison(content, clip, agrees))
    _report_odd_references(contents, refs, compared)
    _check_missing(contents, refs)
    _check_silent(contents, refs)


@dataclass(frozen=True)
class _ClipComparison:
    """A clip of a file, and whether it agrees with its reference."""

    content: Content
    clip: FileClip
    agrees: bool


def _clip_in_name(name: str, clip_names: Mapping[str, object]) -> str | None:
    """Return the known clip in the name of a stage, <robot>_<clip> or <robot>_<clip>_ar; None if no clip matches."""
    stem = name.removesuffix("_ar")
    longest: str | None = None
    for clip in clip_names:
        fits = stem == clip or stem.endswith(f"_{clip}")
        if clip and fits and (longest is None or len(clip) > len(longest)):
            longest = clip
    return longest


def _prefixes(contents: Sequence[Content], refs: Mapping[str, Reference]) -> frozenset[str]:
    """Return the parts before the name of the clip in the names of stages, such as <robot>_ in <robot>_<clip>."""
    prefixes = set()
    for content in contents:
        if not _is_unnamed(content):
            continue
        for clip in content.clips:
            name = _clip_in_name(clip.name, refs)
            if name is not None:
                prefixes.add(clip.name.removesuffix("_ar").removesuffix(name))
    return frozenset(prefixes - {""})


def _counterpart(
    content: Content, clip: FileClip, refs: Mapping[str, Reference], prefixes: Collection[str]
) -> str | None:
    """Return the name of the reference clip for a clip; None if the clip has a name of its own, or nothing is alike."""
    if clip.name in refs:
        return clip.name
    if not _is_unnamed(content):
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


def _compare_clip(content: Content, clip: FileClip, ref: Reference, name: str) -> None:
    """Compare key times, names of links, poses and joint values of a clip with its reference."""
    clip_keys, ref_keys = _compare_times(content.ledger, clip, ref, name)
    _compare_names(content, clip, ref, name)
    shared = []
    for link in ref.clip.links:
        if link in clip.links:
            shared.append(link)
    if not shared or not len(clip_keys):
        return
    _compare_poses(content, clip, ref, name, clip_keys, ref_keys)
    _compare_joints(content, clip, ref, name, clip_keys, ref_keys)
    if clip.middle and len(clip_keys) == len(clip.times) == len(ref.clip.times):
        _compare_middle(content, clip, ref, name)


def _compare_times(ledger: Ledger, clip: FileClip, ref: Reference, name: str) -> tuple[Array, Array]:
    """Compare the key times; return the indices of the keys of both clips at which their poses are compared."""
    times = clip.times
    expected = ref.clip.times
    clip_keys, ref_keys = _common_keys(times, expected)
    longer = max(len(times), len(expected))
    if len(clip_keys) < longer:
        message = f"clip '{name}': {_times_text(clip, ref, clip_keys, ref_keys)}."
        ledger.wrong("compare.times", message, name, size=Measured(float(len(clip_keys)), float(longer)))
    if len(clip_keys):
        differences = np.abs(times[clip_keys] - expected[ref_keys])
        worst_key = int(np.argmax(differences))
        check = f"clip '{name}': key times against {ref.source}"
        when = _time_text(times[clip_keys][worst_key])
        ledger.row(check, float(differences[worst_key]), "s", TIME_TOL, when=when, against=ref.source)
    shifted = len(times) == len(expected) and len(clip_keys) < len(ref_keys)
    if shifted or len(clip_keys) < 2 < len(times):  # times differ: compare key by key
        clip_keys = np.arange(min(len(times), len(expected)))
        ref_keys = clip_keys
    return clip_keys, ref_keys


def _compare_names(content: Content, clip: FileClip, ref: Reference, name: str) -> None:
    """Report links that only the clip, or only its reference has."""
    for link in ref.clip.links:
        if link not in clip.links:
            content.ledger.wrong("compare.missing_link", f"clip '{name}': link '{link}' is missing.", link)
    for link in content.declared or ():
        if link not in ref.clip.links:
            content.ledger.wrong("compare.extra_link", f"clip '{name}': link '{link}' is not in {ref.source}.", link)


def _compare_poses(
    content: Content, clip: FileClip, ref: Reference, name: str, clip_keys: Array, ref_keys: Array
) -> None:
    """Compare the poses of the links at the common keys, and report the links that differ.

    Links at which a deviation begins are first, then the farthest.
    """
    ledger = content.ledger
    clip_poses = {}
    ref_poses = {}
    differences = {}
    for link, T in ref.clip.links.items():
        if link in clip.links:
            clip_poses[link] = clip.links[link][clip_keys]
            ref_poses[link] = np.asarray(T)[ref_keys]
            differences[link] = largest(clip_poses[link], ref_poses[link])
    times = clip.times[clip_keys]
    farthest = max(differences, key=lambda n: differences[n].distance)
    turned = max(differences, key=lambda n: differences[n].angle)
    count = f"{len(differences)} links x {len(clip_keys)} keys"
    distance = differences[farthest]
    angle = differences[turned]
    check = f"clip '{name}': position against {ref.source}, {count}"
    when = _time_text(times[distance.distance_key])
    ledger.row(check, distance.distance, "m", POSITION_TOL, where=farthest, when=when, against=ref.source)
    check = f"clip '{name}': rotation against {ref.source}, {count}"
    when = _time_text(times[angle.angle_key])
    ledger.row(check, angle.angle, "rad", ROTATION_TOL, where=turned, when=when, against=ref.source)
    ledger.placed |= ref.source == MECHANISM
    wrong = []
    for link, difference in differences.items():
        if not (difference.distance <= POSITION_TOL and difference.angle <= ROTATION_TOL):
            wrong.append(link)
    if not wrong:
        return
    reason = mistake_behind(clip_poses, ref_poses)
    beginnings = _beginnings(content, wrong, differences) if len(wrong) > 1 else {}
    wrong.sort(key=lambda n: (n not in beginnings, -differences[n].distance))
    for link in wrong:
        difference = differences[link]
        degrees = float(np.degrees(difference.angle))
        message = (
            f"clip '{name}': link '{link}' differs by {quantity(difference.distance, 'm')} and {degrees:.4g} deg from "
            f"{ref.source}"
        )
        message += f": {reason}." if reason else "."
        if link in beginnings:
            message += f" The deviation begins here, at {beginnings[link]}."
        # A position is reported before a rotation; one that is not finite compares as smaller than any tolerance.
        if difference.distance > POSITION_TOL or not np.isfinite(difference.distance):
            size = um(difference.distance, POSITION_TOL)
            key = difference.distance_key
        else:
            size = Measured(degrees, float(np.degrees(ROTATION_TOL)), "deg")
            key = difference.angle_key
        ledger.wrong("compare.pose", message, link, size=size, when=_time_text(times[key]))


def _beginnings(content: Content, wrong: Collection[str], compared: Collection[str]) -> dict[str, str]:
    """Return {link: its joints as text} of the wrong links whose next link towards the root agrees.

    Only poses that are computed from joints have such links: each link carries the deviations of those before it.
    """
    if content.mechanism is None or not kind_holds(content.format, Holds.JOINT_TREE):
        return {}
    above: dict[str, FileJoint] = {}
    for joint in content.mechanism.joints:
        if joint.parent and joint.names and not joint.tied:  # ties close loops
            above.setdefault(joint.child, joint)
    beginnings: dict[str, str] = {}
    for link in wrong:
        joint_names: list[str] = []
        ancestor = link
        # The count of names ends the walk in a file whose joints form a cycle.
        while ancestor in above and len(joint_names) <= len(above):
            joint = above[ancestor]
            joint_names.extend(joint.names)
            ancestor = joint.parent
            if ancestor in compared:
                break
        if joint_names and ancestor in compared and ancestor not in wrong:
            listed = ", ".join(f"'{joint_name}'" for joint_name in reversed(joint_names))
            beginnings[link] = f"{'joints' if len(joint_names) > 1 else 'joint'} {listed}"
    return beginnings


def _times_text(clip: FileClip, ref: Reference, clip_keys: Array, ref_keys: Array) -> str:
    """Return a message that states the durations if they differ, else the keys that only one of the clips has."""
    expected = ref.clip
    if abs(clip.duration - expected.duration) > TIME_TOL:
        ratio = float("nan")
        if expected.duration:
            ratio = clip.duration / expected.duration
        duration, expected_duration = distinguishable(clip.duration, expected.duration)
        return (
            f"the clip lasts {duration} s; in {ref.source} it lasts {expected_duration} s (ratio {ratio:.6g}); "
            f"{len(clip_keys)} of the {len(clip.times)} key times are also in {ref.source}, which has "
            f"{len(expected.times)} key times"
        )
    parts = []
    lacking = np.delete(expected.times, ref_keys)
    if len(lacking):
        parts.append(f"keys of {ref.source} missing in this clip: {_keys_text(lacking)}")
    surplus = np.delete(clip.times, clip_keys)
    if len(surplus):
        parts.append(f"keys missing in {ref.source}: {_keys_text(surplus)}")
    return "; ".join(parts) + f" (both last {clip.duration:.6g} s)"


def _keys_text(times: Array) -> str:
    if len(times) == 1:
        return f"one key, at {times[0]:.6g} s"
    return f"{len(times)} keys, the first at {times[0]:.6g} s"


def _compare_middle(content: Content, clip: FileClip, ref: Reference, name: str) -> None:
    """Report links whose poses halfway between keys differ from the linearly interpolated poses of the reference."""
    differences = {}
    for link, T in ref.clip.links.items():
        if link in clip.middle:
            keys = np.asarray(T)
            differences[link] = largest(clip.middle[link], midway(keys[:-1], keys[1:]))
    if not differences:
        return
    ledger = content.ledger
    beginning = f"clip '{name}': halfway between two keys, the"
    ending = f"from the linear interpolation of {ref.source}."

    link = max(differences, key=lambda n: differences[n].distance)
    distance = differences[link].distance
    check = f"clip '{name}': position halfway between keys against {ref.source}"
    ledger.row(check, distance, "m", BETWEEN_TOL, where=link, against=ref.source)
    if not distance <= BETWEEN_TOL:
        text = f"{beginning} position of link '{link}' differs by {quantity(distance, 'm')} {ending}"
        when = _time_text(float(clip.times[differences[link].distance_key]))
        ledger.wrong("compare.between", text, link, size=um(distance, BETWEEN_TOL), when=when)

    link = max(differences, key=lambda n: differences[n].angle)
    angle = differences[link].angle
    check = f"clip '{name}': rotation halfway between keys against {ref.source}"
    ledger.row(check, angle, "rad", ROTATION_TOL, where=link, against=ref.source)
    if not angle <= ROTATION_TOL:
        degrees = np.degrees(angle)
        text = f"{beginning} rotation of link '{link}' differs by {degrees:.4g} deg {ending}"
        size = Measured(degrees, np.degrees(ROTATION_TOL), "deg")
        when = _time_text(float(clip.times[differences[link].angle_key]))
        ledger.wrong("compare.between", text, link, size=size, when=when)


def _compare_joints(
    content: Content, clip: FileClip, ref: Reference, name: str, clip_keys: Array, ref_keys: Array
) -> None:
    """Compare the joint values at the common keys (`clip_keys`, `ref_keys`) of a clip and its reference."""
    times = clip.times[clip_keys]
    worst = 0.0
    where = ""
    when = ""
    count = 0
    for joint, values in ref.clip.joints.items():
        if joint not in clip.joints:
            continue
        count += 1
        clip_values = clip.joints[joint][clip_keys]
        ref_values = values[ref_keys]
        differences = np.abs(clip_values - ref_values)
        worst_key = int(np.argmax(differences))
        # Values of slides in files with few digits are rounded relative to their size.
        tolerance = max(ROTATION_TOL, 1e-6 * float(np.abs(values).max(initial=0.0)))
        if differences[worst_key] >= worst:
            worst = float(differences[worst_key])
            where = joint
            when = _time_text(times[worst_key])
        if not differences[worst_key] <= tolerance:
            value = float(clip_values[worst_key])
            ref_value = float(ref_values[worst_key])
            hint = _hint_of_degrees(value, ref_value)
            message = f"clip '{name}': joint '{joint}' is {value:.6g}; in {ref.source} it is {ref_value:.6g}.{hint}"
            size = Measured(differences[worst_key], tolerance)
            content.ledger.wrong("compare.joint", message, joint, size=size, when=_time_text(times[worst_key]))
    if not count:
        return
    text = f"clip '{name}': joint values against {ref.source}, {count} joints"
    content.ledger.row(text, worst, "rad or m", ROTATION_TOL, where=where, when=when, against=ref.source)


def _hint_of_degrees(value: float, expected: float) -> str:
    """Return a sentence if one of two values is the other in degrees, else ""."""
    if not expected:
        return ""
    ratio = value / expected
    to_degrees = abs(ratio * np.pi / 180 - 1)
    to_radians = abs(ratio * 180 / np.pi - 1)
    if min(to_degrees, to_radians) < 1e-3:
        return " The ratio suggests degrees instead of radians, or the reverse."
    return ""


def _common_keys(times: Array, other_times: Array) -> tuple[Array, Array]:
    """Return the indices (i, j) of the equal times in two increasing time arrays (k,) and (l,)."""
    if len(times) == len(other_times) and np.all(np.abs(times - other_times) <= TIME_TOL):
        every = np.arange(len(times))
        return every, every
    nearest = np.zeros(len(times), int)
    if len(other_times) > 1:
        after = np.clip(np.searchsorted(other_times, times), 1, len(other_times) - 1)
        before = after - 1
        nearest = np.where(np.abs(other_times[before] - times) < np.abs(other_times[after] - times), before, after)
    equal = np.abs(other_times[nearest] - times) <= TIME_TOL
    return np.flatnonzero(equal), nearest[equal]


def _report_odd_references(
    contents: Sequence[Content], refs: Mapping[str, Reference], compared: Mapping[str, Sequence[_ClipComparison]]
) -> None:
    """Report the reference file as wrong if all other files differ from the reference, but agree with each other."""
    sources: dict[str, Content] = {}
    for content in contents:
        sources[content.file] = content
    for name, rows in compared.items():
        ref = refs[name]
        # Tracks are not counted: the JSON and the CSV track of a motion are written from the same numbers.
        wrong: list[_ClipComparison] = []
        counted = 0
        for row in rows:
            if not row.agrees and not kind_holds(row.content.format, Holds.COORDINATES):
                wrong.append(row)
            if not row.content.repeats_track:
                counted += 1
        if ref.source not in sources or len(wrong) < 2 or len(wrong) < counted:
            continue
        first, *others = wrong
        shared = []
        for link in first.clip.links:
            if link in ref.clip.links:
                shared.append(link)
        alike = []
        for row in others:
            if _same_motion(row.clip, first.clip, shared):
                alike.append(row.content.file)
        if shared and len(alike) == len(others):
            files = ", ".join(alike)
            text = (
                f"clip '{name}': {first.content.file} and {files} agree with each other, and "
                "all differ from this file, so this file is wrong."
            )
            sources[ref.source].ledger.wrong("compare.odd_one_out", text, name)


def _same_motion(clip: FileClip, other: FileClip, links: Sequence[str]) -> bool:
    """Return whether two clips have as many keys, and the same poses of some links."""
    if len(clip.times) != len(other.times):
        return False
    for link in links:
        if link not in clip.links:
            return False
        if not _poses_agree(clip.links[link], other.links[link]):
            return False
    return True


def _poses_agree(A: Array, B: Array) -> bool:
    """Return whether poses agree; twice the tolerances, because both may differ from a third file."""
    difference = largest(A, B)
    return difference.distance <= 2 * POSITION_TOL and difference.angle <= 2 * ROTATION_TOL


def _check_silent(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Report glTF files without clips if another file has a clip in which a link moves.

    Drawn states are no clip of the export.
    """
    name = _first_moving_clip(refs)
    if name is None:
        return
    for content in contents:
        if kind_holds(content.format, Holds.ALL_MOTIONS) and content.declared and not content.clips:
            text = f"the file has no motion; {refs[name].source} has the motion '{name}'."
            # A file that states its robot, as those of twin do, has the motions of its tracks.
            severity = "disagreement" if ROBOT in content.stated else "warning"
            content.ledger.add("compare.no_motion", severity, text, "animations")


def _first_moving_clip(refs: Mapping[str, Reference]) -> str | None:
    """Return the name of the first clip in which a link moves; None without one, and for drawn states."""
    for name, ref in refs.items():
        if name != CLIP and _has_motion(ref.clip):
            return name
    return None


def _has_motion(clip: FileClip) -> bool:
    for T in clip.links.values():
        first = T[:1]
        if not _poses_agree(T, first):
            return True
    return False


def _check_missing(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Report each clip that a glTF file lacks, and each clip that all USD stages, JSON tracks or CSV tracks lack.

    Drawn states are no clip of the export: files with a motion of their own do not lack them.
    """
    expected = set(refs) - {CLIP}
    for content in contents:
        if kind_holds(content.format, Holds.ALL_MOTIONS) and content.clips and content.declared:
            own_clips = {clip.name for clip in content.clips}
            for name in sorted(expected - own_clips):
                text = f"clip '{name}' of {refs[name].source} is missing."
                content.ledger.wrong("compare.missing_clip", text, name)
    prefixes = _prefixes(contents, refs)
    for kinds in motion_groups():
        playing: Content | None = None
        present: set[str | None] = set()
        for content in contents:
            if content.format not in kinds:
                continue
            if not content.clips:  # a track with faults has no clip, but it is there, and its faults were reported
                present.add(str(content.facts.get("protocol")))
                continue
            for clip in content.clips:
                present.add(_counterpart(content, clip, refs, prefixes))
            if playing is None:
                playing = content
        missing = sorted(expected - present)
        if playing is not None and missing:
            first = missing[0]
            text = f"no file of this format contains clip '{first}' of {refs[first].source}."
            playing.ledger.wrong("compare.missing_clip", text, first)


def compare_rest(contents: Sequence[Content]) -> None:
    """Compare the rest poses of files, and report differences in each file's ledger."""
    contents_at_rest = []
    for content in contents:
        # The links of a file with one motion may be at its start.
        is_at_start = content.clips and kind_holds(content.format, Holds.ONE_MOTION)
        if content.rest and content.declared and kind_holds(content.format, Holds.REST) and not is_at_start:
            contents_at_rest.append(content)
    contents_at_rest.sort(key=lambda c: rank(c.format))
    for content in contents_at_rest[1:]:
        _compare_rest_with(content, contents_at_rest[0])


def _compare_rest_with(content: Content, first: Content) -> None:
    """Compare the rest poses of a file with those of the first file, and report differences."""
    distances = {}
    angles = {}
    for link, T in first.rest.items():
        if link in content.rest:
            own_pose = content.rest[link]
            distances[link] = float(np.linalg.norm(own_pose[:3, 3] - T[:3, 3]))
            angles[link] = float(angle(own_pose[:3, :3], T[:3, :3]))
    if not distances:
        return
    ledger = content.ledger
    farthest = max(distances, key=lambda n: distances[n])
    turned = max(angles, key=lambda n: angles[n])
    distance = distances[farthest]
    turn = angles[turned]
    against = first.file
    ledger.row(f"rest: position against {against}", distance, "m", POSITION_TOL, where=farthest, against=against)
    ledger.row(f"rest: rotation against {against}", turn, "rad", ROTATION_TOL, where=turned, against=against)
    if not (distance > POSITION_TOL or turn > ROTATION_TOL):
        return
    clip = first_pose_of(content)
    if clip:
        text = f"the rest pose is the first pose of clip '{clip}'; it differs from the rest pose of {against}."
        ledger.add("compare.rest", "info", text, clip)
        return
    text = (
        f"rest poses differ from {against}, most in position at link '{farthest}' ({quantity(distance, 'm')}), "
        f"most in rotation at link '{turned}' ({np.degrees(turn):.4g} deg)."
    )
    ledger.wrong("compare.rest", text, farthest, size=um(distance))


def first_pose_of(content: Content) -> str:
    """Return the clip whose first poses equal the file's rest poses (as in Blender files); "" if no clip does."""
    for clip in content.clips:
        if _begins_with(clip, content.rest):
            return clip.name
    return ""


def _begins_with(clip: FileClip, rest_poses: Mapping[str, Array]) -> bool:
    """Return whether the first poses of a clip are those at rest."""
    for link, T in clip.links.items():
        first = T[:1]
        if link in rest_poses and not _poses_agree(first, rest_poses[link][None]):
            return False
    return True


def compare_shapes(contents: Sequence[Content]) -> None:
    """Compare the bounding boxes and volumes of the links' meshes, and report differences in each file's ledger."""
    contents_with_shapes = []
    for content in contents:
        if content.shapes:
            contents_with_shapes.append(content)
    contents_with_shapes.sort(key=lambda c: rank(c.format))
    for content in contents_with_shapes[1:]:
        first = contents_with_shapes[0]
        worst = 0.0
        where = ""
        for link, expected in first.shapes.items():
            if link not in content.shapes:
                continue
            difference = _compare_shape(content, link, expected, first.file)
            if difference >= worst:
                worst = difference
                where = link
        check = f"shapes of links against {first.file}"
        content.ledger.row(check, worst, "m", BOX_TOL, where=where, against=first.file)


def _compare_shape(content: Content, link: str, expected: LinkShape, source: str) -> float:
    """Report a different box or volume of a link; return the largest difference of the corners of the boxes in m."""
    shape = content.shapes[link]
    low = np.abs(shape.low - expected.low).max()
    high = np.abs(shape.high - expected.high).max()
    difference = float(max(low, high))
    # Vertices in single precision are rounded relative to the size of the shape.
    if difference > BOX_TOL + 1e-6 * expected.diagonal:
        text = (
            f"the bounding box of the meshes of link '{link}' differs by {difference * 1e3:.4g} mm from {source}. "
            f"The diagonal is {shape.diagonal:.4g} m here, {expected.diagonal:.4g} m in that file."
        )
        size = Measured(difference * 1e3, BOX_TOL * 1e3, "mm")
        content.ledger.wrong("compare.shape", text, link, size=size)
    elif shape.closed and expected.closed:
        # Coarser triangles of the same surface enclose a slightly different volume.
        tolerance = max(0.01 * abs(expected.volume), expected.rounding)
        if abs(shape.volume - expected.volume) > tolerance:
            text = f"the volume of link '{link}' is {shape.volume:.4g} m3; in {source} it is {expected.volume:.4g} m3."
            size = Measured(shape.volume, expected.volume, "m3")
            content.ledger.wrong("compare.volume", text, link, size=size)
    return difference


def compare_hashes(contents: Sequence[Content], proof: str = "") -> None:
    """Report files whose model hash differs from the hash in proof.json; without a proof, from the most common hash."""
    files_by_hash: dict[
        str, dict[str, str]
    ] = {}  # {hash: {format: a file of it}}: stages of one robot count as one source
    for content in contents:
        if content.model_hash:
            files_by_hash.setdefault(content.model_hash, {})[family(content.format)] = content.file
    if not files_by_hash:
        return
    expected = proof or max(files_by_hash, key=lambda h: len(files_by_hash[h]))
    source = "proof.json"
    if expected in files_by_hash:
        source = next(iter(files_by_hash[expected].values()))
    for content in contents:
        if not content.model_hash or content.model_hash == expected:
            continue
        text = f"the file was made from model {content.model_hash[:23]}…, but {source} from {expected[:23]}…."
        if not proof and len(files_by_hash[expected]) == len(files_by_hash[content.model_hash]):
            text += " One of the two models is wrong."
        content.ledger.wrong("compare.model_hash", text, "model_hash")


def _time_text(t: float | Array) -> str:
    return f"t = {t:.4g} s"
