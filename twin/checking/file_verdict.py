"""All rules on one file: those on its elements, then those on the mechanism that the import and the audit read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from twin.checking.check_finding import CheckFinding
from twin.checking.descriptions import DescriptionFile
from twin.checking.element_places import place_function, with_places
from twin.checking.elements import Elements, check_elements
from twin.checking.error_messages import line_in, without_path
from twin.checking.import_findings import audit_findings, import_findings
from twin.checking.judge_job import JudgeJob
from twin.checking.mechanism_rules import check_limits_contain_zero
from twin.checking.mesh_findings import missing_meshes
from twin.checking.places import within
from twin.core.errors import (
    BudgetError,
    CodeRefusedError,
    IncompleteError,
    NoMechanismError,
    SourceError,
    TwinError,
    UnsupportedError,
)
from twin.core.foreign.text import parse_xml
from twin.exchange.xacro import Expanded, XacroSettings, expand, is_xacro
from twin.model.mechanism import Mechanism

Status = Literal["judged", "no robot", "incomplete", "unsupported", "unjudged", "part"]

_REFUSAL_TEXTS = {
    "limits/order": "is not below the upper limit",
    "limits/fixed": "is not below the upper limit",
    "axis/zero": "the axis has length 0",
    "mimic/leader": ", mimic: ",
    "names/duplicate": "the name is used twice",
    "names/unknown": "there is no link|the joint has no <|the file has no <link>",
    "names/tree": "is the child of two joints|expected one root link",
}
"""{rule: what a reader says of its fault}: the reader then refuses the file for the reason that the rule has told."""

_NAMED_ELEMENT = re.compile(r"(joint|link|body) '[^']+'")
"""Beginning of the error of a reader that is about an element."""

_READER_FAILURE = re.compile(r"parser crashed|exceeded its limit|waited for")


@dataclass(frozen=True)
class JudgedFile:
    """What was found in one file.

    Attributes:
        description: the file.
        status: "judged"; "no robot" or "part" (nothing to judge); "incomplete" (arguments or packages are missing),
            "unsupported" (not imported), "unjudged" (over a limit).
        findings: the findings.
        robot: name of the robot, if it was imported.
        joints: names of its moving joints.
    """

    description: DescriptionFile
    status: Status
    findings: tuple[CheckFinding, ...] = ()
    robot: str = ""
    joints: tuple[str, ...] = ()


def judge(job: JudgeJob) -> JudgedFile:
    """Return the findings on one file."""
    judged = _judge(job)
    findings: list[CheckFinding] = []
    for finding in judged.findings:
        findings.append(replace(finding, message=within(job.tree.folder, finding.message)))
    return replace(judged, findings=tuple(findings))


def _judge(job: JudgeJob) -> JudgedFile:
    """Return the findings on one file, in which messages still have absolute paths."""
    description = job.description
    name = description.name
    try:
        if description.kind == "folder":
            return _robot_folder(job)
        if description.root:
            return _judged_markup(job)
        judged = _imported(job, ())
        if description.kind == "mjcf":
            judged = _mjcf_places(job, _unless_part(job, judged))
        return judged
    except CodeRefusedError as error:
        return _unjudged(description, str(error))
    except BudgetError as error:
        return _unjudged(description, str(error))
    except OSError as error:
        return _unjudged(description, f"cannot be read ({error.strerror or error})")
    except RecursionError:
        finding = CheckFinding("file/malformed", name, "", "the elements are nested too deeply")
        return JudgedFile(description, "judged", (finding,))


def judged_stream(job: JudgeJob) -> Iterator[JudgedFile]:
    """Yield the result of one file, for `twin.core.jobs.Stream`."""
    yield judge(job)


def _unjudged(description: DescriptionFile, message: str) -> JudgedFile:
    """Return the result of a file that could not be judged, with the reason."""
    text = without_path(description, message)
    return JudgedFile(description, "unjudged", (CheckFinding("file/unjudged", description.name, "", text),))


# -- texts: URDF, xacro, SDF ----------------------------------------------------------------------


def _judged_markup(job: JudgeJob) -> JudgedFile:
    """Return the findings on a URDF, a xacro or a SDF, whose elements have rules with lines."""
    from twin.exchange.read.xml_file import Xml

    description = job.description
    path = description.path
    tag = description.root
    expanded: Expanded | None = None
    try:
        if tag == "robot" and is_xacro(path):
            expanded, settings = _expanded(job)
            job = replace(job, xacro=settings)
        data = path.read_bytes() if expanded is None else expanded.data
        root = Xml(path, tag, None if expanded is None else data).root
    except SourceError as error:
        return _refused_file(description, error)
    if expanded is not None and expanded.omitted:
        text = expanded.omitted[0]
        if len(expanded.omitted) > 1:
            text += f" And {len(expanded.omitted) - 1} more are missing."
        finding = CheckFinding("file/incomplete", description.name, "", text)
        return JudgedFile(description, "incomplete", (finding,))
    links = _parts(root, "link")
    joints = _parts(root, "joint")
    if not links and not joints:
        named = root.get("name")  # without a name, it is for others to include
        if description.kind == "urdf" and expanded is None and named:
            finding = CheckFinding("file/malformed", description.name, "", "the file has no <link>: it is empty")
            return JudgedFile(description, "judged", (finding,))
        return JudgedFile(description, "no robot")
    elements = Elements(root, tag == "sdf", place_function(job, data, root, expanded))
    findings = list(check_elements(elements))
    findings += missing_meshes(job, elements)
    if not joints:
        return JudgedFile(description, "judged", tuple(findings))
    judged = _imported(job, findings)
    return replace(judged, findings=tuple(with_places(judged.findings, elements)))


def _expanded(job: JudgeJob) -> tuple[Expanded, XacroSettings]:
    """Return the URDF of a xacro, and the settings that made it.

    Where packages are not beside the file, those in the whole checked folder are searched, and taken if the xacro is
    complete with them.

    Raises:
        SourceError, BudgetError, CodeRefusedError: as `expand`.
    """
    path = job.description.path
    first: Expanded | None = None
    refused: IncompleteError | None = None
    try:
        first = expand(path, job.xacro)
    except IncompleteError as error:
        refused = error
    if first is not None and not first.omitted:
        return first, job.xacro
    with_folder = replace(job.xacro, packages=(*job.xacro.packages, job.tree.folder))
    try:
        second = expand(path, with_folder)
        if not second.omitted:
            return second, with_folder
    except (SourceError, BudgetError):  # a package of this name in another place need not be the one that is meant
        pass
    if refused is not None:
        raise refused
    assert first is not None
    return first, job.xacro


def _parts(root: Element, kind: str) -> list[Element]:
    """Return the links or joints of a URDF, or of all models of a SDF; those of plug-ins and transmissions are none."""
    elements = list(root.findall(kind))
    for model in root.iter("model"):
        elements += model.findall(kind)
    return elements


def _unless_part(job: JudgeJob, judged: JudgedFile) -> JudgedFile:
    """Return the findings on a MJCF; those on a part of other files, which has no sense by itself, are told there."""
    if job.description.path not in job.tree.parts:
        return judged
    rules = [finding.rule for finding in judged.findings]
    if "file/malformed" not in rules and "mesh/missing" not in rules:  # it is complete by itself
        return judged
    return JudgedFile(job.description, "part")


def _mjcf_places(job: JudgeJob, judged: JudgedFile) -> JudgedFile:
    """Return the findings on a MJCF with lines, if its elements are in the file and not in one that it includes."""
    data = job.description.path.read_bytes()
    try:
        root = parse_xml(job.description.path, data)
    except (ElementTree.ParseError, ValueError, LookupError, BudgetError):
        return judged
    elements = Elements(root, False, place_function(job, data, root, None))
    return replace(judged, findings=tuple(with_places(judged.findings, elements)))


def _refused_file(description: DescriptionFile, error: SourceError) -> JudgedFile:
    """Return the result of a file that a reader refuses: unjudged, incomplete, unsupported or malformed."""
    message = str(error)
    if _READER_FAILURE.search(message):
        return _unjudged(description, message)
    text = without_path(description, message)
    if isinstance(error, IncompleteError):
        return JudgedFile(description, "incomplete", (CheckFinding("file/incomplete", description.name, "", text),))
    if isinstance(error, UnsupportedError):
        return JudgedFile(description, "unsupported", (CheckFinding("file/unsupported", description.name, "", text),))
    finding = CheckFinding("file/malformed", description.name, "", message=text, line=line_in(message))
    return JudgedFile(description, "judged", (finding,))


# -- the import -----------------------------------------------------------------------------------


def _imported(job: JudgeJob, findings: list[CheckFinding] | tuple[()]) -> JudgedFile:
    """Return the findings of the elements with those of the import and the audit."""
    from twin.exchange.read import read
    from twin.exchange.read.loop_closing import close

    description = job.description
    path = description.path
    collected = list(findings)
    settings = job.xacro if description.kind == "xacro" else None
    if settings is not None and not settings.given:
        settings = None
    try:
        imported = read(path, xacro=settings)
        # other mechanisms are assembled as they are drawn
        if imported.mechanism.loops or imported.mechanism.couplings:
            imported = close(imported)
    except (BudgetError, CodeRefusedError):
        raise
    except TwinError as error:
        return _not_imported(job, collected, error)
    collected += import_findings(job, imported)
    if description.kind != "dh":  # no independent reader knows tables
        collected += audit_findings(job)
    mechanism = imported.mechanism
    moving = _moving_joints(mechanism)
    return JudgedFile(description, status="judged", findings=tuple(collected), robot=mechanism.name, joints=moving)


def _moving_joints(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the revolute and prismatic joints, sorted: by these, files of one robot are found."""
    names = []
    for joint in mechanism.joints:
        if joint.type in ("revolute", "prismatic"):
            names.append(joint.name)
    return tuple(sorted(names))


def _not_imported(job: JudgeJob, findings: list[CheckFinding], error: TwinError) -> JudgedFile:
    """Return the result of a file that the import refuses; `findings` are those of its elements."""
    description = job.description
    name = description.name
    message = str(error)
    text = without_path(description, message)
    if _READER_FAILURE.search(text):
        unjudged = _unjudged(description, message)
        return replace(unjudged, findings=(*findings, *unjudged.findings))
    if isinstance(error, NoMechanismError):
        status: Status = "judged" if findings else "no robot"
        return JudgedFile(description, status, tuple(findings))
    if isinstance(error, IncompleteError):
        finding = CheckFinding("file/incomplete", name, "", message=text, line=line_in(message))
        return JudgedFile(description, "incomplete", (*findings, finding))
    if isinstance(error, UnsupportedError):
        finding = CheckFinding("file/unsupported", name, "", message=text, line=line_in(message))
        return JudgedFile(description, "unsupported", (*findings, finding))
    if not _is_told(text, findings):
        element = _NAMED_ELEMENT.match(text)
        subject = "" if element is None else element[0]
        findings.append(CheckFinding("file/malformed", name, subject, message=text, line=line_in(message)))
    return JudgedFile(description, "judged", tuple(findings))


def _is_told(text: str, findings: Sequence[CheckFinding]) -> bool:
    """Return whether a finding tells the fault for which a reader refuses the file with a text."""
    for finding in findings:
        refusal = _REFUSAL_TEXTS.get(finding.rule)
        if refusal is None or not re.search(refusal, text):
            continue
        if finding.rule == "names/tree" or finding.subject in text or "no <link>" in text:
            return True
    return False


def _robot_folder(job: JudgeJob) -> JudgedFile:
    """Return the findings on a robot folder of twin: whether its description and its CAD can be read."""
    from twin.api.robot_loading import load

    description = job.description
    try:
        robot = load(description.path)
        mechanism = robot.mechanism
    except (BudgetError, CodeRefusedError):
        raise
    except TwinError as error:
        text = without_path(description, str(error))
        finding = CheckFinding("file/malformed", description.name, "", message=text, line=line_in(str(error)))
        return JudgedFile(description, "judged", (finding,))
    moving = _moving_joints(mechanism)
    findings = tuple(check_limits_contain_zero(mechanism, description.name))
    return JudgedFile(description, status="judged", findings=findings, robot=robot.name, joints=moving)
