"""All rules on one file: those on its elements, then those on the mechanism that the import and the audit read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from twin.checking.check_finding import CheckFinding
from twin.checking.descriptions import DescriptionFile, FolderContent, find_mesh
from twin.checking.elements import ElementPlace, Elements, check_elements
from twin.checking.mechanisms import check_loops, check_masses, check_zero
from twin.checking.places import element_lines, within
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
from twin.core.identifiers import identifier
from twin.exchange.read.imported_robot import Imported
from twin.exchange.xacro import Expanded, XacroSettings, expand, is_xacro
from twin.model.mechanism import Mechanism

Status = Literal["judged", "no robot", "incomplete", "unsupported", "unjudged", "part"]

_REFUSALS = {
    "limits/order": "is not below the upper limit",
    "limits/fixed": "is not below the upper limit",
    "axis/zero": "the axis has length 0",
    "mimic/leader": ", mimic: ",
    "names/duplicate": "the name is used twice",
    "names/unknown": "there is no link|the joint has no <|the file has no <link>",
    "names/tree": "is the child of two joints|expected one root link",
}
"""{rule: what a reader says of its fault}: the reader then refuses the file for the reason that the rule has told."""

_ABSENT = re.compile(r"was not found|is not a file of type")
"""What the import says of a mesh that does not exist, for which another rule knows packages, or of an unread format."""

_ELEMENT = re.compile(r"(joint|link|body) '[^']+'")
"""Beginning of the error of a reader that is about an element."""

_MISSING_MESH = re.compile(r"\bis missing[:;]")
"""What the import of a MJCF says of a mesh that does not exist."""

_WITHOUT_MESH = re.compile(r"because its mesh is missing")
"""What it says of a body whose mass is that of such a mesh."""

_CRASH = re.compile(r"parser crashed|exceeded its limit|waited for")

_FAULT = "disagreement"
"""Severity of the findings of an audit that are faults."""

_OTHER_RULES = re.compile(
    r"mjcf\.(control|keyframe)|stage\.|"
    r"urdf\.(mesh|tree|duplicate_name|limits|driven)|physics\.(mass|inertia|moment|triangle)|"
    r"\w+\.(mesh|texture)|.*not_positive|.*drive_negative|.*triangle"
)
"""Codes of an audit whose faults other rules find, with lines and with the packages of the folder; and those of
conventions that files of other authors need not keep: scaled controls, key frames beyond limits, units of a stage."""


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


@dataclass(frozen=True)
class JudgeJob:
    """A file to judge, in its tree."""

    description: DescriptionFile
    tree: FolderContent
    xacro: XacroSettings


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
    text = _without_path(description, message)
    return JudgedFile(description, "unjudged", (CheckFinding("file/unjudged", description.name, "", text),))


def _without_path(description: DescriptionFile, message: str) -> str:
    """Return a message without the path of the file at its beginning; of `PATH:12: ...`, "line 12: ..." remains."""
    path = str(description.path)
    if message.startswith(f"{path}: "):
        return message[len(path) + 2 :]
    if re.match(r":\d", message.removeprefix(path)):
        return f"line {message[len(path) + 1 :]}"
    return message


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
    elements = Elements(root, tag == "sdf", _place_function(job, data, root, expanded))
    findings = list(check_elements(elements))
    findings += _missing_meshes(job, elements)
    if not joints:
        return JudgedFile(description, "judged", tuple(findings))
    judged = _imported(job, findings)
    return replace(judged, findings=tuple(_with_places(judged.findings, elements)))


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


def _with_places(findings: Sequence[CheckFinding], elements: Elements) -> Iterator[CheckFinding]:
    """Yield the findings of the import with the lines of the links and joints that they name."""
    named: dict[str, tuple[Element, str]] = {}
    for element in elements.root.iter():
        name = element.get("name")
        if name and element.tag in ("link", "joint", "body", "geom", "connect", "weld"):
            named.setdefault(f"{element.tag} '{identifier(name)}'", (element, f"{element.tag}/{name}"))
    for finding in findings:
        # a MJCF calls its links bodies
        named_element = named.get(finding.subject) or named.get(finding.subject.replace("link '", "body '"))
        if finding.line or named_element is None:
            yield finding
            continue
        file, line = elements.place(*named_element)
        yield replace(finding, file=file, line=line)


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
    elements = Elements(root, False, _place_function(job, data, root, None))
    return replace(judged, findings=tuple(_with_places(judged.findings, elements)))


def _refused_file(description: DescriptionFile, error: SourceError) -> JudgedFile:
    """Return the result of a file that a reader refuses: unjudged, incomplete, unsupported or malformed."""
    message = str(error)
    if _CRASH.search(message):
        return _unjudged(description, message)
    text = _without_path(description, message)
    if isinstance(error, IncompleteError):
        return JudgedFile(description, "incomplete", (CheckFinding("file/incomplete", description.name, "", text),))
    if isinstance(error, UnsupportedError):
        return JudgedFile(description, "unsupported", (CheckFinding("file/unsupported", description.name, "", text),))
    finding = CheckFinding("file/malformed", description.name, "", message=text, line=_line_in(message))
    return JudgedFile(description, "judged", (finding,))


def _line_in(message: str) -> int:
    """Return the line that a message names; 0 if it names none."""
    line = re.search(r"\bline (\d+)|\.(?:xacro|urdf|sdf|xml):(\d+)", message)
    if line is None:
        return 0
    return int(line[1] or line[2])


def _place_function(job: JudgeJob, data: bytes, root: Element, expanded: Expanded | None) -> ElementPlace:
    """Return the function that tells where an element is: in the file, or in the xacro that made it."""
    name = job.description.name
    lines: dict[Element, int] = {}
    if expanded is None:
        lines = element_lines(data, root)
    folder = job.tree.folder.resolve()

    def place(element: Element, path: str) -> tuple[str, int]:
        if expanded is None:
            return name, lines.get(element, 0)
        parts = path.split("/")
        while parts:
            place_in_xacro = expanded.places.get("/".join(parts))
            if place_in_xacro is not None:
                file, line = place_in_xacro
                return _relative(file, folder, name), line
            parts.pop()
        return name, 0

    return place


def _relative(file: str, folder: Path, name: str) -> str:
    """Return a file relative to the checked folder; `name` if it is not inside."""
    try:
        return Path(file).resolve().relative_to(folder).as_posix()
    except ValueError:
        return name


def _missing_meshes(job: JudgeJob, elements: Elements) -> Iterator[CheckFinding]:
    """Yield the meshes that do not exist; those of packages that are not in the folder as one note."""
    path = job.description.path
    outside: dict[str, int] = {}
    for link in elements.root.iter("link"):
        name = link.get("name", "")
        for mesh in link.iter("mesh"):
            address = mesh.get("filename")
            if elements.sdf:
                address = (mesh.findtext("uri") or "").strip()
            if not address:
                continue
            found_mesh = find_mesh(address, path.parent, job.tree)
            if found_mesh.path is not None:
                continue
            if found_mesh.outside:
                _, _, path_in_tree = address.partition("://")
                package, _, _ = path_in_tree.lstrip("/").partition("/")
                outside[package] = outside.get(package, 0) + 1
                continue
            text = f"mesh '{address}' does not exist"
            if found_mesh.similar:
                text += f"; there is '{found_mesh.similar}'"
            yield elements.finding("mesh/missing", mesh, f"link/{name}", f"link '{name}'", text)
    for package, count in outside.items():
        text = f"{count} meshes are in package '{package}', which is not in the folder"
        yield CheckFinding("mesh/outside", job.description.name, f"package '{package}'", text)


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
    collected += _of_import(job, imported)
    if description.kind != "dh":  # no independent reader knows tables
        collected += _of_audit(job)
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
    text = _without_path(description, message)
    if _CRASH.search(text):
        unjudged = _unjudged(description, message)
        return replace(unjudged, findings=(*findings, *unjudged.findings))
    if isinstance(error, NoMechanismError):
        status: Status = "judged" if findings else "no robot"
        return JudgedFile(description, status, tuple(findings))
    if isinstance(error, IncompleteError):
        finding = CheckFinding("file/incomplete", name, "", message=text, line=_line_in(message))
        return JudgedFile(description, "incomplete", (*findings, finding))
    if isinstance(error, UnsupportedError):
        finding = CheckFinding("file/unsupported", name, "", message=text, line=_line_in(message))
        return JudgedFile(description, "unsupported", (*findings, finding))
    if not _is_told(text, findings):
        element = _ELEMENT.match(text)
        subject = "" if element is None else element[0]
        findings.append(CheckFinding("file/malformed", name, subject, message=text, line=_line_in(message)))
    return JudgedFile(description, "judged", tuple(findings))


def _is_told(text: str, findings: Sequence[CheckFinding]) -> bool:
    """Return whether a finding tells the fault for which a reader refuses the file with a text."""
    for finding in findings:
        refusal = _REFUSALS.get(finding.rule)
        if refusal is None or not re.search(refusal, text):
            continue
        if finding.rule == "names/tree" or finding.subject in text or "no <link>" in text:
            return True
    return False


def _of_import(job: JudgeJob, imported: Imported) -> Iterator[CheckFinding]:
    """Yield findings on inertias, meshes, loops, limits and masses of what was imported."""
    name = job.description.name
    missing: set[str] = set()
    printed = bool(job.description.root)  # the rules for elements have judged its inertias and limits
    for finding in imported.findings:
        if finding.code == "import.inertia" and not printed and not _WITHOUT_MESH.search(finding.message):
            rule = "inertia/triangle" if "triangle" in finding.message else "inertia/positive"
            if "principal moment 0 kg" in finding.message:
                rule = "inertia/zero"
            yield CheckFinding(rule, name, f"link '{finding.where}'", finding.message)
        if finding.code != "import.mesh":
            continue
        if _MISSING_MESH.search(finding.message):  # told for each body: once is enough
            missing.add(finding.where)
        elif not _ABSENT.search(finding.message):
            yield CheckFinding("mesh/unreadable", name, f"mesh '{finding.where}'", finding.message)
    for mesh in sorted(missing):
        yield CheckFinding("mesh/missing", name, f"mesh '{mesh}'", f"mesh '{mesh}' does not exist")
    yield from check_loops(imported, name)
    if not printed:
        yield from check_zero(imported.mechanism, name)
    yield from check_masses(imported.mechanism, name)


def _of_audit(job: JudgeJob) -> Iterator[CheckFinding]:
    """Yield the faults that an independent reader finds, except those that other rules tell."""
    from twin.exchange.audit import audit
    from twin.exchange.formats import audit_formats

    name = job.description.name
    path = job.description.path
    suffixes: list[str] = []
    for format in audit_formats():
        for variant in format.variants:
            suffixes.append(variant.suffix)
    if path.suffix.lower() not in suffixes:
        return
    try:
        report = audit(path, xacro=job.xacro)
    except BudgetError:
        raise
    except TwinError as error:
        text = f"the independent reader of an audit refuses the file: {_without_path(job.description, str(error))}"
        yield CheckFinding("audit/fault", name, "", message=text, line=_line_in(str(error)))
        return
    for finding in report.findings:
        if finding.severity == _FAULT and not _OTHER_RULES.match(finding.code):
            subject = finding.where or finding.code
            yield CheckFinding("audit/fault", name, subject, f"{finding.message} [{finding.code}]")


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
        text = _without_path(description, str(error))
        finding = CheckFinding("file/malformed", description.name, "", message=text, line=_line_in(str(error)))
        return JudgedFile(description, "judged", (finding,))
    moving = _moving_joints(mechanism)
    findings = tuple(check_zero(mechanism, description.name))
    return JudgedFile(description, status="judged", findings=findings, robot=robot.name, joints=moving)
