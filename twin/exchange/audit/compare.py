"""Compare files: poses of every link at every key, joint values, rest poses, shapes, clips and model hashes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.exchange.audit.between import midway
from twin.exchange.audit.diagnose import why
from twin.exchange.audit.motion import Clip, Content, largest
from twin.exchange.audit.poses import Array, angle
from twin.exchange.audit.report import MECHANISM, POSITION_TOL, ROTATION_TOL, Measured, quantity, told_apart, um
from twin.exchange.format import Holds
from twin.exchange.formats import family, holding, motion_groups, rank

TIME_TOL = 1e-5
"""Maximum difference in s between the times of the same key in two files; glTF stores times in single precision."""

BETWEEN_TOL = 1e-5
"""Maximum error in m of a position halfway between two keys. For rotations, the maximum is `ROTATION_TOL`."""

BOX_TOL = 2e-5
"""Maximum difference in m between the bounding boxes of one link's meshes in two files."""


@dataclass(frozen=True)
class Reference:
    """A reference clip, and its source: "the mechanism" or the name of a file."""

    clip: Clip
    source: str


def references(contents: Sequence[Content], truth: Mapping[str, tuple[Array, Mapping[str, Array]]]) -> dict:
    """Return {clip name: `Reference`}.

    The reference for a clip is `truth` if it contains the clip, else the clip's track, else the first file with it. If
    there are tracks, other files are references only for the motions of tracks that cannot be used. A .usdz is a
    reference only if no other file has a motion.
    """
    out = {name: Reference(Clip(name, np.asarray(t, float), links), MECHANISM) for name, (t, links) in truth.items()}
    # A stage does not state the name of its clip, which is then that of the file: <robot>_<clip>. The other files do.
    stated = {clip.name: clip for c in contents if not _unnamed(c) for clip in c.clips}
    tracked = any(c.format == "tracks" for c in contents)
    unusable = dict.fromkeys(str(c.facts.get("protocol")) for c in contents if c.format == "tracks" and not c.clips)
    repeating = {c.file for c in contents if holding(c.format, Holds.REPEATED_MOTION)}
    for content in sorted(contents, key=lambda c: rank(c.format)):
        if content.file in repeating and any(r.source not in repeating for r in out.values()):
            continue  # <robot>_ar.usdz has the motion of another file, which `_counterpart` finds
        for clip in content.clips:
            name = clip.name
            if _unnamed(content):
                name = _named(clip.name, out) or _named(clip.name, {**stated, **unusable}) or clip.name
            if tracked and content.format != "tracks" and name not in unusable:
                continue
            out.setdefault(name, Reference(clip, content.file))
    return out


def _unnamed(content: Content) -> bool:
    """Return whether the motion of a file has the name of the file."""
    return holding(content.format, Holds.UNNAMED_MOTION)


def compare(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Compare the clips of each file with the references, and report differences in the file's ledger."""
    agreeing: dict[str, list[tuple[Content, Clip, bool]]] = {}
    prefixes = _prefixes(contents, refs)
    for content in contents:
        for clip in content.clips:
            name = _counterpart(content, clip, refs, prefixes)
            if name is None:
                if len(contents) > 1 and refs:
                    text = f"clip '{clip.name}' is in no other file; the known clips are {', '.join(sorted(refs))}."
                    content.ledger.add("compare.clip", "warning", text, clip.name)
                continue
            ref = refs[name]
            if ref.source == content.file:
                continue
            before = len(content.ledger.found)
            _compare_clip(content, clip, ref, name)
            agreeing.setdefault(name, []).append((content, clip, len(content.ledger.found) == before))
    _blame(contents, refs, agreeing)
    _check_missing(contents, refs)
    _check_silent(contents, refs)


def _named(name: str, known: Mapping[str, object]) -> str | None:
    """Return the known clip in the name of a stage, <robot>_<clip> or <robot>_<clip>_ar; None if no clip matches."""
    stem = name.removesuffix("_ar")
    fits = [k for k in known if k and (stem == k or stem.endswith(f"_{k}"))]
    return max(fits, key=len) if fits else None


def _prefixes(contents: Sequence[Content], refs: Mapping[str, Reference]) -> frozenset[str]:
    """Return the parts before the name of the clip in the names of stages, such as <robot>_ in <robot>_<clip>."""
    out = set()
    for clip in (clip for c in contents if _unnamed(c) for clip in c.clips):
        if (name := _named(clip.name, refs)) is not None:
            out.add(clip.name.removesuffix("_ar").removesuffix(name))
    return frozenset(out - {""})


def _counterpart(content: Content, clip: Clip, refs: Mapping[str, Reference], prefixes: Collection[str]) -> str | None:
    """Return the name of the reference clip for a clip; None if the clip has a name of its own, or nothing is alike."""
    if clip.name in refs:
        return clip.name
    if not _unnamed(content):
        return None
    if (name := _named(clip.name, refs)) is not None:
        return name
    if clip.name.removesuffix("_ar").startswith(tuple(prefixes)):
        return None
    # The file does not state the name of its clip: choose the clip with the most similar first and last poses.
    scores = {name: _score(clip, ref.clip) for name, ref in refs.items()}
    scores = {name: s for name, s in scores.items() if s is not None}
    return min(scores, key=lambda n: scores[n]) if scores else None


def _score(clip: Clip, ref: Clip) -> float | None:
    shared = [n for n in ref.links if n in clip.links]
    if not shared:
        return None
    apart = abs(clip.duration - ref.duration)
    ends = [np.abs(clip.links[n][i] - ref.links[n][i]).max() for n in shared for i in (0, -1)]
    return float(apart + max(ends))


def _compare_clip(content: Content, clip: Clip, ref: Reference, name: str) -> None:
    ledger = content.ledger
    mine, its = _common(clip.times, ref.clip.times)
    label = f"clip '{name}'"
    against = f"against {ref.source}"
    if len(mine) < max(len(clip.times), len(ref.clip.times)):
        message = f"{label}: {_times_apart(clip, ref, mine, its)}."
        ledger.wrong(
            "compare.times",
            message,
            name,
            size=Measured(float(len(mine)), float(max(len(clip.times), len(ref.clip.times)))),
        )
    if len(mine):
        off = np.abs(clip.times[mine] - ref.clip.times[its])
        k = int(np.argmax(off))
        when = _at(clip.times[mine][k])
        ledger.row(f"{label}: key times {against}", float(off[k]), "s", TIME_TOL, when=when, against=ref.source)
    if (len(clip.times) == len(ref.clip.times) and len(mine) < len(its)) or len(mine) < 2 < len(clip.times):
        mine = its = np.arange(min(len(clip.times), len(ref.clip.times)))  # times differ: compare key by key
    missing = [n for n in ref.clip.links if n not in clip.links]
    extra = [n for n in content.declared or () if n not in ref.clip.links]
    for names, code, text in ((missing, "missing", "is missing"), (extra, "extra", f"is not in {ref.source}")):
        for n in names:
            message = f"{label}: link '{n}' {text}."
            ledger.wrong(f"compare.{code}_link", message, n)
    shared = [n for n in ref.clip.links if n in clip.links]
    if not shared or not len(mine):
        return
    found = {n: clip.links[n][mine] for n in shared}
    meant = {n: np.asarray(ref.clip.links[n])[its] for n in shared}
    times = clip.times[mine]
    rows = {n: largest(found[n], meant[n]) for n in shared}
    far, turned = max(shared, key=lambda n: rows[n][0]), max(shared, key=lambda n: rows[n][2])
    count = f"{len(shared)} links x {len(mine)} keys"
    for kind, link, worst, k, unit, tolerance in (
        ("position", far, rows[far][0], rows[far][1], "m", POSITION_TOL),
        ("rotation", turned, rows[turned][2], rows[turned][3], "rad", ROTATION_TOL),
    ):
        check = f"{label}: {kind} {against}, {count}"
        ledger.row(check, worst, unit, tolerance, where=link, when=_at(times[k]), against=ref.source)
    ledger.placed |= ref.source == MECHANISM
    wrong = [n for n in shared if not (rows[n][0] <= POSITION_TOL and rows[n][2] <= ROTATION_TOL)]
    reason = why(found, meant) if wrong else ""
    for n in sorted(wrong, key=lambda n: -rows[n][0]):
        p, i, r, j = rows[n]
        by_place = p > POSITION_TOL or not np.isfinite(p)
        message = f"{label}: link '{n}' differs by {quantity(p, 'm')} and {np.degrees(r):.4g} deg from {ref.source}" + (
            f": {reason}." if reason else "."
        )
        ledger.wrong(
            "compare.pose",
            message,
            n,
            size=Measured(
                p * 1e6 if by_place else float(np.degrees(r)),
                POSITION_TOL * 1e6 if by_place else float(np.degrees(ROTATION_TOL)),
                "um" if by_place else "deg",
            ),
            when=_at(times[i if by_place else j]),
        )
    _compare_joints(content, clip, ref, name, mine, its)
    if clip.middle and len(mine) == len(clip.times) == len(ref.clip.times):
        _compare_middle(content, clip, ref, name)


def _times_apart(clip: Clip, ref: Reference, mine: Array, its: Array) -> str:
    """Return a message that states the durations if they differ, else the keys that only one of the clips has."""
    if abs(clip.duration - ref.clip.duration) > TIME_TOL:
        ratio = clip.duration / ref.clip.duration if ref.clip.duration else float("nan")
        here, there = told_apart(clip.duration, ref.clip.duration)
        return (
            f"the clip lasts {here} s; in {ref.source} it lasts {there} s (ratio {ratio:.6g}); {len(mine)} of "
            f"the {len(clip.times)} key times are also in {ref.source}, which has {len(ref.clip.times)} key times"
        )
    said = []
    for times, shared, text in (
        (ref.clip.times, its, f"keys of {ref.source} missing in this clip:"),
        (clip.times, mine, f"keys missing in {ref.source}:"),
    ):
        lacking = np.setdiff1d(np.arange(len(times)), shared)
        if len(lacking):
            keys = "one key" if len(lacking) == 1 else f"{len(lacking)} keys"
            said.append(f"{text} {keys}, {'' if len(lacking) == 1 else 'the first '}at {times[lacking[0]]:.6g} s")
    return "; ".join(said) + f" (both last {clip.duration:.6g} s)"


def _compare_middle(content: Content, clip: Clip, ref: Reference, name: str) -> None:
    """Report links whose poses halfway between keys differ from the linearly interpolated poses of the reference."""
    shared = [n for n in ref.clip.links if n in clip.middle]
    if not shared:
        return
    keys = {n: np.asarray(ref.clip.links[n]) for n in shared}
    off = {n: largest(clip.middle[n], midway(keys[n][:-1], keys[n][1:])) for n in shared}
    for kind, at, unit, limit in (("position", 0, "m", BETWEEN_TOL), ("rotation", 2, "rad", ROTATION_TOL)):
        link = max(shared, key=lambda n: off[n][at])
        worst, k = off[link][at], int(off[link][at + 1])
        check = f"clip '{name}': {kind} halfway between keys against {ref.source}"
        content.ledger.row(check, worst, unit, limit, where=link, against=ref.source)
        if not worst <= limit:
            size = um(worst, limit) if unit == "m" else Measured(np.degrees(worst), np.degrees(limit), "deg")
            text = (
                f"clip '{name}': halfway between two keys, the {kind} of link '{link}' differs by "
                f"{quantity(worst, 'm') if unit == 'm' else f'{np.degrees(worst):.4g} deg'} from the linear "
                f"interpolation of {ref.source}."
            )
            content.ledger.wrong("compare.between", text, link, size=size, when=_at(float(clip.times[k])))


def _compare_joints(content: Content, clip: Clip, ref: Reference, name: str, mine: Array, its: Array) -> None:
    shared = [n for n in ref.clip.joints if n in clip.joints]
    if not shared:
        return
    worst, where, when = 0.0, "", ""
    for n in shared:
        off = np.abs(clip.joints[n][mine] - ref.clip.joints[n][its])
        k = int(np.argmax(off))
        tolerance = max(ROTATION_TOL, 1e-6 * float(np.abs(ref.clip.joints[n]).max(initial=0.0)))
        if off[k] >= worst:
            worst, where, when = float(off[k]), n, _at(clip.times[mine][k])
        if not off[k] <= tolerance:
            meant = float(ref.clip.joints[n][its][k])
            got = float(clip.joints[n][mine][k])
            ratio = got / meant if meant else 0.0
            hint = (
                " The ratio suggests degrees instead of radians, or the reverse."
                if min(abs(ratio * np.pi / 180 - 1), abs(ratio * 180 / np.pi - 1)) < 1e-3
                else ""
            )
            message = f"clip '{name}': joint '{n}' is {got:.6g}; in {ref.source} it is {meant:.6g}.{hint}"
            content.ledger.wrong(
                "compare.joint", message, n, size=Measured(off[k], tolerance), when=_at(clip.times[mine][k])
            )
    text = f"clip '{name}': joint values against {ref.source}, {len(shared)} joints"
    content.ledger.row(text, worst, "rad or m", ROTATION_TOL, where=where, when=when, against=ref.source)


def _common(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the indices (i, j) of the equal times in two increasing time arrays (k,) and (l,)."""
    if len(a) == len(b) and np.all(np.abs(a - b) <= TIME_TOL):
        return np.arange(len(a)), np.arange(len(b))
    near = np.clip(np.searchsorted(b, a), 1, max(len(b) - 1, 1)) if len(b) > 1 else np.zeros(len(a), int)
    if len(b) > 1:
        near = np.where(np.abs(b[near - 1] - a) < np.abs(b[near] - a), near - 1, near)
    fits = np.abs(b[near] - a) <= TIME_TOL
    return np.flatnonzero(fits), near[fits]


def _blame(contents: Sequence[Content], refs: Mapping[str, Reference], compared: Mapping) -> None:
    """Report the reference file as wrong if all other files differ from the reference, but agree with each other."""
    for name, rows in compared.items():
        bad = [(c, clip) for c, clip, fits in rows if not fits and family(c.format) != "tracks"]
        source = next((c for c in contents if c.file == refs[name].source), None)
        if source is None or len(bad) < 2 or len(bad) < sum(1 for c, _, _ in rows if c.format != "csv"):
            continue
        (first, one), others = bad[0], bad[1:]
        shared = [n for n in one.links if n in refs[name].clip.links]
        same = all(
            len(clip.times) == len(one.times)
            and all(n in clip.links and _agrees(clip.links[n], one.links[n]) for n in shared)
            for _, clip in others
        )
        if same and shared:
            text = (
                f"clip '{name}': {first.file} and {', '.join(c.file for c, _ in others)} agree with each other, and "
                "all differ from this file, so this file is wrong."
            )
            source.ledger.wrong("compare.odd_one_out", text, name)


def _agrees(A: Array, B: Array) -> bool:
    p, _, r, _ = largest(A, B)
    return p <= 2 * POSITION_TOL and r <= 2 * ROTATION_TOL


def _check_silent(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Report glTF files without clips if another file has a clip in which a link moves."""
    moving = [n for n, r in refs.items() if any(not _agrees(T, T[:1]) for T in r.clip.links.values())]
    for content in contents:
        if holding(content.format, Holds.ALL_MOTIONS) and content.declared and not content.clips and moving:
            name = moving[0]
            text = f"the file has no motion; {refs[name].source} has the motion '{name}'."
            content.ledger.add("compare.no_motion", "warning", text, "animations")


def _check_missing(contents: Sequence[Content], refs: Mapping[str, Reference]) -> None:
    """Report each clip that a glTF file lacks, and each clip that all USD stages, JSON tracks or CSV tracks lack."""
    for content in contents:
        if holding(content.format, Holds.ALL_MOTIONS) and content.clips and content.declared:
            for name in sorted(set(refs) - {c.name for c in content.clips}):
                text = f"clip '{name}' of {refs[name].source} is missing."
                content.ledger.wrong("compare.missing_clip", text, name)
    for kinds in motion_groups():
        group = [c for c in contents if c.format in kinds and c.clips]
        prefixes = _prefixes(contents, refs)
        have = {_counterpart(c, clip, refs, prefixes) for c in group for clip in c.clips}
        # A track with faults has no clip, but it is there, and its faults have been reported.
        faulty = {str(c.facts.get("protocol")) for c in contents if c.format in kinds and not c.clips}
        if len(group) and (missing := sorted(set(refs) - have - faulty)):
            text = f"no file of this format contains clip '{missing[0]}' of {refs[missing[0]].source}."
            group[0].ledger.wrong("compare.missing_clip", text, missing[0])


def compare_rest(contents: Sequence[Content]) -> None:
    """Compare the rest poses of files, and report differences in each file's ledger."""
    having = []
    for content in contents:
        # The links of a file with one motion may be at its start.
        moved = content.clips and holding(content.format, Holds.ONE_MOTION)
        if content.rest and content.declared and holding(content.format, Holds.REST) and not moved:
            having.append(content)
    having.sort(key=lambda c: rank(c.format))
    for content in having[1:]:
        first = having[0]
        shared = [n for n in first.rest if n in content.rest]
        if not shared:
            continue
        apart = {n: float(np.linalg.norm(content.rest[n][:3, 3] - first.rest[n][:3, 3])) for n in shared}
        turn = {n: float(angle(content.rest[n][:3, :3], first.rest[n][:3, :3])) for n in shared}
        far, turned = max(apart, key=lambda n: apart[n]), max(turn, key=lambda n: turn[n])
        for kind, worst, unit, tolerance, link in (
            ("position", apart[far], "m", POSITION_TOL, far),
            ("rotation", turn[turned], "rad", ROTATION_TOL, turned),
        ):
            check = f"rest: {kind} against {first.file}"
            content.ledger.row(check, worst, unit, tolerance, where=link, against=first.file)
        if (apart[far] > POSITION_TOL or turn[turned] > ROTATION_TOL) and (clip := _begins(content)):
            text = f"the rest pose is the first pose of clip '{clip}'; it differs from the rest pose of {first.file}."
            content.ledger.add("compare.rest", "info", text, clip)
        elif apart[far] > POSITION_TOL or turn[turned] > ROTATION_TOL:
            text = (
                f"rest poses differ from {first.file}, most in position at link '{far}' ({quantity(apart[far], 'm')}), "
                f"most in rotation at link '{turned}' ({np.degrees(turn[turned]):.4g} deg)."
            )
            content.ledger.wrong("compare.rest", text, far, size=um(apart[far]))


def _begins(content: Content) -> str:
    """Return the clip whose first poses equal the file's rest poses (as in Blender files); "" if no clip does."""
    for clip in content.clips:
        if all(_agrees(T[:1], content.rest[n][None]) for n, T in clip.links.items() if n in content.rest):
            return clip.name
    return ""


def compare_shapes(contents: Sequence[Content]) -> None:
    """Compare the bounding boxes and volumes of the links' meshes, and report differences in each file's ledger."""
    having = [c for c in contents if c.shapes]
    having.sort(key=lambda c: rank(c.format))
    for content in having[1:]:
        first, worst, where = having[0], 0.0, ""
        for name in (n for n in first.shapes if n in content.shapes):
            a, b = content.shapes[name], first.shapes[name]
            off = float(max(np.abs(a.low - b.low).max(), np.abs(a.high - b.high).max()))
            size = float(np.linalg.norm(b.high - b.low))
            if off >= worst:
                worst, where = off, name
            if off > BOX_TOL + 1e-6 * size:
                text = (
                    f"the bounding box of the meshes of link '{name}' differs by {off * 1e3:.4g} mm from {first.file}. "
                    f"The diagonal is {float(np.linalg.norm(a.high - a.low)):.4g} m here, {size:.4g} m in that file."
                )
                content.ledger.wrong("compare.shape", text, name, size=Measured(off * 1e3, BOX_TOL * 1e3, "mm"))
            elif a.closed and b.closed and abs(a.volume - b.volume) > max(0.01 * abs(b.volume), b.rounding):
                text = f"the volume of link '{name}' is {a.volume:.4g} m3; in {first.file} it is {b.volume:.4g} m3."
                content.ledger.wrong("compare.volume", text, name, size=Measured(a.volume, b.volume, "m3"))
        check = f"shapes of links against {first.file}"
        content.ledger.row(check, worst, "m", BOX_TOL, where=where, against=first.file)


def compare_hashes(contents: Sequence[Content], proof: str = "") -> None:
    """Report files whose model hash differs from the hash in proof.json; without a proof, from the most common hash."""
    said: dict[str, dict[str, str]] = {}
    for c in contents:
        if c.model_hash:
            said.setdefault(c.model_hash, {})[family(c.format)] = c.file
    if not said:
        return
    common = proof or max(said, key=lambda h: len(said[h]))
    others = next(iter(said[common].values())) if common in said else "proof.json"
    for content in contents:
        if content.model_hash and content.model_hash != common:
            tie = not proof and len(said[common]) == len(said[content.model_hash])
            text = f"the file was made from model {content.model_hash[:23]}…, but {others} from {common[:23]}…." + (
                " One of the two models is wrong." if tie else ""
            )
            content.ledger.wrong("compare.model_hash", text, "model_hash")


def _at(t: float) -> str:
    return f"t = {t:.4g} s"
