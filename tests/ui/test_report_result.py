"""Any result as a page: every command that answers writes one, and it needs nothing else."""

from __future__ import annotations

import re
from dataclasses import dataclass

import pytest

from twin.core.findings import Finding
from twin.core.result import Line, Result, TextTable
from twin.ui.report.page import merged, render
from twin.ui.report.report_folder import write_result


@dataclass(frozen=True)
class Measured(Result):
    """A result of a test."""

    findings: tuple[Finding, ...] = ()

    kind = "measured"

    def content(self):
        return {"value": float("nan")}

    def text(self):
        yield "arm · <measured>\n\n  first"
        yield Line("second", "bold")
        yield from self.findings
        yield TextTable(("what", "size"), [("a & b", "1 mm")])
        yield ""
        yield "last"


WRONG = Finding(
    "arm.length", "disagreement", "the arm is 3 mm too long", "elbow", size=3.0, unit="mm", suggestion="cut"
)


@pytest.mark.parametrize(("found", "word"), [((), "Agrees"), ((WRONG,), "Disagrees")])
def test_a_page_shows_verdict_findings_lines_and_tables(found, word):
    page = render(Measured(found), "measured")
    assert "<h1>arm · &lt;measured&gt;</h1>" in page
    assert f'<p class="word">{word}</p>' in page
    assert "<pre>  first\nsecond</pre>" in page
    assert "<td>a &amp; b</td>" in page
    assert ("the arm is 3 mm too long" in page) == bool(found)
    assert not re.search(r"<script|(?:src|href)=", page), "a page needs nothing else"
    assert page == render(Measured(found), "measured")


def test_lines_between_tables_are_one_block():
    assert [p for p in merged(["a", Line("b"), "", TextTable((), []), "", "c"]) if isinstance(p, str)] == ["a\nb", "c"]


@dataclass(frozen=True)
class Titled(Measured):
    """A result with two tables, a heading and an indented note."""

    def text(self):
        yield "arm · titled"
        yield "  a note"
        yield ""
        yield "Joints (medians)"
        yield TextTable(("what", "size"), [("a", "328.2 mm")])
        yield TextTable(("what", "size"), [("b", "stopped by a check at 2 mm")])


def test_a_line_above_a_table_is_its_heading_and_a_short_value_keeps_its_unit_beside_it():
    page = render(Titled(), "titled")
    assert "<pre>a note</pre>\n<h3>Joints (medians)</h3>" in page
    assert '<td class="nowrap">328.2 mm</td>' in page
    assert "<td>stopped by a check at 2 mm</td>" in page
    assert ".scroll + .scroll { margin-top" in page, "two tables are apart"


def test_files_and_data(tmp_path):
    assert write_result(Measured((WRONG,)), tmp_path, "arm") == ["arm.html"]
    text = (tmp_path / "arm.json").read_text(encoding="utf-8")
    assert '"schema": "twin/measured/1"' in text
    assert '"verdict": "disagree"' in text
    assert '"value": null' in text
