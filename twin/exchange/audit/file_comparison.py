"""Compare what is still in files: rest poses, shapes of links, and the hashes of the models that they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.exchange.audit.file_content import Content, FileClip, LinkShape
from twin.exchange.audit.ledger import Measured, um
from twin.exchange.audit.pose_deviation import POSITION_TOL, ROTATION_TOL, or_infinite, poses_agree
from twin.exchange.audit.poses import Array, angle
from twin.exchange.audit.value_text import quantity
from twin.exchange.format import Holds
from twin.exchange.formats import family, kind_holds, rank

BOX_TOL = 2e-5
"""Maximum difference in m between the bounding boxes of one link's meshes in two files."""


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
            distances[link] = or_infinite(float(np.linalg.norm(own_pose[:3, 3] - T[:3, 3])))
            angles[link] = or_infinite(float(angle(own_pose[:3, :3], T[:3, :3])))
    if not distances:
        return
    ledger = content.ledger
    farthest = max(distances, key=lambda n: distances[n])
    most_turned = max(angles, key=lambda n: angles[n])
    distance = distances[farthest]
    turn = angles[most_turned]
    against = first.file
    ledger.row(f"rest: position against {against}", distance, "m", POSITION_TOL, where=farthest, against=against)
    ledger.row(f"rest: rotation against {against}", turn, "rad", ROTATION_TOL, where=most_turned, against=against)
    if distance <= POSITION_TOL and turn <= ROTATION_TOL:
        return
    clip = first_pose_of(content)
    if clip:
        text = f"the rest pose is the first pose of clip '{clip}'; it differs from the rest pose of {against}."
        ledger.add("compare.rest", "info", text, clip)
        return
    text = (
        f"rest poses differ from {against}, most in position at link '{farthest}' ({quantity(distance, 'm')}), "
        f"most in rotation at link '{most_turned}' ({np.degrees(turn):.4g} deg)."
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
        if link in rest_poses and not poses_agree(first, rest_poses[link][None]):
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
