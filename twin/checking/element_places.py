"""Where the elements of a description are: the file and the line of each, also of those that a xacro made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from twin.checking.check_finding import CheckFinding
from twin.checking.elements import ElementPlace, Elements
from twin.checking.judge_job import JudgeJob
from twin.checking.places import element_lines
from twin.core.identifiers import identifier
from twin.exchange.xacro import Expanded


def with_places(findings: Sequence[CheckFinding], elements: Elements) -> Iterator[CheckFinding]:
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


def place_function(job: JudgeJob, data: bytes, root: Element, expanded: Expanded | None) -> ElementPlace:
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
                return _relative_file(file, folder, name), line
            parts.pop()
        return name, 0

    return place


def _relative_file(file: str, folder: Path, name: str) -> str:
    """Return a file relative to the checked folder; `name` if it is not inside."""
    try:
        return Path(file).resolve().relative_to(folder).as_posix()
    except ValueError:
        return name
