"""JUnit XML, which servers for continuous integration show as a list of tests: one test for each file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree

from twin.checking.check_finding import CheckFinding, readable
from twin.checking.file_verdict import JudgedFile
from twin.checking.rules import LEVELS, Level

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot contain."""


def junit(judged: Sequence[JudgedFile], findings: Sequence[CheckFinding], fail_on: Level) -> str:
    """Return the files as test cases; a new finding of at least the level `fail_on` is a failure."""
    by_file: dict[str, list[CheckFinding]] = {}
    for file in judged:  # a file without findings is a test that passes
        by_file[file.description.name] = []
    for finding in findings:
        by_file.setdefault(finding.file, []).append(finding)
    skipped_files: dict[str, str] = {}
    for file in judged:
        if file.status in ("incomplete", "unsupported"):
            skipped_files[file.description.name] = file.status
    failures = 0
    errors = 0
    skipped = 0
    suite = ElementTree.Element("testsuite", name="twin check")
    for name in sorted(by_file):
        case = ElementTree.SubElement(suite, "testcase", name=_clean(name), classname="twin.check", file=_clean(name))
        failing = []
        unjudged = []
        for finding in by_file[name]:
            if fails(finding, fail_on):
                failing.append(finding)
            if finding.rule == "file/unjudged":
                unjudged.append(finding)
        if unjudged:  # an error: the test itself could not be made
            errors += 1
            _add(case, "error", unjudged)
        elif failing:
            failures += 1
            _add(case, "failure", failing)
        elif name in skipped_files:
            skipped += 1
            ElementTree.SubElement(case, "skipped", message=skipped_files[name])
    counts = {"tests": len(by_file), "failures": failures, "errors": errors, "skipped": skipped}
    for key, count in counts.items():
        suite.set(key, str(count))
    suites = ElementTree.Element("testsuites", suite.attrib)
    suites.append(suite)
    ElementTree.indent(suites)
    text = ElementTree.tostring(suites, "unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def fails(finding: CheckFinding, fail_on: Level) -> bool:
    """Return whether a finding is new and at least of a level."""
    return not finding.known and LEVELS.index(finding.level) >= LEVELS.index(fail_on)


def _add(case: ElementTree.Element, tag: str, findings: Sequence[CheckFinding]) -> None:
    """Add an element with the texts of all findings; its message, which lists of tests show, is that of the first."""
    first = findings[0]
    element = ElementTree.SubElement(case, tag, message=_clean(first.message), type=first.rule)
    lines: list[str] = []
    for finding in findings:
        lines.append(f"{finding.place}: {finding.level}: {finding.message} [{finding.rule}] {finding.advice}")
    element.text = _clean("\n".join(lines))


def _clean(text: str) -> str:
    """Return a text that XML can contain: names of files may have any characters."""
    return _FORBIDDEN.sub("?", readable(text))
