"""Base class of the results of commands and API functions: verdict, findings, data, tables."""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from twin.core.findings import EXIT_CODES, Finding, Verdict, by_severity, verdict
from twin.core.json_types import JsonMapping, JsonObject


@dataclass(frozen=True)
class TextTable:
    """Rows of text below a header; `fit`: whether a terminal may cut long lines."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    fit: bool = False

    def records(self) -> list[dict[str, str]]:
        """Return the rows as plain data, by the names in the header."""
        return [dict(zip(self.header, row, strict=True)) for row in self.rows]


@dataclass(frozen=True)
class Line:
    """A line of text, and the name of its style in rich, the library for terminals."""

    text: str
    style: str = ""


Part = str | Line | TextTable | Finding
"""One part of the text of a result."""


class Result(ABC):
    """Base class of the results of commands and API functions.

    `twin <command> --json` prints `as_dict`. `twin.cli.show.finish` prints the text and returns the exit code of a
    command; `twin.ui.report.report_folder.write_result` writes the JSON file.

    Attributes:
        judges: whether the result has a verdict; measurements and comparisons have no verdict.
        kind: name of the command; the schema of the data is twin/<kind>/1, and the file is <kind>.json.
    """

    kind: ClassVar[str]
    judges: ClassVar[bool] = True

    if TYPE_CHECKING:
        # A sequence of findings, from which the verdict is computed: a field in some subclasses, a property in others.
        findings: Any

    @property
    def verdict(self) -> Verdict:
        """The verdict: "agree", "disagree", or "unchecked" if something could not be judged."""
        return verdict(self.findings)

    @property
    def word(self) -> str:
        """The verdict as text."""
        return {"agree": "Agrees", "disagree": "Disagrees", "unchecked": "Could not be checked"}[self.verdict]

    @property
    def summary(self) -> str:
        """A sentence that the page shows below the verdict; empty if the findings say everything."""
        return ""

    @property
    def key_figures(self) -> tuple[tuple[str, str, str], ...]:
        """(Name, value, remark) of the numbers with which the page begins; () for none."""
        return ()

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 agree, 1 disagree, 2 could not check."""
        return EXIT_CODES[self.verdict]

    @abstractmethod
    def content(self) -> JsonMapping:
        """Return the result as plain data for JSON, without schema, verdict and findings."""

    @abstractmethod
    def text(self) -> Iterator[Part]:
        """Yield the parts of the result's text, in order."""

    def as_dict(self) -> JsonObject:
        """Return the result as plain data for JSON, with the most severe findings first."""
        return record(self.kind, self.content(), self.findings, self.verdict)

    def _repr_html_(self) -> str:
        """Return the result as a notebook shows it: the verdict, then the parts of the text."""
        parts = []
        if self.judges:
            color = {"agree": "#1a7f37", "disagree": "#cf222e", "unchecked": "#9a6700"}[self.verdict]
            parts.append(f'<b style="color: {color}">{escape(self.word)}</b> {escape(self.summary)}')
        parts += _html_of(self.text())
        return f"<div>{''.join(parts)}</div>"

    def to_json(self) -> str:
        """Return `as_dict` as JSON text."""
        return as_json(self.as_dict())

    def write(self, folder: Path) -> None:  # noqa: B027 - most have nothing
        """Write data files other than the JSON (curves as CSV, point clouds); the base class writes none."""


def _html_row(tag: str, cells: Iterable[object]) -> str:
    """Return a row of a table; `tag` is "th" for its header, else "td"."""
    parts = [f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells]
    return f"<tr>{''.join(parts)}</tr>"


def _html_of(text: Iterable[Part]) -> list[str]:
    """Return the parts of a text as HTML: tables, and the lines between them together."""
    parts: list[str] = []
    lines: list[str] = []
    for part in text:
        if isinstance(part, TextTable):
            parts += _html_block(lines)
            lines = []
            parts.append(_html_table(part))
        elif isinstance(part, Finding):
            lines.append(f"{part.severity}: {part.message}")
            if part.suggestion:
                lines.append(f"    {part.suggestion}")
        elif isinstance(part, Line):
            lines.append(part.text)
        else:
            lines.append(part)
    return parts + _html_block(lines)


def _html_block(lines: Sequence[str]) -> list[str]:
    """Return lines of text as one block, without empty lines at its ends; nothing if it has no text."""
    text = "\n".join(lines).strip("\n")
    if not text.strip():
        return []
    # long lines are wrapped: a notebook or page would be wider than its window
    return [f'<pre style="white-space: pre-wrap">{escape(text)}</pre>']


def _html_table(table: TextTable) -> str:
    """Return a table as HTML."""
    rows = []
    if table.header:
        rows.append(_html_row("th", table.header))
    for row in table.rows:
        rows.append(_html_row("td", row))
    return f"<table>{''.join(rows)}</table>"


def record(
    kind: str, content: JsonMapping, findings: Sequence[Finding] = (), judged: Verdict | None = None
) -> JsonObject:
    """Return the plain data that every `--json` prints, as described by docs/schemas/result.schema.json.

    Args:
        kind: name of the schema, twin/<kind>/1.
        content: {key: data} of this kind.
        findings: findings in any order; the returned list begins with the most severe.
        judged: the verdict; None: the verdict is computed from the findings.
    """
    if judged is None:
        judged = verdict(findings)
    return {
        "schema": f"twin/{kind}/1",
        "verdict": judged,
        **content,
        "findings": [finding.as_dict() for finding in by_severity(findings)],
    }


def as_json(data: Any) -> str:
    """Return plain data as JSON text; numbers that are not finite become null, because JSON cannot express them."""
    return json.dumps(_plain(data), indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    """Return a value without what JSON lacks: infinity and NaN become None, tuples lists, and keys text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return list(map(_plain, value))
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
