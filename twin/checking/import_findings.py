"""Findings on what the import and the audit read of a description, without those that rules on elements have told."""

from __future__ import annotations

import re
from collections.abc import Iterator

from twin.checking.check_finding import CheckFinding
from twin.checking.error_messages import line_in, without_path
from twin.checking.judge_job import JudgeJob
from twin.checking.mechanism_rules import check_limits_contain_zero, check_masses, check_open_loops
from twin.core.errors import (
    BudgetError,
    TwinError,
)
from twin.exchange.read.imported_robot import IS_MISSING, ITS_MESH_IS_MISSING, Imported

_NO_MESH_FILE = re.compile(r"was not found|is not a file of type")
"""What the import says of a mesh that does not exist, for which another rule knows packages, or of an unread format."""

_MISSING_MESH = re.compile(rf"\b{IS_MISSING}[:;]")
"""What the import of an MJCF says of a mesh that does not exist."""

_FAULT_SEVERITY = "disagreement"
"""Severity of the findings of an audit that are faults."""

_CODES_OF_OTHER_RULES = re.compile(
    r"mjcf\.(control|keyframe)|stage\.|"
    r"urdf\.(mesh|tree|duplicate_name|limits|driven)|physics\.(mass|inertia|moment|triangle)|"
    r"\w+\.(mesh|texture)|.*not_positive|.*drive_negative|.*triangle"
)
"""Codes of an audit whose faults other rules find, with lines and with the packages of the folder; and those of
conventions that files of other authors need not keep: scaled controls, key frames beyond limits, units of a stage."""


def import_findings(job: JudgeJob, imported: Imported) -> Iterator[CheckFinding]:
    """Yield findings on inertias, meshes, loops, limits and masses of what was imported."""
    name = job.description.name
    missing: set[str] = set()
    printed = bool(job.description.root)  # the rules for elements have judged its inertias and limits
    for finding in imported.findings:
        if finding.code == "import.inertia" and not printed and ITS_MESH_IS_MISSING not in finding.message:
            rule = "inertia/triangle" if "triangle" in finding.message else "inertia/positive"
            if "principal moment 0 kg" in finding.message:
                rule = "inertia/zero"
            yield CheckFinding(rule, name, f"link '{finding.where}'", finding.message)
        if finding.code != "import.mesh":
            continue
        if _MISSING_MESH.search(finding.message):  # told for each body: once is enough
            missing.add(finding.where)
        elif not _NO_MESH_FILE.search(finding.message):
            yield CheckFinding("mesh/unreadable", name, f"mesh '{finding.where}'", finding.message)
    for mesh in sorted(missing):
        yield CheckFinding("mesh/missing", name, f"mesh '{mesh}'", f"mesh '{mesh}' does not exist")
    yield from check_open_loops(imported, name)
    if not printed:
        yield from check_limits_contain_zero(imported.mechanism, name)
    yield from check_masses(imported.mechanism, name)


def audit_findings(job: JudgeJob) -> Iterator[CheckFinding]:
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
        text = f"the independent reader of an audit refuses the file: {without_path(job.description, str(error))}"
        yield CheckFinding("audit/fault", name, "", message=text, line=line_in(str(error)))
        return
    for finding in report.findings:
        if finding.severity == _FAULT_SEVERITY and not _CODES_OF_OTHER_RULES.match(finding.code):
            subject = finding.where or finding.code
            yield CheckFinding("audit/fault", name, subject, f"{finding.message} [{finding.code}]")
