"""Texts, tables and colors on terminals of several widths; files and pipes get the same bytes as ever."""

from __future__ import annotations

import re
import shutil

import pytest
from hypothesis import given
from hypothesis import strategies as st

from made.lanes import one_of_a_kind
from twin.api.facts import BRIEF_LINES, info
from twin.api.robot_loading import load
from twin.cli import show
from twin.core.findings import disagreement
from twin.core.result import TextTable

ESCAPE = re.compile("\x1b\\[[0-9;]*m")
ROWS = [
    ("B-C", "point", "3.045 mm", "at S1 and S3, in x and y, while the platform tilts and the endoscope descends")
] * 3


@pytest.fixture
def terminal(monkeypatch):
    """A function that makes the output a terminal of a width, with or without colors."""

    def make(columns, color=False):
        monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
        monkeypatch.setattr(shutil, "get_terminal_size", lambda: shutil.os.terminal_size((columns, 24)))
        monkeypatch.setenv("NO_COLOR", "" if color else "1")
        monkeypatch.setenv("TERM", "xterm")

    return make


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_nothing_is_wider_than_the_terminal(columns, terminal):
    terminal(columns)
    finding = disagreement("point", "s1", "word " * 60, suggestion="replace " * 40)
    parts = [TextTable(("pair", "quantity", "worst", "where"), ROWS), finding, "a sentence that goes on " * 20]
    for part in parts:
        for line in show.plain(part).splitlines():
            assert len(line) <= columns, line


def test_no_word_is_lost_or_broken(terminal):
    terminal(60)
    sentence = " ".join(f"word{k}" for k in range(200))
    assert show.plain(f"    {sentence}").split() == sentence.split()
    cells = show.plain(TextTable(("a", "b", "c", "d"), ROWS[:1]))
    for word in ROWS[0][3].split():
        assert word in cells


def test_a_pipe_gets_no_escape_and_no_wrapped_line(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    line = "  DISAGREE: equations (A) and CAD (B) differ, " + "word " * 40
    assert show.plain(line) == line
    assert max(map(len, show.plain(TextTable((), ROWS)).splitlines())) > 80


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("  AGREE: all", "1;32"),
        ("  DISAGREE: equations differ", "1;31"),
        ("UNCHECKED: no stage", "1;33"),
        ("  ✖ point s1 differs", "1;31"),
        ("  ▲ joint q4", "1;33"),
        ("  we AGREE here", None),
        ("  AGREEMENT of all", None),
    ],
)
def test_the_verdict_alone_is_colored(line, code, terminal):
    terminal(80, color=True)
    colored = show.text(line)
    assert ESCAPE.sub("", colored) == line
    assert ESCAPE.findall(colored) == ([f"\x1b[{code}m", "\x1b[0m"] if code else [])


def test_no_color_is_honoured(terminal):
    terminal(80)
    assert show.text("  AGREE: all") == "  AGREE: all"


@given(
    st.lists(st.lists(st.text("ab ", max_size=60), min_size=3, max_size=3), min_size=1, max_size=4), st.integers(40, 90)
)
def test_tables_keep_their_letters(rows, columns):
    lines = [line for row in show.table_lines(rows, "  ", columns) for line in row]
    assert max(map(len, lines)) <= columns
    letters = sorted("".join(lines).replace(" ", ""))
    assert letters == sorted("".join("".join(row) for row in rows).replace(" ", ""))


def test_a_narrow_table_keeps_headings_whole_and_one_long_cell_does_not_widen_its_column():
    rows = [["check", "tolerance", "worst"]]
    rows += [[f"surface of link {k} against the other files", "1e-05 m", "0.834 µm"] for k in range(20)]
    rows.append(["limits", "1e-05 m or rad, whichever is the larger one", "7.45e-10"])
    drawn = show.table_lines(rows, "  ", 66)
    assert drawn[0] == [drawn[0][0]]
    assert drawn[0][0].split() == ["check", "tolerance", "worst"]
    assert all(len(lines) == 1 for lines in drawn[1:-1])
    assert len(drawn[-1]) > 1


@pytest.mark.slow
@pytest.mark.parametrize("name", one_of_a_kind())
def test_info_of_every_robot_is_brief(name):
    text = "\n".join(show.plain(part) for part in info(load(name)).brief(name))
    assert len(text.splitlines()) <= BRIEF_LINES
