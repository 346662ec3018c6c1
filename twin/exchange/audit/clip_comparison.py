"""Compare the clips of files with their references: key times, links, poses at and between keys, joint values."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.exchange.audit.clip_references import Reference, clip_prefixes, counterpart
from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.interpolation_error import midway
from twin.exchange.audit.ledger import MECHANISM, Ledger, Measured, um
from twin.exchange.audit.pose_deviation import POSITION_TOL, ROTATION_TOL, or_infinite, pose_deviation, poses_agree
from twin.exchange.audit.pose_mistakes import mistake_behind
from twin.exchange.audit.poses import Array
from twin.exchange.audit.sampled_states import CLIP
from twin.exchange.audit.value_text import distinguishable, quantity
from twin.exchange.format import Holds
from twin.exchange.formats import kind_holds, motion_groups

TIME_TOL = 1e-5
"""Maximum difference in s between the times of the same key in two files; glTF stores times in single precision."""

BETWEEN_TOL = 1e-5
"""Maximum error in m of a position halfway between two keys. For rotations, the maximum is `ROTATION_TOL`."""


def compare_clips(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Compare the clips of each file with the references, and report differences in the file's ledger."""
    compared: dict[str, list[_ClipComparison]] = {}
    prefixes = clip_prefixes(contents, refs)
    for content in contents:
        for clip in content.clips:
            name = counterpart(content, clip, refs, prefixes)
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
    _report_missing_clips(contents, refs)
    _report_files_without_motion(contents, refs)


@dataclass(frozen=True)
class _ClipComparison:
    """A clip of a file, and whether it agrees with its reference."""

    content: Content
    clip: FileClip
    agrees: bool


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
    _compare_joint_values(content, clip, ref, name, clip_keys, ref_keys)
    if clip.middle and len(clip_keys) == len(clip.times) == len(ref.clip.times):
        _compare_halfway_poses(content, clip, ref, name)


def _compare_times(ledger: Ledger, clip: FileClip, ref: Reference, name: str) -> tuple[Array, Array]:
    """Compare the key times; return the indices of the keys of both clips at which their poses are compared."""
    times = clip.times
    expected = ref.clip.times
    clip_keys, ref_keys = _common_keys(times, expected)
    longer = max(len(times), len(expected))
    if len(clip_keys) < longer:
        message = f"clip '{name}': {_time_difference_text(clip, ref, clip_keys, ref_keys)}."
        ledger.wrong("compare.times", message, name, size=Measured(float(len(clip_keys)), float(longer)))
    if len(clip_keys):
        differences = np.abs(times[clip_keys] - expected[ref_keys])
        worst_key = int(np.argmax(differences))
        check = f"clip '{name}': key times against {ref.source}"
        when = _time_text(times[clip_keys][worst_key])
        ledger.row(check, float(differences[worst_key]), "s", TIME_TOL, when=when, against=ref.source)
    if len(clip_keys) < 2 < len(times) or _are_same_keys(times, expected, clip_keys, ref_keys):
        clip_keys = np.arange(min(len(times), len(expected)))
        ref_keys = clip_keys
    return clip_keys, ref_keys


def _are_same_keys(times: Array, expected: Array, clip_keys: Array, ref_keys: Array) -> bool:
    """Return whether two clips have the same keys at other times: some are shifted, or all by the same ratio.

    Otherwise keys are missing and others added, and only those at the common times (`clip_keys`, `ref_keys`) are alike.
    """
    if len(times) != len(expected):
        return False
    if np.array_equal(clip_keys, ref_keys):
        return True
    end = float(times[-1])
    expected_end = float(expected[-1])
    return bool(np.all(np.abs(times * expected_end - expected * end) <= TIME_TOL * abs(end)))


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
            differences[link] = pose_deviation(clip_poses[link], ref_poses[link])
    times = clip.times[clip_keys]
    farthest = max(differences, key=lambda n: or_infinite(differences[n].distance))
    most_turned = max(differences, key=lambda n: or_infinite(differences[n].angle))
    count = f"{len(differences)} links x {len(clip_keys)} keys"
    distance = differences[farthest]
    angle = differences[most_turned]
    check = f"clip '{name}': position against {ref.source}, {count}"
    when = _time_text(times[distance.distance_key])
    ledger.row(check, distance.distance, "m", POSITION_TOL, where=farthest, when=when, against=ref.source)
    check = f"clip '{name}': rotation against {ref.source}, {count}"
    when = _time_text(times[angle.angle_key])
    ledger.row(check, angle.angle, "rad", ROTATION_TOL, where=most_turned, when=when, against=ref.source)
    ledger.placed |= ref.source == MECHANISM
    wrong = []
    for link, difference in differences.items():
        if not (difference.distance <= POSITION_TOL and difference.angle <= ROTATION_TOL):
            wrong.append(link)
    if not wrong:
        return
    reason = mistake_behind(clip_poses, ref_poses)
    first_deviating = _first_deviating_links(content, wrong, differences) if len(wrong) > 1 else {}
    wrong.sort(key=lambda n: (n not in first_deviating, -or_infinite(differences[n].distance)))
    for link in wrong:
        difference = differences[link]
        degrees = float(np.degrees(difference.angle))
        message = (
            f"clip '{name}': link '{link}' differs by {quantity(difference.distance, 'm')} and {degrees:.4g} deg from "
            f"{ref.source}"
        )
        message += f": {reason}." if reason else "."
        if link in first_deviating:
            message += f" The deviation begins here, at {first_deviating[link]}."
        # A position is reported before a rotation; one that is not finite compares as smaller than any tolerance.
        if difference.distance > POSITION_TOL or not np.isfinite(difference.distance):
            size = um(difference.distance, POSITION_TOL)
            key = difference.distance_key
        else:
            size = Measured(degrees, float(np.degrees(ROTATION_TOL)), "deg")
            key = difference.angle_key
        ledger.wrong("compare.pose", message, link, size=size, when=_time_text(times[key]))


def _first_deviating_links(content: Content, wrong: Collection[str], compared: Collection[str]) -> dict[str, str]:
    """Return {link: its joints as text} of the wrong links whose next link towards the root agrees.

    Only poses that are computed from joints have such links: each link carries the deviations of those before it.
    """
    if content.mechanism is None or not kind_holds(content.format, Holds.JOINT_TREE):
        return {}
    joint_above: dict[str, FileJoint] = {}
    for joint in content.mechanism.joints:
        if joint.parent and joint.names and not joint.tied:  # ties close loops
            joint_above.setdefault(joint.child, joint)
    first_deviating: dict[str, str] = {}
    for link in wrong:
        joint_names: list[str] = []
        ancestor = link
        # The count of names ends the walk in a file whose joints form a cycle.
        while ancestor in joint_above and len(joint_names) <= len(joint_above):
            joint = joint_above[ancestor]
            joint_names.extend(joint.names)
            ancestor = joint.parent
            if ancestor in compared:
                break
        if joint_names and ancestor in compared and ancestor not in wrong:
            listed = ", ".join(f"'{joint_name}'" for joint_name in reversed(joint_names))
            first_deviating[link] = f"{'joints' if len(joint_names) > 1 else 'joint'} {listed}"
    return first_deviating


def _time_difference_text(clip: FileClip, ref: Reference, clip_keys: Array, ref_keys: Array) -> str:
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
    missing_times = np.delete(expected.times, ref_keys)
    if len(missing_times):
        parts.append(f"keys of {ref.source} missing in this clip: {_keys_text(missing_times)}")
    extra_times = np.delete(clip.times, clip_keys)
    if len(extra_times):
        parts.append(f"keys missing in {ref.source}: {_keys_text(extra_times)}")
    return "; ".join(parts) + f" (both last {clip.duration:.6g} s)"


def _keys_text(times: Array) -> str:
    if len(times) == 1:
        return f"one key, at {times[0]:.6g} s"
    return f"{len(times)} keys, the first at {times[0]:.6g} s"


def _compare_halfway_poses(content: Content, clip: FileClip, ref: Reference, name: str) -> None:
    """Report links whose poses halfway between keys differ from the linearly interpolated poses of the reference."""
    differences = {}
    for link, T in ref.clip.links.items():
        if link in clip.middle:
            keys = np.asarray(T)
            differences[link] = pose_deviation(clip.middle[link], midway(keys[:-1], keys[1:]))
    if not differences:
        return
    ledger = content.ledger
    beginning = f"clip '{name}': halfway between two keys, the"
    ending = f"from the linear interpolation of {ref.source}."

    link = max(differences, key=lambda n: or_infinite(differences[n].distance))
    distance = differences[link].distance
    check = f"clip '{name}': position halfway between keys against {ref.source}"
    ledger.row(check, distance, "m", BETWEEN_TOL, where=link, against=ref.source)
    if not distance <= BETWEEN_TOL:
        text = f"{beginning} position of link '{link}' differs by {quantity(distance, 'm')} {ending}"
        when = _time_text(float(clip.times[differences[link].distance_key]))
        ledger.wrong("compare.between", text, link, size=um(distance, BETWEEN_TOL), when=when)

    link = max(differences, key=lambda n: or_infinite(differences[n].angle))
    angle = differences[link].angle
    check = f"clip '{name}': rotation halfway between keys against {ref.source}"
    ledger.row(check, angle, "rad", ROTATION_TOL, where=link, against=ref.source)
    if not angle <= ROTATION_TOL:
        degrees = np.degrees(angle)
        text = f"{beginning} rotation of link '{link}' differs by {degrees:.4g} deg {ending}"
        size = Measured(degrees, np.degrees(ROTATION_TOL), "deg")
        when = _time_text(float(clip.times[differences[link].angle_key]))
        ledger.wrong("compare.between", text, link, size=size, when=when)


def _compare_joint_values(
    content: Content, clip: FileClip, ref: Reference, name: str, clip_keys: Array, ref_keys: Array
) -> None:
    """Compare the joint values at the common keys (`clip_keys`, `ref_keys`) of a clip and its reference."""
    times = clip.times[clip_keys]
    worst = 0.0
    worst_tolerance = ROTATION_TOL
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
        tolerance = max(ROTATION_TOL, 1e-6 * float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
        difference = or_infinite(differences[worst_key])
        if difference / tolerance >= worst / worst_tolerance:
            worst = difference
            worst_tolerance = tolerance
            where = joint
            when = _time_text(times[worst_key])
        if difference > tolerance:
            value = float(clip_values[worst_key])
            ref_value = float(ref_values[worst_key])
            hint = _hint_of_degrees(value, ref_value)
            message = f"clip '{name}': joint '{joint}' is {value:.6g}; in {ref.source} it is {ref_value:.6g}.{hint}"
            size = Measured(difference, tolerance)
            content.ledger.wrong("compare.joint", message, joint, size=size, when=_time_text(times[worst_key]))
    if not count:
        return
    text = f"clip '{name}': joint values against {ref.source}, {count} joints"
    content.ledger.row(text, worst, "rad or m", worst_tolerance, where=where, when=when, against=ref.source)


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
        wrong: list[_ClipComparison] = []
        counted = 0
        for row in rows:
            if row.content.repeats_track:  # a CSV track is written from the same numbers as the JSON track
                continue
            counted += 1
            if not row.agrees:
                wrong.append(row)
        if ref.source not in sources or len(wrong) < 2 or len(wrong) < counted:
            continue
        first, *others = wrong
        shared = []
        for link in first.clip.links:
            if link in ref.clip.links:
                shared.append(link)
        agreeing_files = []
        for row in others:
            if _same_motion(row.clip, first.clip, shared):
                agreeing_files.append(row.content.file)
        if shared and len(agreeing_files) == len(others):
            files = ", ".join(agreeing_files)
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
        if not poses_agree(clip.links[link], other.links[link]):
            return False
    return True


def _report_files_without_motion(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Report files of formats that hold all motions in one file if they have none, and a link moves in another file.

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
        if not poses_agree(T, first):
            return True
    return False


def _report_missing_clips(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Report each clip that a file lacks whose format holds all motions, and each that all files of another kind lack.

    Drawn states are no clip of the export: files with a motion of their own do not lack them.
    """
    expected = set(refs) - {CLIP}
    for content in contents:
        if kind_holds(content.format, Holds.ALL_MOTIONS) and content.clips and content.declared:
            own_clips = {clip.name for clip in content.clips}
            for name in sorted(expected - own_clips):
                text = f"clip '{name}' of {refs[name].source} is missing."
                content.ledger.wrong("compare.missing_clip", text, name)
    prefixes = clip_prefixes(contents, refs)
    for kinds in motion_groups():
        first_with_motion: Content | None = None
        present: set[str | None] = set()
        for content in contents:
            if content.format not in kinds:
                continue
            if not content.clips:  # a track with faults has no clip, but it is there, and its faults were reported
                present.add(str(content.facts.get("protocol")))
                continue
            for clip in content.clips:
                present.add(counterpart(content, clip, refs, prefixes))
            if first_with_motion is None:
                first_with_motion = content
        missing = sorted(expected - present)
        if first_with_motion is not None and missing:
            first = missing[0]
            text = f"no file of this format contains clip '{first}' of {refs[first].source}."
            first_with_motion.ledger.wrong("compare.missing_clip", text, first)


def _time_text(t: float | Array) -> str:
    return f"t = {t:.4g} s"
