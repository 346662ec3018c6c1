"""Read exported files of robots and their motions, and report faults. The package shares no code with the writers.

Reading:
folder_files          find the files of a folder that can be audited
reader_context        what a reader may know beside its file; readers are the modules `audit` in twin.exchange.formats
poses                 quaternions and matrices, implemented independently of the writers
file_content          the common result of the readers: clips of link poses in the world frame
mechanism_data        the mechanism data of a file, in one form for all formats; file_joints, file_drives: of a joint
motion_lines          lines along or about which a joint moves; joint_merging: join the parts of a joint in a format
meshes                faults and shapes of triangle meshes; obj_file, mesh_files: of OBJ files; colors: of a surface
xml_root, comment_statements    what XML files have in common
new_names             rename links and joints where a file has other names than the robot; named_parts: all names

One file:
clip_checks           times, rates, quaternions and poses of clips by themselves
plausibility          find physically impossible data
interpolation_error   estimate the error between keys

Files with each other and with the mechanism:
clip_comparison       the pose of every link at every key; clip_references: of which clip; pose_deviation: how far apart
file_comparison       poses at rest, shapes, hashes of the model
mechanism_comparison  joints, drives, masses, frames, surfaces, colours; mechanism_truth: those of the robot
stated_values         the values of these quantities in each file, of file_view; reduced_couplings: of couplings
reference_joints      which joint of a file, or part of one, is which joint of the others
compared_quantities   rule and message of each quantity; value_differences: how far two values are apart
file_statements       names, titles and rates that files state about themselves; parameter_claims: their parameters
state_comparison      files without motion at sampled_states; chain_poses: of chains of joints
track_claims          errors between keys, headers, assumed numbers and frames that tracks state
joint_assignment      which joint of a file is which of the mechanism; joint_lines: how they lie to each other
rest_poses            the poses of a file at rest with the joints of the mechanism
pose_mistakes         a common mistake that explains a difference

What lies beside the files:
reference_export      every field with a new export of the robot
proof_hashes          the hashes of proof.json; proof_statements: the rest, in proof_form, proof_origin, repeated_checks

Scenes and certificates:
scene_folder          an exported scene: its list of robots, and the folder of each; deformables: its organs
scene_stage           a stage of the scene, and its links with the files of the robots
certificate           a certificate of `twin prove`, without the prover: of equations with decimal_rows, or with
                      bounds_certificate, motion_certificate, workspace_certificate and its stated_closures

ledger                checks and findings on one file, with advice; report: those of all files; value_text: of values
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.core.findings import verdict
from twin.core.foreign.admit import admit_together
from twin.core.foreign.budget import check_size
from twin.core.json_types import JsonMapping
from twin.core.progress import Progress
from twin.exchange.audit.clip_comparison import compare_clips
from twin.exchange.audit.clip_references import Reference, references
from twin.exchange.audit.file_comparison import compare_hashes, compare_rest, compare_shapes, first_pose_of
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_statements import compare_stated
from twin.exchange.audit.folder_files import SCENE, FolderFiles, find_files
from twin.exchange.audit.ledger import MECHANISM, Check, Ledger, ReadError, guarded
from twin.exchange.audit.mechanism_comparison import compare_mechanisms
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.mechanism_truth import mechanism_truth
from twin.exchange.audit.named_parts import check_names
from twin.exchange.audit.parameter_claims import compare_parameters
from twin.exchange.audit.plausibility import check_sense
from twin.exchange.audit.proof_hashes import check_proof
from twin.exchange.audit.proof_statements import check_statements
from twin.exchange.audit.reader_context import Context
from twin.exchange.audit.reference_export import (
    ExportStatement,
    NewExport,
    compare_with_reference,
    export_statement,
    not_compared,
)
from twin.exchange.audit.report import AuditReport, finished
from twin.exchange.audit.rest_poses import compare_joints
from twin.exchange.audit.sampled_states import CLIP, SampledStates
from twin.exchange.audit.state_comparison import compare_states, same_names
from twin.exchange.audit.track_claims import check_claims, check_proof_clips
from twin.exchange.format import Format, Holds
from twin.exchange.formats import audit_formats, is_leading_kind
from twin.exchange.xacro import XacroSettings

if TYPE_CHECKING:
    from twin.model.mechanism import Mechanism

__all__ = ["SCENE", "AuditReport", "Check", "ExportStatement", "NewExport", "SampledStates", "audit", "key_times"]

Truth = Mapping[str, tuple[np.ndarray, Mapping[str, np.ndarray]]]
"""Expected motions: {clip name: (times (k,) in s, {link name: poses T_world_link (k, 4, 4)})}."""

"""Function called during the audit with the current step, such as "read robot.glb", and the fraction done (0..1)."""


def audit(
    path: str | Path,
    *,
    truth: Truth | None = None,
    mechanism: Mechanism | None = None,
    states: Callable[[], SampledStates] | None = None,
    reference: Callable[[ExportStatement], NewExport] | None = None,
    progress: Progress | None = None,
    xacro: XacroSettings | None = None,
) -> AuditReport:
    """Read a file or a folder of exported files, check each file, and compare the files with each other.

    Args:
        path: a file of a format that `twin.exchange.formats.audited` returns, a folder with such files, or an exported
            scene.
        truth: motions of the reference model; the poses in the files are compared with these motions. None: the poses
            are compared with the poses in the tracks. Not used for a scene.
        mechanism: the expected mechanism; masses, joints, drives and frames in the files are compared with it. None:
            the files are compared only with each other. Not used for a scene.
        states: returns states of `mechanism` over its whole range; called if a file has no motion.
        reference: returns a new export of the robot or the scene that the files state, which every field of the files
            is compared with. It is called with what the files state.
        progress: see `Progress`.
        xacro: how the xacros among the files are expanded.

    Returns:
        A report of the measurements and findings; its `verdict` is "unchecked" if a file could not be read, nothing
        could be checked, or the geometry of a file could not be compared with the `mechanism`.

    Raises:
        TwinError: the path does not exist, or has no file that can be audited.
    """
    path = Path(path)
    report_progress = progress or _silent
    xacro_settings = xacro or XacroSettings()
    if (path / SCENE).is_file():
        from twin.exchange.audit.scene_folder import audit_scene  # imports audits of formats, which import this package

        contents, ledgers = audit_scene(
            path, lambda folder: _audited(folder, {}, None, None, report_progress, xacro_settings)
        )
    else:
        sampled: Callable[[], SampledStates] | None = None
        if states is not None:
            sampled = cache(states)  # they are computed at most once, and only if a file needs them
        contents, ledgers = _audited(path, truth or {}, mechanism, sampled, report_progress, xacro_settings)
    if reference is not None:
        new_export = reference(export_statement(contents))
        if new_export.reason:
            ledgers.append(not_compared(path, new_export.reason))
        if new_export.folder is not None:
            report_progress("compare with a new export", 0.95)
            unreadable = {ledger.file for ledger in ledgers if ledger.found} - {content.file for content in contents}
            # first, as they name the places of changes, and many other findings only what follows from these
            ledgers = [*compare_with_reference(path, new_export.folder, unreadable), *ledgers]
    return finished(str(path), [content.as_facts() for content in contents], ledgers)


def _silent(label: str, fraction: float) -> None:
    """Show no progress."""


def _audited(
    path: Path,
    truth: Truth,
    mechanism: Mechanism | None,
    states: Callable[[], SampledStates] | None,
    report_progress: Progress,
    xacro: XacroSettings,
) -> tuple[list[Content], list[Ledger]]:
    """Read the files of one robot and compare the files with each other; return (contents, ledgers)."""
    folder_files = find_files(path)
    contents: list[Content] = []
    ledgers: list[Ledger] = []
    for ledger, content in _read(folder_files, report_progress, states, xacro):
        ledgers.append(ledger)
        if content is not None:
            contents.append(content)
    ledgers += _unrecognised(folder_files)
    with np.errstate(all="ignore"):  # values that are not finite have already been reported
        declared = _declared(contents)
        for content in contents:
            content.known = declared or None
            check_names(content)
            check_sense(content, _gravity(contents, content, mechanism))
        report_progress("compare", 0.9)
        refs = references(contents, truth)
        expected: FileMechanism | None = None
        if mechanism is not None:
            expected = mechanism_truth(mechanism)
        if states is not None and _has_sampled_states(contents):
            refs[CLIP] = Reference(states().clip(), MECHANISM)
        compare_clips(contents, refs)
        contents_with_other_names: list[Content] = []
        if expected is not None:
            contents_with_other_names = _compare_still(contents, expected, states)
        else:
            _compare_joints_between(contents)
        compare_rest(contents)
        compare_shapes(contents)
        # In files with other names, all parts of the mechanism would be missing: compare them with each other.
        files_with_other_names = {content.file for content in contents_with_other_names}
        contents_with_same_names = []
        for content in contents:
            if content.file not in files_with_other_names:
                contents_with_same_names.append(content)
        compare_mechanisms(contents_with_same_names, expected)
        compare_mechanisms(contents_with_other_names)
        if expected is not None:
            _check_placed(contents, expected)
        _compare_statements(contents, mechanism)
        proven_hash = _check_proofs(folder_files, contents, ledgers)
        compare_hashes(contents, proven_hash)
    return contents, ledgers


def _check_proofs(folder_files: FolderFiles, contents: Sequence[Content], ledgers: list[Ledger]) -> str:
    """Check each proof.json, whose ledger is added to `ledgers`; return the first hash of a model that one states.

    `ledgers` must have those of all other files: a proof.json repeats the checks of the audit at the export.
    """
    proven_hash = ""
    for file in folder_files.proofs:
        ledger = Ledger(folder_files.name(file), "sha256", "2")
        ledgers.append(ledger)
        proof = guarded(check_proof, file, ledger) or {}
        check_proof_clips(proof, contents, ledger)
        if proof:
            audit_checks: list[Check] = []
            for audited_ledger in ledgers:
                audit_checks += audited_ledger.checks
            guarded(partial(_check_statements, proof, contents, audit_checks), file, ledger)
        proven_hash = proven_hash or str(proof.get("model_hash", ""))
    return proven_hash


def _compare_statements(contents: Sequence[Content], mechanism: Mechanism | None) -> None:
    """Compare what the files state of themselves with each other, and with the mechanism if there is one."""
    compare_stated(contents, "" if mechanism is None else mechanism.name)
    check_claims(contents)
    if mechanism is None:
        compare_parameters(contents, "", ())
    else:
        compare_parameters(contents, mechanism.name, mechanism.parameters)


def _check_statements(
    proof: JsonMapping, contents: Sequence[Content], audit_checks: Sequence[Check], file: Path, ledger: Ledger
) -> None:
    check_statements(proof, file.parent, contents, audit_checks, ledger)


def _unrecognised(folder_files: FolderFiles) -> Iterator[Ledger]:
    """Yield ledgers with a finding for each file that is not recognised, though a file of the same name is."""
    for file, sibling, title in folder_files.unrecognised:
        ledger = Ledger(folder_files.name(file), "twin.exchange.audit folder", "1")
        text = (
            f"{folder_files.name(file)} is not recognised as one of the {title}, although "
            f"{folder_files.name(sibling)} of the same name is: the entry that names its schema is missing or wrong."
        )
        ledger.wrong("file.unrecognised", text, suggestion="export the files again, together")
        yield ledger


def _declared(contents: Sequence[Content]) -> frozenset[str]:
    """Return the names of the links that at least one file marks."""
    names: set[str] = set()
    for content in contents:
        names |= set(content.declared or ())
    return frozenset(names)


def _has_sampled_states(contents: Sequence[Content]) -> bool:
    for content in contents:
        for clip in content.clips:
            if clip.name == CLIP:
                return True
    return False


def _compare_still(
    contents: Sequence[Content], expected: FileMechanism, states: Callable[[], SampledStates] | None
) -> list[Content]:
    """Compare what is still with the mechanism; return the files whose links have other names in the end.

    That is the rest pose of every file; in files without motion also sampled states.
    """
    contents_with_other_names = []
    for content in contents:
        compare_joints(content, expected)
        if content.clips:
            continue
        mechanism = content.mechanism
        if states is not None and not same_names(_link_names(content), expected.links):
            compare_states(content, expected, states())
            if mechanism is not None and not same_names(mechanism.links, expected.links):
                contents_with_other_names.append(content)
    return contents_with_other_names


def _link_names(content: Content) -> set[str]:
    """Return the names of all links for which a file has a pose, or of which it states masses or joints."""
    names = set(content.rest)
    if content.mechanism is not None:
        names |= set(content.mechanism.links)
    for clip in content.clips:
        names |= set(clip.links)
    return names


def _compare_joints_between(contents: Sequence[Content]) -> None:
    """Compare the rest poses of the files with the joints of the first other file that states where all are."""
    for content in contents:
        # A file that another program has saved may be at the start of a motion, with other trocars than the joints.
        if content.declared is None or first_pose_of(content):
            continue
        for other in contents:
            mechanism = other.mechanism
            if mechanism is None or other.format == content.format or not mechanism.complete or not mechanism.joints:
                continue
            if all(joint.T is not None for joint in mechanism.joints):
                compare_joints(content, mechanism, other.file)
                break


def _check_placed(contents: Sequence[Content], expected: FileMechanism) -> None:
    """Report files whose geometry could not be compared with the mechanism: their agreement would be empty.

    A file with the robot's names is passed over if another finding tells its fault.
    """
    if all(joint.kind == "free" for joint in expected.joints):  # every pose of every body is possible
        return
    placed = _placed(contents)
    for content in contents:
        codes = {finding.code for finding in content.ledger.findings}
        if content.file in placed or "audit.not_compared" in codes:
            continue
        if same_names(_link_names(content), expected.links):
            if verdict(content.ledger.findings) != "agree":
                continue
            text = f"{content.file} has no pose that could be compared with {MECHANISM}"
            advice = "add a rest pose, or the motion of a protocol of the robot"
        else:
            text = (
                f"{content.file} could not be compared with {MECHANISM}: neither the names nor the structure of its "
                f"links and joints are those of {', '.join(expected.links[:3])}, …"
            )
            advice = "give links and joints the names of the robot, or audit the file with an export of the robot"
        content.ledger.add("audit.not_compared", "error", text, suggestion=advice)


def _placed(contents: Sequence[Content]) -> set[str]:
    """Return the files whose geometry was compared with the mechanism, or with the clips of such a file."""
    placed = {content.file for content in contents if content.ledger.placed}
    # A file can be compared with one that is itself only compared with a placed one: repeat until none is added.
    has_grown = True
    while has_grown:
        has_grown = False
        for content in contents:
            compared = {content.file}
            for check in content.ledger.checks:
                if check.check.startswith("clip ") and check.against:
                    compared.add(check.against)
            if compared & placed and not compared <= placed:
                placed |= compared
                has_grown = True
    return placed


def _gravity(contents: Sequence[Content], content: Content, mechanism: Mechanism | None) -> list[np.ndarray]:
    """Return the gravity (3,) in m/s2 of the mechanism and of the files in other formats than that of `content`."""
    gravities = []
    if mechanism is not None:
        gravities.append(np.array(mechanism.gravity))
    for other in contents:
        if other.format != content.format and other.mechanism is not None and other.mechanism.gravity is not None:
            gravities.append(other.mechanism.gravity)
    return gravities


def key_times(path: str | Path, xacro: XacroSettings | None = None) -> dict[str, np.ndarray]:
    """Return {clip: key times (k,) in s}, read from the tracks at a path; if there are no tracks, from the other files.

    Xacros among these are expanded with `xacro`.

    Raises:
        TwinError: the path does not exist, or has no file that can be audited.
    """
    folder_files = find_files(Path(path))
    tracks = _tracks(folder_files)
    if tracks.files:  # tracks contain all key times and are fast to read
        folder_files = tracks
    contents = []
    for _, content in _read(folder_files, _silent, None, xacro or XacroSettings()):
        if content is not None:
            contents.append(content)
    times = {}
    for name, ref in references(contents, {}).items():
        times[name] = ref.clip.times
    return times


def _tracks(folder_files: FolderFiles) -> FolderFiles:
    """Return the files whose values of joints no other file of their format has before them: the JSON tracks."""
    tracks: dict[str, list[Path]] = {}
    for format in audit_formats():
        if Holds.COORDINATES in format.holds:
            for file in folder_files.files.get(format.name, []):
                variant = format.variant(file)
                if variant is not None and is_leading_kind(variant.name):
                    tracks.setdefault(format.name, []).append(file)
    return FolderFiles(folder_files.root, tracks)


def _read(
    folder_files: FolderFiles,
    report_progress: Progress,
    states: Callable[[], SampledStates] | None,
    xacro: XacroSettings,
) -> Iterator[tuple[Ledger, Content | None]]:
    """Yield (ledger, content) for each file; content is None if the file could not be read."""
    jobs: list[tuple[Format, Path]] = []
    guarded_together: list[Path] = []
    for format in audit_formats():
        files = folder_files.files.get(format.name, [])
        for file in files:
            jobs.append((format, file))
        if format.guard:
            guarded_together += files
    if guarded_together:
        report_progress("test whether the stages can be opened", 0)
    context = Context(states=states, admitted=admit_together(guarded_together), xacro=xacro)
    for number, (format, path) in enumerate(jobs):
        name = folder_files.name(path)
        report_progress(f"read {name}", 0.9 * number / len(jobs))
        ledger = Ledger(name, code=format.code)
        context.models = [file.stem for file in folder_files.files[format.name]]
        with np.errstate(all="ignore"):
            content = guarded(partial(_filled, format, context), path, ledger)
        # Tracks are read before the files that need their joint values: `audit_formats` has them first.
        if content is not None and content.is_track:
            context.tracks.append(content)
        yield ledger, content


def _filled(format: Format, context: Context, path: Path, ledger: Ledger) -> Content | None:
    """Return the content of a file that is not empty and within the limits of its format."""
    variant = format.variant(path)
    if variant is not None:
        if not path.stat().st_size:
            raise ReadError("the file is empty", "file.empty")
        check_size(path, variant.syntax, variant.budget)
    return format.module("audit").read(path, ledger, context)
