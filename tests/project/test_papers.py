"""docs/papers.md: every row of the five papers has a command that the tests of the pages run, or a test that exists."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache

import pytest

from made.pages import ROOT, all_steps

PAGE = ROOT / "docs/papers.md"
ABSENT = {
    "not built": "not built",
    "needs people": "need people or a device",
    "needs a device": "need people or a device",
}


@cache
def commands():
    """Return the commands that the tests of the pages run."""
    return {step.text for step in all_steps() if step.kind == "command"}


@cache
def rows():
    """Return (number, feature, command or test, comparison) of each row of the page."""
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("| ") and line[2].isdigit():
            number, feature, what, compared = (cell.strip() for cell in line.strip("|").split(" | "))
            found.append((int(number), feature, what.strip("`"), compared.rstrip(" |")))
    return found


def test_there_are_116_rows_that_differ():
    found = rows()
    assert [number for number, *_ in found] == list(range(1, 117))
    assert len({feature for _, feature, *_ in found}) == 116
    assert all(compared for *_, compared in found)


def test_the_counts_of_the_page_are_those_of_its_rows():
    kinds = Counter(ABSENT.get(what, "work") for _, _, what, _ in rows())
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    said = re.search(r"(\d+) rows work, (\d+) are not built, (\d+) need people or a device", text)
    assert said is not None
    assert [int(n) for n in said.groups()] == [kinds["work"], kinds["not built"], kinds["need people or a device"]]


@pytest.mark.parametrize(("number", "feature", "what", "compared"), rows(), ids=lambda value: str(value)[:40])
def test_what_a_row_names_is_there(number, feature, what, compared):
    if what in ABSENT:
        return
    if what.startswith("twin "):
        assert what in commands()
        return
    path, _, function = what.removeprefix("python ").partition("::")
    file = ROOT / path
    assert path.startswith("tests/")
    assert file.is_file()
    if function:
        assert re.search(rf"^def {function}\(", file.read_text(encoding="utf-8"), re.MULTILINE), function
